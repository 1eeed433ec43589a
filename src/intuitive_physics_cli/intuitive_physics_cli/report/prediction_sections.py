"""Sections of a report about predictions: the worst first, and whether their spread is honest."""

from __future__ import annotations

import html
from collections.abc import Sequence

import numpy as np

from intuitive_physics_cli.evaluation.prediction_case import PredictionCase
from intuitive_physics_cli.evaluation.prediction_coverage import LEVELS, region_coverage
from intuitive_physics_cli.report.report_page import section, side_by_side, table
from intuitive_physics_cli.report.report_plots import SMALL_PLOT, coverage_plot, prediction_plot

MOST_SHOWN = 6
"""Cases with a plot of their own."""

SUMMARY_LEVELS = (0.5, 0.9)
"""Regions whose coverage the text states."""


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
        f"<h3>{html.escape(case.name)}: {100.0 * case.error:.1f} cm</h3>"
        + prediction_plot(f"case-{number}", case, SMALL_PLOT)
        for number, case in enumerate(worst[:MOST_SHOWN])
    ]
    return [
        section(
            f"{title}: the worst first",
            side_by_side(shown),
            _all_cases(worst),
            introduction=f"The {len(shown)} worst of {len(cases)}; the number is the mean distance "
            "between the mean of the prediction and what was seen. Drag to turn, scroll to zoom.",
        ),
        _calibration(cases, noise),
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


def _calibration(cases: Sequence[PredictionCase], noise: float) -> str:
    shares = region_coverage(cases, noise, np.random.default_rng(0))
    claims = ", ".join(
        f"those that claim {100.0 * level:.0f} % hold "
        f"{100.0 * shares[int(np.abs(LEVELS - level).argmin())]:.0f} %"
        for level in SUMMARY_LEVELS
    )
    return section(
        "Is the spread honest?",
        coverage_plot("coverage", shares),
        introduction="How many of the points that were seen lie in the regions of the predictions: "
        f"{claims}. Below the dashed line predictions are too confident, above it too cautious.",
    )
