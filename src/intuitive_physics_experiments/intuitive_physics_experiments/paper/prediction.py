"""Figs. 1 and 5: noisy-Newton predictions of test runs from their first three points."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.observation import Observation
from intuitive_physics.simulation import Simulator, make_simulator
from intuitive_physics_cli.evaluation.prediction_case import (
    LEVELS,
    PredictionCase,
    predict_cases,
    region_coverage,
)
from intuitive_physics_cli.report.figure_style import DEFAULT, GRAVITY, OBSERVED, PREDICTED
from intuitive_physics_experiments.paper.paper_dataset import (
    TRAINING_SHARE,
    make_paper_dataset,
)
from intuitive_physics_experiments.paper.settings import PredictionExperimentSettings
from intuitive_physics_experiments.results import CellStore, Figure, Results, Row, markdown_table
from intuitive_physics_learner.cost.cost_function import TrajectoryCost
from intuitive_physics_learner.learning_session import LearningOptions, learn
from intuitive_physics_learner.methods import JOINT_METHOD
from intuitive_physics_learner.search.parameter_search import ConvergenceCriteria
from intuitive_physics_predictor.parameter_uncertainty import UncertainParameters

COLUMNS = 3  # Columns of the figure, one example in each
ERROR_LINES = 40  # Lines from predicted to observed points in one example


def draw_predictions(figure: Any, cases: Sequence[PredictionCase]) -> None:
    """Draw samples in thin blue, what was seen in green, the error at some points in red."""
    from matplotlib.ticker import MaxNLocator

    rows = -(-len(cases) // COLUMNS)
    for number, case in enumerate(cases, start=1):
        axes = figure.add_subplot(rows, COLUMNS, number, projection="3d")
        for sample in case.samples:
            axes.plot(*sample.T, color=PREDICTED, lw=0.6, alpha=0.35)
        mean = case.mean
        for k in np.unique(np.linspace(0, len(mean) - 1, ERROR_LINES).astype(int)):
            axes.plot(*np.stack([mean[k], case.observed[k]]).T, color=GRAVITY, lw=0.7, alpha=0.6)
        axes.plot(*case.observed.T, color=OBSERVED, lw=2.2)
        axes.set_title(f"{case.error:.2f} m", loc="left", fontsize=10, weight="normal")
        axes.set(xlabel="x (m)", ylabel="y (m)", zlabel="z (m)")
        axes.set_aspect("equal")
        for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
            axis.set_major_locator(MaxNLocator(4))


def _draw_error_over_time(
    figure: Any, cases: Sequence[PredictionCase], shares: NDArray[np.float64]
) -> None:
    """Draw mean error and spread over time, and the coverage (19,) of `region_coverage`."""
    left, right = figure.subplots(1, 2, width_ratios=(1.6, 1.0))
    times = cases[0].times
    left.plot(
        times,
        np.mean([case.distances for case in cases], axis=0),
        color=PREDICTED,
        label="error of the mean",
    )
    left.plot(
        times, np.mean([case.spread for case in cases], axis=0), color=DEFAULT, label="spread"
    )
    left.set(xlabel="time (s)", ylabel="distance (m)", ylim=(0.0, None))
    left.grid(axis="y")
    left.legend()
    right.plot([0, 1], [0, 1], color=DEFAULT, ls="--", lw=1.0)
    right.plot(LEVELS, shares, "o-", color=PREDICTED, ms=3)
    right.set(xlabel="share a region claims", ylabel="share of points in it")
    right.set_aspect("equal")


# Where initial states come from, and how many predictions are drawn.
FIRST, EXAMPLES = "three_points", 6


def run(settings: PredictionExperimentSettings, store: CellStore) -> Results:
    """Learn, and predict the test runs."""
    simulator = make_simulator("auto", store.cores)
    rng = np.random.default_rng(settings.seed)
    throws = settings.samples + settings.further
    dataset = make_paper_dataset(settings.objects, throws, rng, initial_states=FIRST)
    count = max(round(TRAINING_SHARE * settings.samples / throws * len(dataset.observations)), 1)
    training, test = dataset.observations[:count], dataset.observations[count:]
    materials = dataset.parameters.materials
    cells = store.run({"learned": lambda: _learned(settings, training, materials, simulator)}, 1)
    learned = LearnedParameters.from_dict(cells["learned"])
    cases = predict_cases(
        test,
        UncertainParameters(learned),
        simulator,
        np.random.default_rng([settings.seed, 1]),
        settings.sample_count,
    )
    shares = region_coverage(cases, np.random.default_rng([settings.seed, 2]))
    coverage = [
        {"claimed": float(level), "seen": float(share)}
        for level, share in zip(LEVELS, shares, strict=True)
    ]
    ordered = sorted(cases, key=lambda case: case.error)
    shown = [ordered[k] for k in np.linspace(0, len(ordered) - 1, EXAMPLES).round().astype(int)]
    test_cost = float(TrajectoryCost(test, simulator, materials).costs([learned.parameters])[0])
    over_time = partial(_draw_error_over_time, cases=cases, shares=shares)
    return Results(
        "Predictions (Figs. 1 and 5)",
        _body(settings, cases, test_cost, shares),
        {"predictions.csv": [_row(case) for case in cases], "coverage.csv": coverage},
        {
            "predictions.png": Figure((12.0, 8.0), partial(draw_predictions, cases=shown)),
            "error_over_time.png": Figure((9.0, 3.6), over_time),
        },
    )


def _learned(
    settings: PredictionExperimentSettings,
    training: Sequence[Observation],
    materials: Sequence[str],
    simulator: Simulator,
) -> dict[str, Any]:
    options = LearningOptions(
        method=JOINT_METHOD,
        criteria=ConvergenceCriteria(max_iterations=settings.iterations),
        seed=settings.seed,
    )
    return learn(training, simulator, options).learned.extended(materials).to_dict()


def _row(case: PredictionCase) -> Row:
    return {
        "case": case.name,
        "mean_error": case.error,
        "last_error": float(case.distances[-1]),
        "mean_spread": float(case.spread.mean()),
    }


def _body(
    settings: PredictionExperimentSettings,
    cases: Sequence[PredictionCase],
    cost: float,
    shares: NDArray[np.float64],
) -> str:
    rows = []
    for instant in (0.5, 1.0, 2.0, 5.0):
        nearest = [(case, int(np.abs(case.times - instant).argmin())) for case in cases]
        error = np.mean([case.distances[k] for case, k in nearest])
        spread = np.mean([case.spread[k] for case, k in nearest])
        rows.append([f"{instant:g}", f"{error:.3f}", f"{spread:.3f}"])
    header = ["time (s)", "error of the mean (m)", "spread (m)"]
    errors_of_mean = np.mean([case.error for case in cases])
    half, most = (100 * shares[np.abs(LEVELS - level).argmin()] for level in (0.5, 0.9))
    return (
        f"{len(cases)} trajectories of test runs, each predicted for 5 s from its first three "
        f"points by {settings.sample_count} samples. Mean distance of the predicted mean from "
        f"what was seen: {errors_of_mean:.3f} m; of the single simulation from the estimated "
        f"state (J): {cost:.3f} m. Spread: root of the mean squared distance of the samples from "
        f"their mean. Of what was seen, the 50 % regions held {half:.0f} % and the 90 % regions "
        f"{most:.0f} %.\n\n{markdown_table(header, rows)}\n\n![Predictions, from the best to the "
        "worst](predictions.png)\n\n![Error over time and calibration](error_over_time.png)"
    )
