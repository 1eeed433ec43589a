"""Results of the benchmarks: the pages say what the JSON files say, and nothing else."""

from __future__ import annotations

import argparse
import importlib
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from benchmarks.command import Outcome, measure_parts, run_benchmark
from benchmarks.results import __main__ as make_pages
from benchmarks.results.beside_stored import beside_stored
from benchmarks.results.markdown import page
from benchmarks.results.provenance import started_run
from benchmarks.results.result import (
    FOLDER,
    Column,
    Machine,
    Result,
    ResultFileError,
    Run,
    Table,
    read_result,
    write_result,
)

from intuitive_physics.errors import InvalidInputError

ROOT = Path(__file__).parent.parent
BENCHMARKS = ("simulation", "prediction", "perception", "learning", "robot", "torture")
RESULTS = sorted(path.stem for path in FOLDER.glob("*.json"))
KEPT = {"simulation", "prediction_node", "prediction_camera", "perception", "learning"}
"""Results that other pages read."""

MADE_UP = Result(
    title="Made-up benchmark",
    run=Run(
        command="make bench-made-up options=--write",
        commit="0123456789abcdef0123456789abcdef01234567",
        dirty=True,
        date="2026-11-22T21:34:58+00:00",
        seconds=12.3,
        machine=Machine("Some processor", 2, "Linux", "3.12.3", {"numpy": "2.0.0"}),
    ),
    tables=[
        Table(
            title="Times",
            columns=[Column("engine"), Column("time", "ms", ".2f"), Column("gain", "", "+.0%")],
            rows=[["first", 1.0, 0.25], ["second", None, "inf"]],
            note="Of one step.",
            remarks=["first: as it is", "second: with a brake"],
        )
    ],
    note="Nothing of this was measured.",
    key_figures={"time_ms": {"first": 1.0}},
)

MADE_UP_PAGE = """\
# Made-up benchmark

Made by `make bench-made-up options=--write` in 12 s on 2026-11-22 at commit 0123456 with \
uncommitted changes, on 2 cores of Some processor, Linux, Python 3.12.3; numpy 2.0.0.

Nothing of this was measured.

## Times

Of one step.

| engine | time | gain |
|--------|------|------|
| first  | 1.00 | +25% |
| second | –    | inf  |

- first: as it is
- second: with a brake
"""


@pytest.mark.parametrize("name", RESULTS)
def test_page_is_what_the_json_says(name):
    committed = (FOLDER / f"{name}.md").read_text(encoding="utf-8")
    assert page(read_result(FOLDER / f"{name}.json")) == committed, "python -m benchmarks.results"


def test_every_file_of_results_belongs_to_a_benchmark():
    assert set(RESULTS) >= KEPT
    assert {name.partition("_")[0] for name in RESULTS} <= set(BENCHMARKS)
    assert {path.stem for path in FOLDER.glob("*.md")} == set(RESULTS)


@pytest.mark.parametrize("name", RESULTS)
def test_results_have_command_and_commit(name):
    run = read_result(FOLDER / f"{name}.json").run
    benchmark, _, part = name.partition("_")
    target = "torture" if benchmark == "torture" else f"bench-{benchmark}"
    assert run.command.startswith((f"make {target}", f"python -m benchmarks.{benchmark} "))
    part, _, seed = part.partition("_seed_")
    assert not seed or f"--first-seed {seed}" in run.command
    parts = [one for one in part.split("_") if one]
    if "long" in parts:
        parts.remove("long")
        assert "--hours" in run.command
    only = ",".join(parts)
    assert f"--only {only}" in run.command if only else "--only" not in run.command
    assert len(run.commit) == 40


def test_page_has_everything():
    assert page(MADE_UP) == MADE_UP_PAGE


def test_result_is_the_same_when_read_again(tmp_path):
    path = tmp_path / "made_up.json"
    write_result(path, MADE_UP)
    assert read_result(path) == MADE_UP


def test_numbers_of_numpy_and_those_that_json_has_not_are_written(tmp_path):
    path = tmp_path / "numbers.json"
    rows = [[np.float64(1.5), np.int64(2), float("inf"), float("nan")]]
    columns = [Column(heading) for heading in "abcd"]
    write_result(path, Result("Numbers", MADE_UP.run, [Table("Numbers", columns, rows)]))
    assert read_result(path).tables[0].rows == [[1.5, 2, "inf", "nan"]]


def changed(path: Path, change) -> Path:
    write_result(path, MADE_UP)
    data = json.loads(path.read_text(encoding="utf-8"))
    change(data)
    path.write_text(json.dumps(data), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d.update(format_version=2), "format_version is 2; expected 1"),
        (lambda d: d.pop("tables"), "is not a benchmark's result: KeyError('tables')"),
        (lambda d: d["run"].pop("commit"), "is not a benchmark's result: TypeError("),
        (lambda d: d["tables"][0]["columns"].append("time"), "is not a benchmark's result: Type"),
    ],
)
def test_malformed_result_gives_one_clear_error(tmp_path, change, message):
    path = changed(tmp_path / "made_up.json", change)
    with pytest.raises(ResultFileError) as caught:
        read_result(path)
    assert str(caught.value).startswith(f"{path}: {message}")


def test_file_that_is_no_json_gives_one_clear_error(tmp_path, capsys):
    (tmp_path / "bad.json").write_text("{", encoding="utf-8")
    write_result(tmp_path / "good.json", MADE_UP)
    assert make_pages.main([str(tmp_path)]) == 1
    assert (tmp_path / "good.md").read_text(encoding="utf-8") == MADE_UP_PAGE
    assert not (tmp_path / "bad.md").exists()
    error = capsys.readouterr().err
    assert error.startswith(f"benchmarks.results: {tmp_path / 'bad.json'}: is not JSON: ")
    assert error.count("\n") == 1


def test_run_records_command_commit_and_machine(monkeypatch):
    monkeypatch.delenv("MAKELEVEL", raising=False)
    run = started_run("simulation", ["--quick"])
    assert run.command == "python -m benchmarks.simulation --quick"
    assert run.machine is not None
    assert run.machine.cores >= 1
    assert "numpy" in run.machine.libraries
    monkeypatch.setenv("MAKELEVEL", "1")
    assert started_run("simulation", []).command == "make bench-simulation"
    assert (
        started_run("simulation", ["--quick", "--write"]).command
        == 'make bench-simulation options="--quick --write"'
    )
    assert started_run("torture", ["--write"]).command == "make torture options=--write"


@pytest.mark.parametrize("valid", [True, False])
def test_benchmark_writes_its_result_and_prints_a_line_of_json_last(
    tmp_path, monkeypatch, capsys, valid
):
    monkeypatch.setattr("benchmarks.command.FOLDER", tmp_path)

    def measure(options: argparse.Namespace) -> Outcome:
        return Outcome(
            tables=MADE_UP.tables,
            key_figures={"quick": options.quick},
            complaints=["too slow"],
            valid=valid,
            draw=lambda path: path.write_text("figure", encoding="utf-8") and None,
        )

    status = run_benchmark("made_up", "Nothing.", measure, ["--quick", "--write"])
    assert status == (0 if valid else 1)
    printed = capsys.readouterr()
    assert json.loads(printed.out.splitlines()[-1]) == {"quick": True}
    assert "bench-made_up: too slow" in printed.err
    written = read_result(tmp_path / "made_up.json")
    assert written.tables == MADE_UP.tables
    assert written.key_figures == {"quick": True}
    assert page(written) == (tmp_path / "made_up.md").read_text(encoding="utf-8")
    assert (tmp_path / "made_up.svg").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--only", "first,none"], "'none'; expected some of first,second"),
        (["--first-seed", "-1"], "-1; expected at least 0"),
    ],
)
def test_options_that_make_no_sense_are_errors(capsys, arguments, message):
    with pytest.raises(SystemExit):
        run_benchmark(
            "made_up",
            "Nothing.",
            lambda options: Outcome(),
            arguments,
            parts=["first", "second"],
            first_seed=0,
        )
    assert message in capsys.readouterr().err


def test_parts_are_chosen_in_their_own_order(capsys):
    def measure(options: argparse.Namespace) -> Outcome:
        return Outcome(key_figures={"only": options.only, "first_seed": options.first_seed})

    arguments = ["--only", "c, a"]
    run_benchmark("made_up", "Nothing.", measure, arguments, parts=["a", "b", "c"], first_seed=7)
    printed = capsys.readouterr().out.splitlines()[-1]
    assert json.loads(printed) == {"only": ["a", "c"], "first_seed": 7}


def test_part_that_fails_does_not_stop_the_others():
    def fail() -> Outcome:
        raise InvalidInputError("it went wrong")

    outcome = measure_parts({"bad": fail, "good": lambda: Outcome(key_figures={"good": 1})})
    assert outcome.key_figures == {"good": 1}
    assert outcome.complaints == ["bad: it went wrong"]
    assert not outcome.valid


KEPT_BY_ROBOT = {
    "bringup_s": 4.5,
    "respawn_to_predicting_s": 2.8,
    "ctrl_c_s": 1.2,
    "graph_connected_bare": True,
    "end_to_end_ms": {"p50": 7.0, "p99": 10.1},
}


@pytest.mark.parametrize(
    ("changed", "missed"),
    [
        ({}, None),
        ({"ctrl_c_s": 3.5}, "ctrl_c_s is 3.5; expected at most 3"),
        ({"end_to_end_ms": {"p50": 7.0, "p99": 36.0}}, "p99 of end_to_end_ms is 36"),
        ({"graph_connected_bare": False}, "plain nodes do not find one another"),
    ],
)
def test_robot_that_misses_a_bar_is_no_valid_result(changed, missed):
    judged = importlib.import_module("benchmarks.robot.__main__").judged
    outcome = judged(MADE_UP.tables, {**KEPT_BY_ROBOT, **changed})
    check_verdict(outcome, missed)


@pytest.mark.parametrize("missed", [None, "1 lost; expected none"])
def test_torture_that_misses_a_bar_is_no_valid_result(missed):
    judged = importlib.import_module("benchmarks.torture.__main__").judged
    outcome = judged(MADE_UP.tables, {}, [missed] if missed else [])
    check_verdict(outcome, missed)


def check_verdict(outcome: Outcome, missed: str | None) -> None:
    """A missed bar stands in the page and among the complaints, and makes the exit status 1."""
    assert outcome.valid == (missed is None)
    if missed is None:
        assert not outcome.complaints
        assert outcome.note.endswith("All bars were kept.")
    else:
        assert missed in outcome.complaints[0]
        assert missed in outcome.note


def test_part_of_torture_is_kept_apart_with_its_missed_bar(tmp_path, monkeypatch, capsys):
    torture = importlib.import_module("benchmarks.torture.__main__")
    monkeypatch.setattr("benchmarks.command.FOLDER", tmp_path)
    result = Outcome(MADE_UP.tables, {}, complaints=["a node grew by 9 MB"])
    monkeypatch.setattr(torture, "soak", lambda folder, minutes: result)
    assert torture.main(["--only", "soak", "--write"]) == 1
    assert "bench-torture: soak: a node grew by 9 MB" in capsys.readouterr().err
    usual = {"torture_soak.json", "torture_soak.md"}
    assert {path.name for path in tmp_path.iterdir()} == usual
    page = (tmp_path / "torture_soak.md").read_text()
    assert "**Bars missed**: soak: a node grew by 9 MB." in page
    assert torture.main(["--only", "soak", "--hours", "2", "--write"]) == 1
    long = {"torture_soak_long.json", "torture_soak_long.md"}
    assert {path.name for path in tmp_path.iterdir()} == usual | long


@pytest.mark.parametrize("name", [*BENCHMARKS, "results"])
def test_help_of_every_command(name):
    done = subprocess.run(
        [sys.executable, "-m", f"benchmarks.{name}", "--help"],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(f"usage: python -m benchmarks.{name} ")


def test_figures_stand_beside_stored_ones_of_the_same_name(tmp_path):
    write_result(tmp_path / "made_up.json", MADE_UP)
    figures = {"time_ms": {"first": 2.0, "second": None}, "worlds": "3 of 5"}
    table = beside_stored(figures, tmp_path / "made_up.json", ("before", "now"))
    assert [column.heading for column in table.columns] == ["figure", "before", "now"]
    assert table.rows == [["time_ms, first", 1.0, 2.0], ["worlds", None, "3 of 5"]]
