"""`import`, `export` and `learn` on a learner's database, as users run them."""

from __future__ import annotations

import os
import pty
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics_cli.command_line import main
from intuitive_physics_learner import ObservationStore
from intuitive_physics_recordings.observation_files import save_observations
from intuitive_physics_recordings.parameter_files import load_parameters, save_parameters

from .bouncing_balls import bounces

COMMAND = [sys.executable, "-m", "intuitive_physics_cli.command_line"]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Stand in a folder with four observations as JSON."""
    save_observations(bounces(4), tmp_path / "saved")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(*arguments: object) -> None:
    assert main(list(map(str, arguments))) == 0


def test_observations_go_in_and_out_and_are_stored_once(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run("import", "a.sqlite3", "saved")
    assert "4 of 4 observations were new; a.sqlite3 holds 4" in capsys.readouterr().out
    run("export", "a.sqlite3", "out.mcap")
    assert "4 observations in out.mcap" in capsys.readouterr().out
    run("import", "a.sqlite3", "out.mcap")
    assert "0 of 4 observations were new; a.sqlite3 holds 4" in capsys.readouterr().out
    run("import", "b.sqlite3", "out.mcap")
    with ObservationStore("a.sqlite3") as a, ObservationStore("b.sqlite3") as b:
        for first, second in zip(a.observations(), b.observations(), strict=True):
            assert first.id == second.id
            (one,), (other,) = first.objects, second.objects
            np.testing.assert_array_equal(one.trajectory.positions, other.trajectory.positions)


@pytest.mark.parametrize("suffix", [".yaml", ".yml", ".json"])
def test_parameters_go_in_and_out(folder: Path, suffix: str) -> None:
    theta = LearnedParameters.defaults(["Straße", "ball: 1", "no"])
    save_parameters(theta, folder / f"given{suffix}")
    run("import", "a.sqlite3", f"given{suffix}")
    run("import", "a.sqlite3", f"given{suffix}")
    run("export", "a.sqlite3", f"first{suffix}", "--version", 1)
    run("export", "a.sqlite3", f"newest{suffix}")
    first, newest = (load_parameters(folder / f"{name}{suffix}") for name in ("first", "newest"))
    assert (first.version, newest.version) == (1, 2)
    assert {**newest.to_dict(), "version": 0} == theta.to_dict()


def test_learning_on_a_database_makes_its_next_version(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run("import", "a.sqlite3", "saved")
    run("learn", "a.sqlite3", "learned.yaml", "--iterations", 200)
    assert "4 observations; saved in learned.yaml" in capsys.readouterr().out
    with ObservationStore("a.sqlite3") as store:
        newest = store.newest_parameters()
        assert newest is not None
    assert newest.to_dict() == load_parameters(folder / "learned.yaml").to_dict()
    observation = sorted((folder / "saved").glob("*.json"))[0]
    run("predict", observation, "learned.yaml", "--samples", 5)
    # The same observations in a file: the same is learned.
    run("export", "a.sqlite3", "all.mcap")
    run("learn", "all.mcap", "again.json", "--iterations", 200)
    again = load_parameters(folder / "again.json")
    np.testing.assert_allclose(again.cost, newest.cost, rtol=1e-3)


def test_two_processes_learn_the_same(folder: Path) -> None:
    run("learn", "saved", "one.yaml", "--iterations", 100)
    # Processes of a cluster import the main module anew, so this one is a process of its own.
    arguments = ["learn", "saved", "two.yaml", "--iterations", "100", "--cluster", "local:2"]
    subprocess.run([*COMMAND, *arguments], check=True, timeout=120)
    one, two = (load_parameters(folder / name).to_dict() for name in ("one.yaml", "two.yaml"))
    assert one == two


@contextmanager
def terminal_learner() -> Iterator[tuple[subprocess.Popen[bytes], int]]:
    """Run an endless search at a terminal, and give it with the terminal's screen."""
    screen, terminal = pty.openpty()
    search = ["--method", "random", "--iterations", "10000000"]
    command = [*COMMAND, "learn", "a.sqlite3", "out.yaml", *search]
    learner = subprocess.Popen(command, stdout=terminal, stderr=terminal)
    os.close(terminal)
    try:
        yield learner, screen
    finally:
        learner.kill()
        learner.wait()
        os.close(screen)


def iterations_until(enough: int, screen: int) -> int:
    """Read the bar until it has shown so many iterations; return the first that it showed."""
    shown = b""
    while select.select([screen], [], [], 60.0)[0]:
        shown += os.read(screen, 4096)
        words = [word for word in shown.split() if word.endswith(b"/10000000")]
        if words and int(words[-1].split(b"/")[0]) >= enough:
            assert "█".encode() in shown or "·".encode() in shown
            assert b" s left" in shown
            return int(words[0].split(b"/")[0])
    raise AssertionError(f"waited in vain: {shown[-300:]!r}")


def test_shows_progress_at_a_terminal_and_goes_on_when_killed(folder: Path) -> None:
    run("import", "a.sqlite3", "saved")
    with terminal_learner() as (learner, screen):
        iterations_until(1001, screen)
        # It says where it stands once a second, between two of which it is stored.
        deadline = time.monotonic() + 2.0
        while time.monotonic() < deadline:
            iterations_until(1001, screen)
        learner.send_signal(signal.SIGKILL)
        learner.wait(60.0)
    with terminal_learner() as (learner, screen):
        first = iterations_until(1, screen)
        learner.send_signal(signal.SIGINT)
        assert learner.wait(60.0) == 130
    assert first > 1000


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["export", "nowhere.sqlite3", "out.yaml"], "there is no database nowhere.sqlite3"),
        (["export", "empty.sqlite3", "out.yaml"], "version is 0; expected some to be learned"),
        (["export", "empty.sqlite3", "out.mcap", "--version", "1"], "have no version"),
        (["export", "full.sqlite3", "out.txt"], "ends in .txt; expected one of .yaml"),
        (["export", "full.sqlite3", "out.yaml", "--version", "3"], "version is 3; expected 1 to 1"),
        (["export", "full.sqlite3", "no/such/out.yaml"], "cannot write"),
        (["import", "a.sqlite3", "nowhere.mcap"], "there is no bag nowhere.mcap"),
        (["import", "a.sqlite3", "nowhere.yaml"], "cannot read the parameters nowhere.yaml"),
        (["import", "a.sqlite3", "bad.yaml"], "cannot read the parameters bad.yaml"),
        (["import", "a.sqlite3", "other.yaml"], "other.yaml: learned parameters have the format"),
        (["import", "bad.yaml", "saved"], "is not an SQLite database"),
        (["learn", "nowhere.sqlite3", "out.yaml"], "there is no database nowhere.sqlite3"),
        (["learn", "empty.sqlite3", "out.yaml"], "no observation is stored yet"),
        (["learn", "saved", "out.txt"], "ends in .txt; expected one of .yaml"),
        (["learn", "saved", "out.yaml", "--cluster", "here"], "cluster is 'here'; expected one of"),
        (["learn", "saved", "out.yaml", "--time-limit", "-1"], "time_limit is -1"),
    ],
)
def test_mistakes_are_one_line_and_exit_code_1(
    arguments: list[str], message: str, folder: Path, complaint: Callable[..., str]
) -> None:
    (folder / "bad.yaml").write_text("a: [1\n" * 1000)
    (folder / "other.yaml").write_text("a: 1\n")
    ObservationStore("empty.sqlite3").close()
    with ObservationStore("full.sqlite3") as store:
        store.add_parameters(LearnedParameters.defaults(["ball"]))
    assert message in complaint(*arguments)
