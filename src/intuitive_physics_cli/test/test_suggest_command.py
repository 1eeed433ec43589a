"""`suggest` on a learner's database, as users run it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from intuitive_physics_cli.command_line import main
from intuitive_physics_learner import ObservationStore
from intuitive_physics_recordings.observation_files import save_observations

from .bouncing_balls import bounces

RANGES = ["--position", "-1", "0", "-1", "0", "0.05", "0.8", "--velocity", *["-2", "2"] * 3]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Stand in a folder with a database of four observations and one of them as a file."""
    monkeypatch.chdir(tmp_path)
    observations = bounces(4)
    save_observations(observations[:1], tmp_path / "saved")
    with ObservationStore(tmp_path / "a.sqlite3") as store:
        store.add_all(observations)
    return tmp_path


def output(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    assert main(["suggest", *map(str, arguments)]) == 0
    return capsys.readouterr().out


def test_prints_throws_and_what_is_known_after_them(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = output(capsys, "a.sqlite3", *RANGES, "--count", 2)
    assert "1. ball (rubber)" in text
    assert "2. ball (rubber)" in text
    assert "information (nat)" in text
    row = next(line for line in text.splitlines() if line.startswith("restitution[rubber, room]"))
    now, *after = map(float, row.split()[2:])
    assert len(after) == 2
    assert min(after) < 0.5 * now


def test_the_same_seed_prints_the_same_json(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = ["a.sqlite3", *RANGES, "--json", "--about", "restitution[room,rubber]", "--count", 3]
    first = output(capsys, *asked)
    assert first == output(capsys, *asked)
    throws = json.loads(first)
    assert len(throws) == 3
    assert list(throws[0]["standard_deviations"]) == ["restitution[rubber, room]"]
    (ball,) = throws[0]["objects"]
    assert -1.0 <= ball["position"][0] <= 0.0
    assert 0.05 <= ball["position"][2] <= 0.8
    gains = [throw["information"] for throw in throws]
    assert gains == sorted(gains, reverse=True)


def test_a_query_is_answered_in_metres_or_by_a_probability(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (scene,) = sorted((folder / "saved").glob("*.json"))
    text = output(capsys, "a.sqlite3", *RANGES, "--query", scene, "--at", 0.6)
    assert "z of ball at 0.6 s" in text
    region = ["--enters", 0, 0, 0.4, 0.1, "--of", "ball"]
    text = output(capsys, "a.sqlite3", *RANGES, "--query", scene, *region)
    assert "ball enters the region within 1 s" in text


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nowhere.sqlite3"], "there is no database nowhere.sqlite3"),
        (["empty.sqlite3"], "there are no observations"),
        (["a.sqlite3", "--count", "0"], "count is 0; expected 1 or more"),
        (["a.sqlite3", "--object", "cup"], "no object 'cup' was seen"),
        (["a.sqlite3", "--about", "bounce"], "parameter is 'bounce'; expected one of"),
        (["a.sqlite3", "--of", "ball"], "given without --query"),
        (["a.sqlite3", "--query", "no.json"], "cannot read no.json"),
        (["a.sqlite3", "--about", "x", "--query", "y"], "expected one of them"),
        (["a.sqlite3", "--velocity", *["1", "-1"] * 3], "expected lowest ≤ highest"),
        (["a.sqlite3", "--position", *["-1", "-0.5"] * 3], "expected ranges in which"),
    ],
)
def test_mistakes_are_one_line_and_exit_code_1(
    arguments: list[str], message: str, folder: Path, complaint: Callable[..., str]
) -> None:
    ObservationStore("empty.sqlite3").close()
    assert message in complaint("suggest", *arguments)
