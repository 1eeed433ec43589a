"""The paper's experiments on reduced settings: they end, resume, and show what they must."""

from __future__ import annotations

import csv
import json
import os
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.observation import load_observation
from intuitive_physics_cli.command_line import main
from intuitive_physics_experiments.commands.experiment_command import EXPERIMENTS
from intuitive_physics_experiments.paper import learning_curve, prediction, rgbd, search_methods
from intuitive_physics_experiments.paper.paper_dataset import make_paper_dataset
from intuitive_physics_experiments.paper.settings import (
    LearningCurveSettings,
    PredictionExperimentSettings,
    RgbdSettings,
    SearchMethodsSettings,
)
from intuitive_physics_experiments.results import CellStore, run_experiment
from intuitive_physics_learner.search.update_rules import UPDATE_RULES

SMALL_CURVE = LearningCurveSettings((1, 2), (5,), repetitions=2, iterations=120, method="cma_es")


def test_cells_are_made_once_and_kept(tmp_path):
    made = []

    def cell(name: str):
        return lambda: {"made": made.append(name) or len(made)}

    store = CellStore(tmp_path, {"size": 1})
    first = store.run({"a": cell("a"), "b": cell("b")})
    again = CellStore(tmp_path, {"size": 1}).run({"a": cell("a"), "b": cell("b"), "c": cell("c")})
    assert made == ["a", "b", "c"]
    assert {name: again[name] for name in first} == first


def test_a_cell_that_fails_leaves_what_was_finished(tmp_path):
    def fail():
        raise InvalidInputError("no")

    store = CellStore(tmp_path, {})
    with pytest.raises(InvalidInputError, match="no"):
        store.run({"a": lambda: {"x": 1}, "b": fail})
    assert [path.name for path in (tmp_path / "cells").iterdir()] == ["a.json"]


def test_cells_side_by_side_are_the_same(tmp_path):
    cells = {name: (lambda name=name: {"name": name, "of": os.getpid()}) for name in "abcdef"}
    steps: list[tuple[int, int, str]] = []
    cells_made = CellStore(tmp_path, {}, 2, lambda *step: steps.append(step)).run(cells)
    assert list(cells_made) == list(cells)
    assert all(cell["name"] == name for name, cell in cells_made.items())
    assert os.getpid() not in {cell["of"] for cell in cells_made.values()}
    assert [step[0] for step in steps] == [0, 1, 2, 3, 4, 5, 6, 6]
    again = CellStore(tmp_path, {}, 2).run(cells)
    assert again == cells_made


def test_a_cell_that_fails_beside_others_says_why(tmp_path):
    def fail():
        raise InvalidInputError("no")

    with pytest.raises(InvalidInputError, match="no"):
        CellStore(tmp_path, {}, 2).run({"a": lambda: {"x": 1}, "b": fail})


def test_a_folder_of_other_settings_is_refused(tmp_path):
    CellStore(tmp_path, {"size": (1, 2), "seed": 0})
    CellStore(tmp_path, {"size": (1, 2), "seed": 0})
    with pytest.raises(InvalidInputError, match=r"other settings \(seed\)"):
        CellStore(tmp_path, {"size": (1, 2), "seed": 1})


def test_a_broken_cell_is_named(tmp_path):
    store = CellStore(tmp_path, {})
    (tmp_path / "cells" / "a.json").write_text("{")
    with pytest.raises(InvalidInputError, match=r"a\.json.*remove it"):
        store.run({"a": dict})


@pytest.fixture(scope="module")
def curve(tmp_path_factory):
    folder = tmp_path_factory.mktemp("curve")
    return folder, run_curve(folder)


def run_curve(folder: Path) -> list[dict]:
    results = run_experiment(learning_curve.run, "learning-curve", SMALL_CURVE, folder)
    return list(results.tables["summary.csv"])


def test_learning_explains_better_than_not_learning(curve):
    _, summary = curve
    assert len(summary) == 4
    for line in summary:
        assert line["learned_training"] < line["default_training"]


def test_better_initial_states_leave_less_error(curve):
    # What the oracle misses is the noise of the initial states alone.
    _, summary = curve
    by_source = {
        source: np.mean([li["oracle_training"] for li in summary if li["first_states"] == source])
        for source in ("three_points", "flight")
    }
    assert by_source["flight"] < by_source["three_points"]


def test_curve_is_written_and_goes_on_where_it_was(curve):
    folder, summary = curve
    before = {path: path.stat().st_mtime_ns for path in (folder / "cells").iterdir()}
    dropped = min(before)
    text = json.loads(dropped.read_text())
    dropped.unlink()
    assert run_curve(folder) == summary
    again = json.loads(dropped.read_text())
    for row in (*text["rows"], *again["rows"]):
        row.pop("seconds")
    assert text == again
    kept = {path: path.stat().st_mtime_ns for path in (folder / "cells").iterdir()}
    assert {path for path in before if before[path] == kept[path]} == set(before) - {dropped}
    with (folder / "learning_curve.csv").open() as file:
        assert len(list(csv.DictReader(file))) == 8
    assert (folder / "learning_curve.png").read_bytes().startswith(b"\x89PNG")
    assert "0.911 ± 0.189" in (folder / "README.md").read_text()


def test_all_rules_search_the_same_set(tmp_path):
    settings = SearchMethodsSettings((1,), (1, 2), runs=1, iterations=(40,))
    results = run_experiment(search_methods.run, "search-methods", settings, tmp_path)
    final = results.tables["final.csv"]
    assert [row["method"] for row in final] == 2 * [*UPDATE_RULES, "bounded_adaptive_random"]
    assert {row["parameters"] for row in final} == {14}
    with (tmp_path / "curves.csv").open() as file:
        rows = list(csv.DictReader(file))
    for method in UPDATE_RULES:
        line = [float(r["J"]) for r in rows if (r["method"], r["samples"]) == (method, "2")]
        assert line == sorted(line, reverse=True)
    random = [r["J"] for r in final if r["method"] == "random"]
    grid = [r["J"] for r in final if r["method"] == "grid"]
    # A grid has not left its corner after 40 of 20^14 points.
    assert all(a < b for a, b in zip(random, grid, strict=True))


def test_evaluations_are_one_number_for_all_sizes_or_one_for_each():
    assert SearchMethodsSettings().iterations_of(1) == 2000
    assert SearchMethodsSettings().iterations_of(20) == 500
    assert SearchMethodsSettings((1, 5), iterations=(70,)).iterations_of(5) == 70
    with pytest.raises(InvalidInputError, match="3 numbers of iterations for 1 sizes"):
        SearchMethodsSettings((1,))


def test_predictions_of_test_runs(tmp_path):
    settings = PredictionExperimentSettings(2, 5, 3, iterations=60)
    results = run_experiment(prediction.run, "prediction", settings, tmp_path)
    rows = results.tables["predictions.csv"]
    # Four fifths of 5 of 8 throws are learned from; the other runs count with all their objects.
    runs = _runs(2, 8)
    assert len({row["case"].split(":")[0] for row in rows}) == runs - round(0.8 * 5 / 8 * runs)
    with (tmp_path / "coverage.csv").open() as file:
        shares = [float(row["seen"]) for row in csv.DictReader(file)]
    assert shares == sorted(shares)
    assert all(0.0 <= share <= 1.0 for share in shares)
    for name in ("predictions.png", "error_over_time.png"):
        assert (tmp_path / name).read_bytes().startswith(b"\x89PNG")
    again = run_experiment(prediction.run, "prediction", settings, tmp_path)
    assert again.tables == results.tables


def _runs(objects: int, samples: int) -> int:
    made = make_paper_dataset(objects, samples, np.random.default_rng(0))
    return len(made.training) + len(made.test)


@pytest.mark.long
def test_thrown_balls_through_the_whole_pipeline(tmp_path):
    settings = RgbdSettings(throws=2, duration=1.2, iterations=300)
    rows = run_experiment(rgbd.run, "rgbd", settings, tmp_path).tables["errors_by_size.csv"]
    assert {row["radius"] for row in rows} == {0.03, 0.05, 0.07}
    assert sum(row["observations"] for row in rows) >= 5
    learned, true, default = (
        np.mean([row[name] for row in rows]) for name in ("learned", "true_parameters", "default")
    )
    # Fitted to what was seen: as good as the truth, up to what the search left; 3 mm is the camera.
    assert learned < 1.2 * true + 0.003
    assert default > 2.0 * learned
    for name in ("seen.png", "errors_by_size.png", "predictions.png"):
        assert (tmp_path / name).read_bytes().startswith(b"\x89PNG")


def test_dataset_command_writes_what_learn_reads(tmp_path, capsys):
    output = tmp_path / "set"
    assert main(["experiment", "dataset", str(output), "--objects", "2", "--samples", "3"]) == 0
    assert "2 objects, 3 trajectories of each" in capsys.readouterr().out
    truth = json.loads((output / "ground_truth.json").read_text())
    files = sorted((output / "training").iterdir()) + sorted((output / "test").iterdir())
    observations = [load_observation(path) for path in files]
    assert {observation.id for observation in observations} == {
        run["observation"] for run in truth["runs"]
    }
    with (output / "trajectories.csv").open() as file:
        points = list(csv.DictReader(file))
    assert len(points) == 2 * 3 * 151
    assert main(["experiment", "dataset", str(output)]) == 1
    assert "exists already" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["learning-curve", "OUT", "--repetitions", "0"], "--repetitions is 0"),
        (["learning-curve", "OUT", "--samples", "5", "-1"], "--samples is"),
        (["search-methods", "OUT", "--seed", "-1"], "seed is -1"),
        (["dataset", "OUT", "--engine", "havok"], "engine of the set is 'havok'"),
    ],
)
def test_what_cannot_be_done_is_refused(tmp_path, capsys, arguments, complaint):
    filled = [str(tmp_path / "out") if word == "OUT" else word for word in arguments]
    assert main(["experiment", *filled]) == 1
    assert complaint in capsys.readouterr().err


@pytest.mark.parametrize("experiment", EXPERIMENTS, ids=lambda experiment: experiment.name)
def test_each_subcommand_has_a_module_and_quick_settings(experiment):
    assert callable(import_module(experiment.module).run)
    assert experiment.settings(**experiment.settings.quick) != experiment.settings()
