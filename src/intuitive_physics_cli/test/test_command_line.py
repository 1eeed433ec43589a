"""The command as users run it: what it prints, its exit codes, and never a traceback."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from intuitive_physics_cli.commands.observation_source import METHOD
from intuitive_physics_learner.methods import DEFAULT_METHOD
from intuitive_physics_recordings.observation_files import save_observations

from .bouncing_balls import bounces

COMMAND = [sys.executable, "-m", "intuitive_physics_cli.command_line"]


def run(*arguments: object) -> subprocess.CompletedProcess[str]:
    result = subprocess.run(
        [*COMMAND, *map(str, arguments)], capture_output=True, text=True, timeout=120, check=False
    )
    assert "Traceback" not in result.stderr
    return result


def test_learn_then_predict(tmp_path: Path) -> None:
    folder, parameters = tmp_path / "observations", tmp_path / "parameters.json"
    save_observations(bounces(4), folder)
    learned = run("learn", folder, parameters, "--iterations", 300, "--method", "adaptive_random")
    assert learned.returncode == 0, learned.stderr
    assert "saved in" in learned.stdout
    observation = sorted(folder.glob("*.json"))[0]
    predicted = run("predict", observation, parameters, "--samples", 10)
    assert predicted.returncode == 0, predicted.stderr
    assert "ball (rubber), 10 samples" in predicted.stdout


def test_learn_with_the_largest_distance(tmp_path: Path) -> None:
    folder, parameters = tmp_path / "observations", tmp_path / "parameters.json"
    save_observations(bounces(3), folder)
    arguments = ("learn", folder, parameters, "--iterations", 40, "--distance", "max")
    learned = run(*arguments, "--method", "cma_es")
    assert learned.returncode == 0, learned.stderr
    assert "J (max distance) is" in learned.stdout
    refused = run(*arguments)
    assert refused.returncode != 0
    assert "levenberg_marquardt, which fits the observed points" in refused.stderr


@pytest.mark.needs("recordings")
def test_perceive_a_lidar_scan(recording: Callable[[str], Path]) -> None:
    # README of the data: an exercise ball of 0.28 to 0.30 m radius on a chair.
    result = run("perceive", recording("lidar_ball_1.npz"))
    assert result.returncode == 0, result.stderr
    assert "balls: 1" in result.stdout
    height, radius = (result.stdout.splitlines()[-1].replace(")", " ").split()[k] for k in (2, 3))
    assert 0.28 < float(radius) < 0.31
    assert 0.5 < float(height) < 1.2


def test_the_default_method_is_the_librarys() -> None:
    assert METHOD == DEFAULT_METHOD


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["learn", "saved", "no/such/folder/out.json", "--iterations", "5"], "cannot write"),
        (["perceive", "nowhere"], "there is no nowhere"),
        (["perceive", "other.npz"], "expected xyz"),
        (["perceive", "nan.npz"], "points"),
        (["perceive", "notes.txt"], "bag"),
        (["perceive", "."], "metadata.yaml"),
        (["perceive", "other.npz", "--save", "x"], "no motion to save"),
        (["perceive", "cloud.npz", "--rerun", "x.rrd"], "expected --rerun with a bag"),
        (["perceive", "cloud.npz", "--ball", "foam"], "expected MATERIAL=RADIUS"),
        (["predict", "nowhere.json", "nowhere.json"], "cannot read nowhere.json"),
        (["predict", "some.json", "some.json", "--tilt-noise", "2"], "contact noise tilt is 2 rad"),
        (["report", "nowhere.npz", "out.html"], "there is no nowhere.npz"),
        (["report", "saved", "notes.txt/out.html", "--iterations", "5"], "cannot write"),
    ],
)
def test_mistakes_are_one_line_and_exit_code_1(
    arguments: list[str],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    complaint: Callable[..., str],
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "notes.txt").touch()
    np.savez("other.npz", a=np.zeros(3))
    np.savez("nan.npz", xyz=np.full((100, 3), np.nan))
    np.savez("cloud.npz", xyz=np.random.default_rng(0).normal(size=(500, 3)))
    save_observations(bounces(3), tmp_path / "saved")
    assert message in complaint(*arguments)


def test_wrong_usage_and_errors_as_a_process(tmp_path: Path) -> None:
    assert run("fly").returncode == 2
    result = run("perceive", tmp_path / "nowhere")
    assert (result.returncode, result.stdout) == (1, "")
    assert len(result.stderr.strip().splitlines()) == 1


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ("most_objects", "--input-limit is 'most_objects'; expected NAME=NUMBER with one of"),
        ("most_balls=3", "expected NAME=NUMBER with one of most_materials, most_objects"),
        ("most_objects=many", "--input-limit is 'most_objects=many'"),
        ("most_objects=inf", "--input-limit is 'most_objects=inf'"),
        ("most_objects=0", "most_objects is 0; expected a whole number from 1"),
    ],
)
def test_a_bad_input_limit_is_one_line(
    given: str, expected: str, complaint: Callable[..., str]
) -> None:
    limit = ("--input-limit", given)
    assert expected in complaint(*limit, "observations", "list", "none.sqlite3")


def test_an_input_limit_counts(tmp_path: Path) -> None:
    folder, database = tmp_path / "observations", tmp_path / "learner.sqlite3"
    save_observations(bounces(1), folder)
    refused = run("--input-limit", "most_points=5", "import", database, folder)
    assert refused.returncode == 1
    assert "expected at most 5" in refused.stderr
    taken = run("--input-limit", "most_points=1e5", "import", database, folder)
    assert taken.returncode == 0, taken.stderr
