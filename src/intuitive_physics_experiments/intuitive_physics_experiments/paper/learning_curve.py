"""Fig. 4: training and test error over numbers of objects and of samples of each object.

Beside what was learned stand the true θ_s on the same noisy initial states (the oracle: what is
left is noise that no learner can remove) and the default θ_s (no learning).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from intuitive_physics.materials import StaticParameters
from intuitive_physics.observation import Observation, observation_materials
from intuitive_physics.parameter_space import ParameterSpace
from intuitive_physics.simulation import Simulator, make_simulator
from intuitive_physics_cli.report.figure_style import DEFAULT, OBSERVED, PREDICTED, TRUE
from intuitive_physics_experiments.paper.paper_dataset import PaperDataset, make_paper_dataset
from intuitive_physics_experiments.paper.settings import LearningCurveSettings
from intuitive_physics_experiments.results import (
    Cell,
    CellStore,
    Figure,
    Results,
    Row,
    markdown_table,
)
from intuitive_physics_learner.cost.cost_function import TrajectoryCost
from intuitive_physics_learner.cost.parameter_influence import parameter_influence
from intuitive_physics_learner.methods import make_search
from intuitive_physics_learner.search.learning_task import LearningTask
from intuitive_physics_learner.search.parameter_search import ConvergenceCriteria

PAPER_ERROR, PAPER_DEVIATION = 0.911, 0.189  # m, mean test error and its σ (Sec. IV-D)

# Titles of the figure's parts, by where initial states come from.
SOURCE_TITLES = {
    "three_points": "initial states from 3 points, as in the paper",
    "flight": "initial states from all points before the first bounce",
    "true": "true initial states",
}


def _draw(figure: Any, summary: Sequence[Row]) -> None:
    """Draw bars of training and test error of each set, a panel by source of initial states."""
    sources = list(dict.fromkeys(line["first_states"] for line in summary))
    panels = np.atleast_1d(figure.subplots(1, len(sources), sharey=True))
    for axes, source in zip(panels, sources, strict=True):
        lines = [line for line in summary if line["first_states"] == source]
        _draw_panel(axes, lines)
        axes.set_title(SOURCE_TITLES[source], loc="left", fontsize=10, weight="normal")
    panels[0].set_ylabel("J (m)")
    panels[-1].legend(loc="upper right")


def _draw_panel(axes: Any, lines: Sequence[Row]) -> None:
    places = np.arange(len(lines))
    axes.axhspan(
        PAPER_ERROR - PAPER_DEVIATION, PAPER_ERROR + PAPER_DEVIATION, color="#fde68a", alpha=0.5
    )
    axes.axhline(PAPER_ERROR, color="#d97706", lw=1.0, label="paper's test error ± σ")
    for offset, part, color in ((-0.18, "training", PREDICTED), (0.18, "test", OBSERVED)):
        axes.bar(
            places + offset,
            [line[f"learned_{part}"] for line in lines],
            0.34,
            yerr=[line[f"learned_{part}_deviation"] for line in lines],
            color=color,
            alpha=0.75,
            error_kw={"lw": 1.0, "ecolor": "#374151"},
            label=f"learned, {part}",
        )
    for name, color, marker in (("oracle", TRUE, "_"), ("default", DEFAULT, "x")):
        values = [line[f"{name}_test"] for line in lines]
        axes.plot(places + 0.18, values, marker, color=color, ms=9, mew=1.8, label=f"{name}, test")
    labels = [f"{line['objects']} × {line['samples']}" for line in lines]
    axes.set_xticks(places, labels, rotation=40, ha="right")
    axes.set_xlabel("objects × samples of each")
    axes.grid(axis="y")
    axes.set_axisbelow(True)


# Whose errors are compared: learned, true and default parameters.
ERRORS = ("learned", "oracle", "default")


def run(settings: LearningCurveSettings, store: CellStore) -> Results:
    """Learn from each set."""
    cells = store.run(_cells(settings, make_simulator("auto")))
    rows = [row for cell in cells.values() for row in cell["rows"]]
    summary = _summary(rows)
    return Results(
        "Learning curve (Fig. 4)",
        _body(settings, summary),
        {"learning_curve.csv": rows, "summary.csv": summary},
        {"learning_curve.png": Figure((11.0, 4.2), partial(_draw, summary=summary))},
    )


def _cells(settings: LearningCurveSettings, simulator: Simulator) -> dict[str, Cell]:
    cells: dict[str, Cell] = {}
    for objects in settings.objects:
        for samples in settings.samples:
            for repetition in range(settings.repetitions):
                name = f"{objects:02d}_objects_{samples:03d}_samples_{repetition:02d}"
                cells[name] = partial(_cell, settings, simulator, objects, samples, repetition)
    return cells


def _cell(
    settings: LearningCurveSettings,
    simulator: Simulator,
    objects: int,
    samples: int,
    repetition: int,
) -> Row:
    rng = np.random.default_rng([settings.seed, objects, samples, repetition])
    drawn = make_paper_dataset(objects, samples, rng, engine=settings.engine)
    rows = []
    for source in settings.initial_states:
        dataset = drawn.with_initial_states(source)
        learned, seconds = _learn(settings, simulator, dataset, repetition)
        judged = [
            learned,
            dataset.parameters,
            StaticParameters.uniform(dataset.parameters.materials),
        ]
        training = _costs(dataset.training_observations, simulator, judged)
        test = _costs(dataset.test_observations, simulator, judged)
        row: Row = {
            "first_states": source,
            "objects": objects,
            "samples": samples,
            "repetition": repetition,
            "training_runs": len(dataset.training),
            "test_runs": len(dataset.test),
            "seconds": seconds,
        }
        for name, on_training, on_test in zip(ERRORS, training, test, strict=True):
            row[f"{name}_training"] = on_training
            row[f"{name}_test"] = on_test
        rows.append(row)
    return {"rows": rows}


def _learn(
    settings: LearningCurveSettings, simulator: Simulator, dataset: PaperDataset, repetition: int
) -> tuple[StaticParameters, float]:
    observations = dataset.training_observations
    materials = observation_materials(observations)
    task = LearningTask(
        TrajectoryCost(observations, simulator, materials),
        ParameterSpace(materials),
        parameter_influence(observations, materials),
        StaticParameters.uniform(materials),
    )
    generator = np.random.default_rng(settings.seed + repetition)
    search = make_search(settings.method, task, generator)
    result = search.run(ConvergenceCriteria(max_iterations=settings.iterations))
    return result.parameters.extended(dataset.parameters.materials), result.seconds


def _costs(
    observations: Sequence[Observation], simulator: Simulator, judged: Sequence[StaticParameters]
) -> list[float]:
    cost = TrajectoryCost(observations, simulator, judged[0].materials)
    return [float(value) for value in cost.costs(judged)]


def _summary(rows: Sequence[Row]) -> list[Row]:
    """Mean and standard deviation over the repetitions, a row for each set and source."""
    keys = dict.fromkeys((row["first_states"], row["objects"], row["samples"]) for row in rows)
    summary = []
    for source, objects, samples in keys:
        same = [
            row
            for row in rows
            if (row["first_states"], row["objects"], row["samples"]) == (source, objects, samples)
        ]
        line: Row = {
            "first_states": source,
            "objects": objects,
            "samples": samples,
            "repetitions": len(same),
        }
        for name in ERRORS:
            for part in ("training", "test"):
                values = np.array([row[f"{name}_{part}"] for row in same])
                line[f"{name}_{part}"] = float(values.mean())
                line[f"{name}_{part}_deviation"] = float(values.std())
        summary.append(line)
    return summary


def _body(settings: LearningCurveSettings, summary: Sequence[Row]) -> str:
    rows = [
        [
            line["first_states"],
            str(line["objects"]),
            str(line["samples"]),
            *(
                f"{line[f'{name}_{part}']:.3f} ± {line[f'{name}_{part}_deviation']:.3f}"
                for name in ERRORS
                for part in ("training", "test")
            ),
        ]
        for line in summary
    ]
    header = ["initial states", "objects", "samples"]
    header += [f"{name}, {part} (m)" for name in ERRORS for part in ("training", "test")]
    tests = [line["learned_test"] for line in summary if line["first_states"] == "three_points"]
    ours = (
        f" Ours with the paper's initial states: {np.mean(tests):.3f} ± {np.std(tests):.3f} m."
        if tests
        else ""
    )
    return (
        f"Mean ± σ of J over {settings.repetitions} sets of each kind, moved by "
        f"`{settings.engine}`, {settings.iterations} iterations of `{settings.method}`. "
        "Oracle: the true θ_s from the same noisy initial states. Default: nothing learned. "
        f"The paper's test error over its sets is 0.911 ± 0.189 m.{ours} How far objects are "
        "thrown and how they bounce is not in the paper, so the metres of the two sets are not "
        "the same metres; what learning gains between default and oracle is.\n\n"
        f"{markdown_table(header, rows)}\n\n![Learning curve](learning_curve.png)"
    )
