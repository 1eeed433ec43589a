"""Reliability, coverage against horizon, scores against baselines, error against points seen."""

from __future__ import annotations

from typing import Any

import numpy as np

from intuitive_physics_cli.report.figure_style import (
    DEFAULT,
    GRAVITY,
    OBSERVED,
    PLANE_COLORS,
    PREDICTED,
    TRUE,
)
from intuitive_physics_experiments.calibration.calibrate import OURS, Calibration
from intuitive_physics_experiments.calibration.tables import LEVELS
from intuitive_physics_experiments.calibration.verification import REGIONS, Scores

HORIZON_COLORS = (PREDICTED, OBSERVED, PLANE_COLORS[0], GRAVITY)
BASELINE_COLORS = (DEFAULT, PLANE_COLORS[0], PLANE_COLORS[3], PLANE_COLORS[4])


def draw_reliability(axes: Any, calibration: Calibration) -> None:
    """Draw how often regions of each probability held what happened; true ones lie on the line."""
    axes.plot([0, 1], [0, 1], color=TRUE, lw=1.0, ls=":")
    scores = calibration.scores[OURS]
    covered = np.array([scores.coverage(level) for level in LEVELS])
    for h, horizon in enumerate(calibration.horizons):
        color = HORIZON_COLORS[h % len(HORIZON_COLORS)]
        axes.plot(LEVELS, covered[:, h], color=color, lw=1.6, label=f"{horizon:g} s")
    axes.set(xlabel="probability of the region", ylabel="share of outcomes inside")
    axes.set(xlim=(0, 1), ylim=(0, 1), aspect="equal")
    axes.grid()
    axes.legend(loc="upper left")


def draw_coverage(axes: Any, calibration: Calibration) -> None:
    """Draw coverage against horizon, with the error bars that so many outcomes have."""
    scores = calibration.scores[OURS]
    for probability, color in zip(REGIONS, (OBSERVED, PREDICTED), strict=True):
        covered = scores.coverage(probability)
        count = (~np.isnan(scores.energy)).sum(axis=0)
        error = np.sqrt(np.maximum(covered * (1 - covered), 1e-12) / np.maximum(count, 1))
        axes.axhline(probability, color=color, lw=1.0, ls=":")
        axes.errorbar(
            calibration.horizons,
            covered,
            yerr=error,
            color=color,
            marker="o",
            ms=4,
            lw=1.6,
            label=f"{100 * probability:.0f} % region",
        )
    axes.axhspan(0.85, 0.95, color=PREDICTED, alpha=0.08, lw=0)
    axes.set(xlabel="horizon (s)", ylabel="share of outcomes inside", ylim=(0, 1.02))
    axes.grid(axis="y")
    axes.legend(loc="lower right")


def draw_scores(axes: Any, calibration: Calibration) -> None:
    """Draw energy scores against horizon, ours and the baselines'."""
    colors = iter(BASELINE_COLORS)
    for name, scores in calibration.scores.items():
        ours = name == OURS
        axes.plot(
            calibration.horizons,
            np.nanmean(scores.energy, axis=0),
            color=PREDICTED if ours else next(colors),
            marker="o",
            ms=4,
            lw=2.4 if ours else 1.3,
            label=name,
        )
    axes.set(xlabel="horizon (s)", ylabel="energy score (m)", yscale="log")
    axes.grid(axis="y", which="both")
    axes.legend(loc="lower right")


def draw_errors_by_points(axes: Any, by_points: dict[int, Scores], horizons: Any) -> None:
    """Draw the error of the mean prediction against how many points were seen."""
    points = list(by_points)
    errors = np.array([np.nanmean(scores.error, axis=0) for scores in by_points.values()])
    for h, horizon in enumerate(horizons):
        color = HORIZON_COLORS[h % len(HORIZON_COLORS)]
        axes.plot(points, errors[:, h], color=color, marker="o", ms=4, label=f"{horizon:g} s")
    axes.set(xlabel="points seen", ylabel="error of the mean (m)", yscale="log", xticks=points)
    axes.grid(axis="y", which="both")
    axes.legend(loc="upper right")
