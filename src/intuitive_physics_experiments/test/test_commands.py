"""The command as users run it: what it prints, its exit codes, and never a traceback."""

from __future__ import annotations

import csv
import shlex
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from intuitive_physics.processes import ChildProcess
from intuitive_physics_cli.command_line import main

COMMAND = [sys.executable, "-m", "intuitive_physics_cli.command_line"]


def run(*arguments: object) -> subprocess.CompletedProcess[str]:
    result = subprocess.run(
        [*COMMAND, *map(str, arguments)], capture_output=True, text=True, timeout=120, check=False
    )
    assert "Traceback" not in result.stderr
    return result


def errors_in_test(output: str) -> dict[str, float]:
    """J of the test by the name of what predicted."""
    table, _, _ = output[output.index("error (m)") :].partition("\n\n")
    lines = table.splitlines()[2:]
    return {line.split("  ")[0]: float(line.split()[-3]) for line in lines}


@pytest.fixture
def launch_set(tmp_path, launch_arrays):
    path = tmp_path / "launches.npz"
    np.savez(path, **launch_arrays(4))
    return path


def test_evaluate_prints_parameters_and_errors(launch_set):
    result = run("evaluate", launch_set, "--iterations", 600, "--train-fraction", 0.5)
    assert result.returncode == 0, result.stderr
    assert "4 observations, 2 to learn from, 2 to test" in result.stdout
    assert "restitution[ball, table]" in result.stdout
    assert "not identified: density of ball, table" in result.stdout
    errors = errors_in_test(result.stdout)
    assert errors["learned parameters"] < errors["default parameters"] < errors["free flight"]


@pytest.mark.long
def test_render_and_perceive(tmp_path):
    bag, saved = tmp_path / "bag", tmp_path / "saved"
    rendered = run("render", bag, "--throws", 1, "--seed", 4)
    assert rendered.returncode == 0, rendered.stderr
    assert "1 throw, " in rendered.stdout
    assert run("render", bag).returncode == 1
    perceived = run("perceive", bag, "--ball", "foam=0.07", "--save", saved)
    assert perceived.returncode == 0, perceived.stderr
    assert "planes: 3" in perceived.stdout
    assert "gravity: (0.000, 0.000, -9.810) m/s²" in perceived.stdout
    assert "observations: 1" in perceived.stdout
    assert "foam" in perceived.stdout
    assert len(list(saved.glob("*.json"))) == 1


@pytest.mark.needs("recordings")
@pytest.mark.parametrize(
    ("name", "share"),
    # Several impacts, and spin that nobody saw, make billiards harder.
    [("table_tennis_launches", 0.3), ("table_tennis_gun", 0.3), ("carom_billiards", 0.7)],
)
def test_evaluate_recorded_sets(recording, name, share):
    result = run("evaluate", recording(f"{name}.npz"), "--iterations", 300)
    assert result.returncode == 0, result.stderr
    errors = errors_in_test(result.stdout)
    assert errors["learned parameters"] < share * errors["default parameters"]
    assert errors["default parameters"] < errors["free flight"]


def errors_of_tosses(output: str) -> dict[str, tuple[float, float]]:
    """Mean position error (% of width) and rotation error (°) of the test by what simulated."""
    lines = output[output.index("mean over a toss") :].splitlines()[2:]
    rows = (line.replace(" ± ", "±").split("  ") for line in lines)
    cells = ([cell.strip() for cell in row if cell.strip()] for row in rows)
    return {
        row[0]: (float(row[2].split("±")[0]), float(row[4].split("±")[0]))
        for row in cells
        if len(row) == 5
    }


@pytest.mark.parametrize(
    ("option", "message"),
    [
        (["--engine", "bullet"], "engine is given"),
        (["--train-fraction", "0.5"], "train fraction is given"),
        (["--drag", "0.5"], "both are learned with the spin"),
        (["--measured-inertia"], "expected it for cube tosses only"),
    ],
)
def test_evaluate_refuses_what_flights_with_spin_do_not_take(tmp_path, option, message, capsys):
    names = ("time", "position", "offsets", "spin", "radius", "mass")
    np.savez(tmp_path / "set.npz", **dict.fromkeys(names, np.zeros(1)))
    assert main(["evaluate", str(tmp_path / "set.npz"), *option]) != 0
    assert message in capsys.readouterr().err


def test_evaluate_cube_tosses_beside_published_figures(tmp_path, toss_arrays):
    np.savez(tmp_path / "tosses.npz", **toss_arrays(4))
    engines = ["--engine", "stepped", "--engine", "bullet"]
    arguments = [*engines, "--iterations", 30, "--train-fraction", 0.5, "--save", tmp_path / "kept"]
    result = run("evaluate", tmp_path / "tosses.npz", *arguments)
    assert result.returncode == 0, result.stderr
    assert "4 tosses, 2 to fit to, 2 to test" in result.stdout
    assert "Drake, published" in result.stdout
    errors = errors_of_tosses(result.stdout)
    for engine in ("stepped", "bullet"):
        assert errors[f"{engine}, fitted"] < errors[f"{engine}, default parameters"]
    with (tmp_path / "kept" / "errors.csv").open() as file:
        kept = {row["prediction"]: row for row in csv.DictReader(file)}
    for name in ("stepped, fitted", "bullet, default parameters"):
        row, shown = kept[name], errors[name]
        assert (row["training"], row["test"]) == ("2", "2")
        assert 100.0 * float(row["position_test"]) == pytest.approx(shown[0], abs=0.051)
        assert np.degrees(float(row["rotation_test"])) == pytest.approx(shown[1], abs=0.051)
    page = (tmp_path / "kept" / "README.md").read_text()
    given = shlex.join(["intuitive-physics", *map(str, result.args[len(COMMAND) :])])
    assert f"Made by `{given}` at commit " in page
    assert result.stdout.partition("\n")[2].strip() in page


@pytest.mark.needs("recordings")
def test_evaluate_recorded_cube_tosses(recording):
    result = run("evaluate", recording("cube_tosses.npz"), "--iterations", 60)
    assert result.returncode == 0, result.stderr
    assert "400 tosses, 100 to fit to, 300 to test" in result.stdout
    errors = errors_of_tosses(result.stdout)
    position, rotation = errors["stepped, fitted"]
    # Three engines of others are at 13.5 to 25.1 % and 16.5 to 21.7°; σ of the mean of 300 tosses
    # is about 0.5 % and 1.2°.
    assert position < 16.0
    assert rotation < 22.0
    assert errors["stepped, default parameters"][0] > 2.0 * position
    assert errors["free flight to the first touch"][0] > 5.0 * position


@pytest.mark.needs("recordings")
@pytest.mark.parametrize("name", ["table_tennis_launches.npz", "table_tennis_gun.npz"])
def test_balls_that_fly_through_air_are_predicted_better(recording, name):
    arguments = ["evaluate", recording(name), "--engine", "stepped", "--iterations", 600]
    results = [run(*arguments), run(*arguments, "--drag", 0.4, "--magnus", 1)]
    assert [result.returncode for result in results] == [0, 0], results[1].stderr
    without, with_air = (errors_in_test(r.stdout)["learned parameters"] for r in results)
    assert with_air < 0.75 * without


@pytest.mark.needs("recordings")
def test_drag_is_learned_from_the_recording(recording):
    arguments = ["--drag", "learn", "--iterations", 400]
    result = run("evaluate", recording("table_tennis_launches.npz"), *arguments)
    assert result.returncode == 0, result.stderr
    drag = float(result.stdout.split("learned drag ")[1].split()[0])
    # A smooth sphere at 4 m/s has about 0.4 to 0.5; the camera's metres are not exact.
    assert 0.2 < drag < 0.6
    assert "0.6 s ahead, from the first 0.2 s of" in result.stdout
    ahead = result.stdout.split("ahead, from")[1].splitlines()
    means = {line[:20].strip(): float(line.split()[-2]) for line in ahead[3:6]}
    spread = float(result.stdout.split("at that time: ")[1].split()[0])
    assert means["learned parameters"] < spread < means["default parameters"]


def test_tosses_by_the_number_learned_from(tmp_path, toss_arrays):
    arrays = {**toss_arrays(5, "stepped"), "mass": np.array(0.4), "inertia": np.array(6.7e-4)}
    np.savez(tmp_path / "tosses.npz", **arrays)
    arguments = ["--iterations", 20, "--train-counts", 3, 4, "--measured-inertia"]
    arguments.append("--learn-mass-centre")
    result = run("evaluate", tmp_path / "tosses.npz", *arguments)
    assert result.returncode == 0, result.stderr
    assert "moment of inertia as measured" in result.stdout
    assert "5 tosses, 3 to fit to, 2 to test" in result.stdout
    assert "centre of mass from 3 flights" in result.stdout
    assert "5 tosses, 4 to fit to, 1 to test" in result.stdout


def test_report_shows_what_was_learned_and_predicted(tmp_path, launch_arrays):
    np.savez(tmp_path / "set.npz", **launch_arrays(5))
    page = tmp_path / "new" / "report.html"
    result = run("report", tmp_path / "set.npz", page, "--iterations", 600)
    assert result.returncode == 0, result.stderr
    assert "4 observations learned from, 1 predicted" in result.stdout
    text = page.read_text(encoding="utf-8")
    assert "restitution[ball, table]" in text
    assert "launch_" in text
    assert text.count("Plotly.newPlot(") >= 3


def write(path: Path, text: str = "") -> Path:
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["evaluate", "nowhere.npz"], "there is no nowhere.npz"),
        (["evaluate", "text.npz"], "cannot read text.npz"),
        (["evaluate", "other.npz"], "has the arrays a; expected"),
        (["evaluate", "notes.txt"], "is no .npz file"),
        (["evaluate", "."], "has no .json file"),
        (["evaluate", "bad_observations"], "not whole JSON"),
        (["evaluate", "set.npz", "--train-fraction", "2"], "train fraction is 2"),
        (["evaluate", "set.npz", "--method", "magic"], "method is 'magic'"),
        (["evaluate", "set.npz", "--iterations", "0"], "max_iterations is 0"),
        (["evaluate", "set.npz", "--seed", "-1"], "seed is -1"),
        (["evaluate", "set.npz", "--engine", "magic"], "simulator is 'magic'"),
        (["evaluate", "set.npz", "--length-correction", "1.02"], "for cube tosses only"),
        (["evaluate", "tosses.npz", "--length-correction", "-1"], "length correction is -1"),
        (["evaluate", "set.npz", "--train-counts", "2"], "for cube tosses only"),
        (["evaluate", "set.npz", "--measured-inertia"], "for cube tosses only"),
        (["evaluate", "set.npz", "--save", "kept"], "for cube tosses only"),
        (["evaluate", "set.npz", "--learn-mass-centre"], "for cube tosses only"),
        (["evaluate", "tosses.npz", "--train-counts", "2"], "train count is 2 of 2"),
        (["evaluate", "tosses.npz", "--measured-inertia"], "no array mass"),
        (["evaluate", "tosses.npz", "--drag", "learn"], "for table tennis only"),
        (["evaluate", "tosses.npz", "--engine", "magic"], "simulator is 'magic'"),
        (["evaluate", "tosses.npz", "--drag", "0.4"], "for table tennis only"),
        (["evaluate", "set.npz", "--drag", "-1"], "drag coefficient is -1"),
        (["evaluate", "other.npz", "--magnus", "1"], "has the arrays a; expected"),
        (
            ["calibrate", "folder", "--splits", "0"],
            "--splits is 0; expected a whole number, at least 1",
        ),
        (["calibrate", "folder", "--observations", "set.npz", "--splits", "4"], "4 splits of 3"),
        (["render", "bag", "--throws", "0"], "expected at least 1"),
        (["render", "notes.txt"], "exists already"),
        (["render", "bag", "--seed", "-3"], "seed is -3"),
    ],
)
def test_mistakes_are_one_line_and_exit_code_1(
    arguments, message, tmp_path, launch_arrays, toss_arrays, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    write(tmp_path / "text.npz", "no zip")
    write(tmp_path / "notes.txt")
    (tmp_path / "bad_observations").mkdir()
    write(tmp_path / "bad_observations" / "0.json", "{")
    np.savez("other.npz", a=np.zeros(3))
    np.savez("set.npz", **launch_arrays(3))
    np.savez("tosses.npz", **toss_arrays(2))
    capsys.readouterr()
    assert main(arguments) == 1
    captured = capsys.readouterr()
    assert message in captured.err
    assert captured.err.startswith("intuitive-physics: error: ")
    assert len(captured.err.strip().splitlines()) == 1


def test_ctrl_c_ends_with_130(launch_set):
    endless = ["--method", "random", "--iterations", "100000000"]
    process = ChildProcess([*COMMAND, "evaluate", str(launch_set), *endless])
    time.sleep(4.0)
    assert process.stop(timeout=60.0) == 130, process.output
    assert "Traceback" not in process.output
