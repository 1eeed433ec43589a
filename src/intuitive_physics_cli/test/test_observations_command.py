"""`intuitive-physics observations`, as users run it."""

from __future__ import annotations

import json
import shutil
import sqlite3
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from intuitive_physics.limits import InputLimits, use_limits
from intuitive_physics_cli.command_line import main
from intuitive_physics_learner import ObservationStore

from .bouncing_balls import bounces

NAMES = "abcd"


@pytest.fixture
def database(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Stand in a folder with a database of four observations."""
    monkeypatch.chdir(tmp_path)
    with ObservationStore("a.sqlite3") as store:
        store.add_all([replace(one, id=name) for one, name in zip(bounces(4), NAMES, strict=True)])
    return tmp_path / "a.sqlite3"


def run(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    assert main(["observations", *map(str, arguments)]) == 0
    return capsys.readouterr().out


def run_json(capsys: pytest.CaptureFixture[str], *arguments: object) -> Any:
    return json.loads(run(capsys, *arguments, "--json"))


def test_lists_what_is_stored(database: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lines = run(capsys, "list", database).splitlines()
    assert [line.split()[0] for line in lines[2:-1]] == list(reversed(NAMES))
    assert lines[-1].startswith("4 of 4 observations: 4 used, 0 excluded")
    listed = run_json(capsys, "list", database, "--limit", 1)
    (entry,) = listed["observations"]
    assert (entry["id"], entry["status"], entry["weight"], entry["reason"]) == (
        "d",
        "used",
        1.0,
        "",
    )
    assert listed["counts"]["used"] == 4


def test_excludes_includes_and_deletes(database: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "2 excluded; " in run(capsys, "exclude", database, "a", "c", "--reason", "kicked")
    assert run_json(capsys, "exclude", database, "a", "--reason", "kicked")["excluded"] == 0
    listed = run_json(capsys, "list", database, "--status", "excluded")["observations"]
    assert {(one["id"], one["reason"]) for one in listed} == {("a", "kicked"), ("c", "kicked")}
    assert "1 included; " in run(capsys, "include", database, "a")
    assert run_json(capsys, "delete", database, "b") == {
        "deleted": 1,
        "counts": {"used": 2, "excluded": 1, "doubtful": 0, "unreadable": 0},
    }


@pytest.mark.parametrize("output", ["folder", "some.mcap"])
def test_what_is_exported_can_be_imported(
    database: Path, capsys: pytest.CaptureFixture[str], output: str
) -> None:
    run(capsys, "exclude", database, "a")
    assert "3 observations in" in run(capsys, "export", database, output)
    assert main(["import", "b.sqlite3", output]) == 0
    with ObservationStore("b.sqlite3") as store:
        assert sorted([each.id for each in store.entries()]) == ["b", "c", "d"]
    capsys.readouterr()
    assert run_json(capsys, "export", database, "one", "a")["exported"] == 1


def test_checks_every_row(database: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with sqlite3.connect(database) as file:
        file.execute("UPDATE observations SET json = '{' WHERE id = 'b'")
    file.close()
    text = run(capsys, "check", database)
    assert "b cannot be read" in text
    assert "is not damaged and holds 3 used, 0 excluded, 0 doubtful, 1 unreadable" in text
    assert [one["id"] for one in run_json(capsys, "check", database)["unreadable"]] == ["b"]


def test_says_when_the_disk_or_the_database_fills(
    database: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    run(capsys, "export", database, "folder")
    assert "warning" not in capsys.readouterr().err
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=3_000_000))
    assert main(["import", "a.sqlite3", "folder"]) == 0
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("intuitive-physics: warning: the disk of a.sqlite3 has 3000000 bytes")
    use_limits(InputLimits(largest_database=1000))
    try:
        with ObservationStore("a.sqlite3") as store:
            store.delete(["a"])
        assert main(["observations", "list", "a.sqlite3"]) == 0
    finally:
        use_limits(InputLimits())
    assert "of at most 1000 bytes" in capsys.readouterr().err


def test_learning_passes_over_what_cannot_be_read(
    database: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with sqlite3.connect(database) as file:
        file.execute("UPDATE observations SET json = '{' WHERE id = 'b'")
    file.close()
    assert main(["learn", str(database), "learned.yaml", "--iterations", "20"]) == 0
    output = capsys.readouterr()
    assert "3 observations; saved in learned.yaml" in output.out
    assert "cannot be read and are passed over: 1; " in output.err


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["list", "none.sqlite3"], "there is no database none.sqlite3"),
        (["list", "a.sqlite3", "--status", "good"], "status is 'good'; expected used"),
        (["list", "a.sqlite3", "--limit", "-1"], "limit is -1; expected 0 or more"),
        (["exclude", "a.sqlite3", "x"], "observation id is 'x'; expected one of the 4"),
        (["delete", "a.sqlite3", "a", "x"], "observation id is 'x'; expected one of the 4"),
        (["export", "a.sqlite3", "folder", "x"], "observation id is 'x'"),
    ],
)
def test_mistakes_are_one_line_and_exit_code_1(
    database: Path, complaint: Callable[..., str], arguments: list[str], expected: str
) -> None:
    assert expected in complaint("observations", *arguments)
