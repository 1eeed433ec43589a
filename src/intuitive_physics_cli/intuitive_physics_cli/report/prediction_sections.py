"""Sections of a report about predictions: the worst first, and whether their spread is honest."""

from __future__ import annotations

import html
from collections.abc import Sequence

import numpy as np

from intuitive_physics_cli.evaluation.prediction_case import PredictionCase
from intuitive_physics_cli.evaluation.prediction_coverage import LEVELS, region_coverage
from intuitive_physics_cli.report.report_page import table
from intuitive_physics_cli.report.report_plots import coverage_plot, prediction_plot

MOST_SHOWN = 6
TOLD_LEVELS = (0.5, 0.9)


def prediction_sections(cases: Sequence[PredictionCase], noise: float, title: str) -> list[str]:
    """Return sections of the worst cases, of all cases, and of calibration; none without cases.

    Parameters
    ----------
    noise : m, standard deviation of a point that was seen
    title : what the cases are, plain text
    """
    if not cases:
        return []
    worst = sorted(cases, key=lambda case: -case.error)
    shown = [
        f"<h3>{html.escape(case.name)}: {case.error:.3f} m</h3>"
        + prediction_plot(f"case-{number}", case)
        for number, case in enumerate(worst[:MOST_SHOWN])
    ]
    return [
        f"<h2>{html.escape(title)}: the worst first</h2>"
        f"<p>The {len(shown)} worst of {len(cases)}; the number is the mean distance between the "
        "mean of the prediction and what was seen. Drag to turn, scroll to come nearer.</p>",
        *shown,
        _all_cases(worst),
        *_calibration(cases, noise),
    ]


def _all_cases(worst: Sequence[PredictionCase]) -> str:
    rows = [
        (
            case.name,
            f"{case.times[-1]:.2f}",
            f"{case.error:.3f}",
            f"{case.distances[-1]:.3f}",
            f"{case.spread.mean():.3f}",
        )
        for case in worst
    ]
    header = ("", "seen for (s)", "mean error (m)", "last error (m)", "mean spread (m)")
    return table(header, rows)


def _calibration(cases: Sequence[PredictionCase], noise: float) -> list[str]:
    shares = region_coverage(cases, noise, np.random.default_rng(0))
    told = ", ".join(
        f"those that claim {100.0 * level:.0f} % hold "
        f"{100.0 * shares[int(np.abs(LEVELS - level).argmin())]:.0f} %"
        for level in TOLD_LEVELS
    )
    return [
        "<h2>Is the spread honest?</h2>"
        f"<p>How many of the points that were seen lie in the regions of the predictions: {told}. "
        "Below the dashed line predictions are too sure of themselves, above it too cautious.</p>",
        coverage_plot("coverage", shares),
    ]
