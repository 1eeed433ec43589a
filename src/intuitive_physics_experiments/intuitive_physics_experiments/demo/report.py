"""The demo's report: one self-contained page, and one picture for the README."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.materials import PAIR_COEFFICIENTS
from intuitive_physics_cli.evaluation.prediction_case import PredictionCase
from intuitive_physics_cli.report.learning_report import STATE_KNOWN, prediction_sections
from intuitive_physics_cli.report.report_page import (
    footer,
    heading,
    page,
    parameter_section,
    png,
    png_figure,
    section,
    table,
)
from intuitive_physics_cli.report.report_plots import cost_plot, library_script, prediction_plot
from intuitive_physics_experiments.demo.demo_result import (
    DemoResult,
    LearningOutcome,
    PredictionOutcome,
    ThrowErrors,
)
from intuitive_physics_experiments.demo.figures import (
    draw_coefficient,
    draw_cost,
    draw_frame,
    draw_prediction_3d,
    parameter_legend,
)

PAGE_NAME, PICTURE_NAME = "report.html", "demo.png"  # Files of the report in its folder
TITLE = "Balls thrown, seen, learned from and predicted"  # Heading of the page
# What the page is about.
INTRODUCTION = (
    "A rendered depth camera watched balls thrown into a corner. From what it saw, the material "
    "parameters were learned that make a simulation do the same; then one more throw was predicted."
)


@dataclass(frozen=True)
class ReportPaths:
    """Files of a written report."""

    page: Path  # self-contained HTML
    picture: Path  # PNG


def write_report(result: DemoResult, folder: Path) -> ReportPaths:
    """Write page and picture into a folder, which is made where it is missing."""
    paths = ReportPaths(folder / PAGE_NAME, folder / PICTURE_NAME)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        picture = png((13.0, 9.4), lambda figure: _draw_picture(figure, result), result.about)
        paths.picture.write_bytes(picture)
        paths.page.write_text(_page(result), encoding="utf-8")
    except OSError as error:
        raise InvalidInputError(f"cannot write the report into {folder}: {error}") from None
    return paths


def _page(result: DemoResult) -> str:
    prediction, learning = result.prediction, result.learning
    levels = {
        "default parameters": learning.default_cost,
        "true parameters": learning.oracle_cost,
    }
    sections = [
        section(
            "What the camera saw",
            png_figure(
                (11.0, 8.0),
                lambda figure: draw_frame(figure.add_subplot(), result.example),
                "A depth frame (missing readings are white) with the planes that were found, the "
                "ball, its track over the whole throw, and the direction of gravity.",
            ),
        ),
        section(
            "What was learned",
            parameter_section(learning.learned, learning.true),
            introduction="Coefficients of each pair of materials that touched.",
        ),
        section(
            "How the cost fell",
            cost_plot("cost", learning.cost_history, levels),
            introduction="J is the mean distance between simulated and observed trajectories. "
            "Below the line of the true parameters there is only noise to be learned.",
        ),
        section(
            "What was predicted, and what then happened",
            prediction_plot("unseen", _as_case(prediction)),
            introduction=f"A {prediction.material} ball of {100.0 * prediction.radius:.0f} cm "
            "radius that was not learned from: simulations from noisy copies of its perceived "
            "state, and where it was seen afterwards. Drag to turn, scroll to zoom.",
        ),
        *prediction_sections(
            result.predicted,
            "Throws, each predicted before it was learned from",
            "Each throw was predicted with what the throws before it had taught, of which the "
            "parameters were learned after 1, 2, 4, 8 … of them; nothing of them was known of the "
            f"first. {STATE_KNOWN}",
        ),
        section("Every throw", _throw_table(result.throws)),
    ]
    head = heading(TITLE, INTRODUCTION, result.summary)
    return page("Intuitive physics: demo", library_script(), head, sections, footer(result.about))


def _as_case(prediction: PredictionOutcome) -> PredictionCase:
    """The prediction at the times at which the ball was seen after it."""
    times, seen_at = prediction.times, prediction.observed_times
    inside = (seen_at >= times[0]) & (seen_at <= times[-1])
    samples = np.stack(
        [
            np.column_stack([np.interp(seen_at[inside], times, axis) for axis in sample.T])
            for sample in prediction.samples
        ]
    )
    return PredictionCase(
        name="the throw that was predicted",
        environment=prediction.environment,
        radius=prediction.radius,
        times=seen_at[inside],
        samples=samples,
        observed=prediction.observed[inside],
        covariances=np.zeros((int(inside.sum()), 3, 3)),
    )


def _throw_table(throws: Sequence[ThrowErrors]) -> str:
    header = (
        "throw",
        "material",
        "radius (cm)",
        "seen",
        "perception RMSE (mm)",
        "D̄ learned (mm)",
        "D̄ true θ (mm)",
        "D̄ defaults (mm)",
    )
    rows = [
        (
            throw.name,
            throw.material,
            f"{100.0 * throw.radius:.0f}",
            str(throw.points),
            f"{1000.0 * throw.perception_rmse:.1f}",
            f"{1000.0 * throw.learned_distance:.0f}",
            f"{1000.0 * throw.oracle_distance:.0f}",
            f"{1000.0 * throw.default_distance:.0f}",
        )
        for throw in sorted(throws, key=lambda throw: -throw.learned_distance)
    ]
    return (
        f"{table(header, rows)}<p>The worst first. D̄ is the mean distance between the simulated "
        "and the observed trajectory of a throw, under the learned, the true and the default "
        "parameters.</p>"
    )


def _draw_parameters(figure: Any, learning: LearningOutcome) -> None:
    grid = figure.add_gridspec(2, 4, height_ratios=(1.0, 0.05))
    first = figure.add_subplot(grid[0, 0])
    others = [figure.add_subplot(grid[0, k], sharey=first) for k in (1, 2, 3)]
    for axes, coefficient in zip([first, *others], PAIR_COEFFICIENTS, strict=True):
        draw_coefficient(axes, learning, coefficient)
        axes.tick_params(axis="y", labelleft=axes is first)
    below = figure.add_subplot(grid[1, :])
    below.set_axis_off()
    below.legend(handles=parameter_legend(), loc="center", ncols=3)


def _draw_picture(figure: Any, result: DemoResult) -> None:
    top, bottom = figure.subfigures(2, 1, height_ratios=(1.65, 1.0))
    seen, predicted = top.subfigures(1, 2, width_ratios=(1.12, 1.0))
    cost, parameters = bottom.subfigures(1, 2, width_ratios=(1.0, 1.55))
    draw_frame(_titled(seen, "seen by a depth camera").add_subplot(), result.example)
    draw_prediction_3d(
        _titled(predicted, "predicted, and what then happened").add_subplot(projection="3d"),
        result.prediction,
    )
    draw_cost(_titled(cost, "cost while learning").add_subplot(), result.learning)
    _draw_parameters(_titled(parameters, "learned against true"), result.learning)


def _titled(figure: Any, title: str) -> Any:
    figure.suptitle(title, x=0.02, ha="left", fontsize=12, weight="bold")
    return figure
