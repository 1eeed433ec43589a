"""Predictions beside what was seen, after the paper's Figs. 1 and 5."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_cli.evaluation.prediction_case import PredictionCase
from intuitive_physics_cli.evaluation.prediction_coverage import LEVELS
from intuitive_physics_cli.report.figure_style import DEFAULT, GRAVITY, OBSERVED, PREDICTED

COLUMNS = 3
ERROR_LINES = 40


def draw_predictions(figure: Any, cases: Sequence[PredictionCase]) -> None:
    """Samples in thin blue, what was seen in green, the error at some points in red."""
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


def draw_error_over_time(
    figure: Any, cases: Sequence[PredictionCase], shares: NDArray[np.float64]
) -> None:
    """Mean error and spread over time, and coverage.

    Parameters
    ----------
    cases : seen at the same times
    shares : of `region_coverage`
    """
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
