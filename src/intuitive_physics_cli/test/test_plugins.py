"""Other packages add commands, readers and engines; one that is broken harms nothing else."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from intuitive_physics.errors import InvalidInputError, UnknownNameError
from intuitive_physics_cli.command_line import main
from intuitive_physics_cli.commands.observation_source import read_observations
from intuitive_physics_cli.plugins import (
    COMMANDS,
    ENGINES,
    OBSERVATION_READERS,
    make_engine,
)

MODULE = """
from intuitive_physics.simulation import make_simulator

def add_to(commands):
    parser = commands.add_parser("shout", help="says something")
    parser.set_defaults(run=lambda options: print("HELLO"))

def read(path):
    return f"read from {path.name}", []

def engine():
    return make_simulator("stepped")
"""

Install = Callable[[dict[str, str]], None]


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Install:
    """Installs a package `added_package` with entry points, one a group."""

    def make(points: dict[str, str]) -> None:
        (tmp_path / "added_package.py").write_text(MODULE)
        information = tmp_path / "added_package-1.0.dist-info"
        information.mkdir()
        (information / "METADATA").write_text("Name: added_package\nVersion: 1.0\n")
        text = "".join(f"[{group}]\n{point}\n" for group, point in points.items())
        (information / "entry_points.txt").write_text(text)
        monkeypatch.syspath_prepend(str(tmp_path))

    return make


def test_an_added_command_is_one_of_the_commands(
    install: Install, capsys: pytest.CaptureFixture[str]
) -> None:
    install({COMMANDS: "shout = added_package"})
    assert main(["shout"]) == 0
    assert capsys.readouterr().out == "HELLO\n"


def test_a_broken_package_is_named_and_left_out(
    install: Install, capsys: pytest.CaptureFixture[str]
) -> None:
    install({COMMANDS: "shout = package_that_is_gone.module"})
    with pytest.raises(SystemExit) as ended:
        main(["perceive", "--help"])
    assert ended.value.code == 0
    captured = capsys.readouterr()
    assert "usage: intuitive-physics perceive" in captured.out
    (warning,) = [line for line in captured.err.splitlines() if "shout" in line]
    assert "package_that_is_gone" in warning


def test_a_package_with_several_broken_commands_is_one_line(
    install: Install, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "broken_package.py").write_text("this is no Python")
    install({COMMANDS: "shout = broken_package\nwhisper = broken_package"})
    with pytest.raises(SystemExit) as ended:
        main(["learn", "--help"])
    assert ended.value.code == 0
    (warning,) = [line for line in capsys.readouterr().err.splitlines() if "shout" in line]
    assert "shout, whisper of broken_package cannot be loaded: SyntaxError" in warning


def test_an_added_command_cannot_take_the_place_of_an_own_one(
    install: Install, capsys: pytest.CaptureFixture[str]
) -> None:
    install({COMMANDS: "learn = added_package"})
    with pytest.raises(SystemExit) as ended:
        main(["learn", "--help"])
    assert ended.value.code == 0
    assert "usage: intuitive-physics learn" in capsys.readouterr().out


def test_an_added_reader_reads_its_suffix(install: Install, tmp_path: Path) -> None:
    install({OBSERVATION_READERS: "xyz = added_package:read"})
    path = tmp_path / "motions.xyz"
    path.touch()
    assert read_observations(path) == ("read from motions.xyz", [])


def test_what_no_package_reads_is_one_clear_error(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("intuitive_physics_cli.plugins.entry_points", lambda group: [])
    recorded, unknown = tmp_path / "set.npz", tmp_path / "set.xyz"
    recorded.touch()
    unknown.touch()
    with pytest.raises(InvalidInputError, match="intuitive_physics_experiments reads; install it"):
        read_observations(recorded)
    with pytest.raises(InvalidInputError, match=r"is no \.npz file; expected"):
        read_observations(unknown)


def test_added_engines_stand_beside_the_librarys(install: Install) -> None:
    install({ENGINES: "added = added_package:engine"})
    assert make_engine("added").name == "stepped"
    assert make_engine("event_driven").name == "event_driven"


def test_unknown_engines_and_missing_packages_are_different_errors(install: Install) -> None:
    install({ENGINES: "gone = package_that_is_gone.module:Engine"})
    with pytest.raises(UnknownNameError, match=r"simulator is 'havok'; expected one of .*gone"):
        make_engine("havok")
    with pytest.raises(InvalidInputError, match="package_that_is_gone"):
        make_engine("gone")
