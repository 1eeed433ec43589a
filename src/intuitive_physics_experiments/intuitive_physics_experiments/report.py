"""The demo's report: one self-contained page, and one picture for the README."""

from __future__ import annotations

import base64
import html
import io
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.materials import parameter_names
from intuitive_physics.parameter_space import parameter_vector
from intuitive_physics_experiments.demo_result import DemoResult, LearningOutcome, ThrowErrors
from intuitive_physics_experiments.figure_style import STYLE
from intuitive_physics_experiments.frame_figure import draw_frame
from intuitive_physics_experiments.learning_figures import (
    draw_cost,
    draw_parameters,
    parameter_legend,
)
from intuitive_physics_experiments.prediction_figures import (
    draw_prediction_3d,
    draw_prediction_error,
    draw_prediction_side,
)

PAGE_NAME, PICTURE_NAME = "report.html", "demo.png"
RESOLUTION = 150

PAGE_STYLE = """
body { font: 16px/1.55 system-ui, sans-serif; color: #111827; max-width: 62rem;
       margin: 0 auto; padding: 2.5rem 1.5rem; }
h1 { font-size: 1.9rem; margin: 0 0 .3rem; }
h2 { font-size: 1.25rem; margin: 2.6rem 0 .5rem; }
p, figcaption { color: #4b5563; max-width: 46rem; }
figure { margin: 1rem 0; }
img { max-width: 100%; height: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: .93rem; }
th, td { padding: .32rem .9rem .32rem 0; text-align: right; border-bottom: 1px solid #e5e7eb; }
th { color: #6b7280; font-weight: 600; }
th:first-child, td:first-child { text-align: left; }
tr.unknown td { color: #9ca3af; }
.numbers { display: flex; flex-wrap: wrap; gap: 1rem 2.4rem; margin: 1.6rem 0 0; }
.numbers div { font-size: 1.5rem; font-weight: 650; }
.numbers span { display: block; font-size: .82rem; font-weight: 400; color: #6b7280; }
footer { margin-top: 3rem; font-size: .85rem; color: #6b7280; }
"""


@dataclass(frozen=True)
class ReportPaths:
    """Where a report was written.

    Parameters
    ----------
    page : self-contained HTML
    picture : PNG
    """

    page: Path
    picture: Path


def write_report(result: DemoResult, folder: Path) -> ReportPaths:
    """Write page and picture into a folder, which is made where it is missing.

    Raises
    ------
    InvalidInputError
        When the folder cannot be written.
    """
    paths = ReportPaths(folder / PAGE_NAME, folder / PICTURE_NAME)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        paths.picture.write_bytes(_png((13.0, 9.4), lambda figure: _draw_picture(figure, result)))
        paths.page.write_text(_page(result), encoding="utf-8")
    except OSError as error:
        raise InvalidInputError(f"cannot write the report into {folder}: {error}") from None
    return paths


def _page(result: DemoResult) -> str:
    prediction = result.prediction
    sections = [
        _heading(result),
        "<h2>What the camera saw</h2>",
        _figure(
            (9.0, 7.0),
            lambda figure: draw_frame(figure.add_subplot(), result.example),
            "A depth frame (missing readings are white) with the planes that were found, the ball, "
            "its track over the whole throw, and the direction of gravity.",
        ),
        "<h2>What was learned</h2>",
        _figure(
            (11.0, 3.2),
            lambda figure: _draw_parameters(figure, result.learning),
            "Coefficients of each pair of materials that touched.",
        ),
        _figure(
            (9.0, 3.6),
            lambda figure: draw_cost(figure.add_subplot(), result.learning),
            "Cost J, the mean distance between simulated and observed trajectories. Below the line "
            "of the true parameters there is only noise to be learned.",
        ),
        _parameter_table(result.learning),
        "<h2>What was predicted, and what then happened</h2>",
        _figure(
            (9.0, 6.6),
            lambda figure: draw_prediction_3d(figure.add_subplot(projection="3d"), prediction),
            f"A {html.escape(prediction.material)} ball of {100.0 * prediction.radius:.0f} cm "
            "radius that was not learned from: simulations from noisy copies of its perceived "
            "state, and where it then was seen.",
        ),
        _figure(
            (11.0, 3.6),
            lambda figure: _draw_prediction_over_time(figure, result),
            "Height, and distance of the predicted mean from the truth beside the spread that the "
            "prediction claims.",
        ),
        "<h2>Every throw</h2>",
        _throw_table(result.throws),
        _footer(result),
    ]
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>Intuitive physics: demo</title><style>{PAGE_STYLE}</style></head>\n<body>\n"
        + "\n".join(sections)
        + "\n</body></html>\n"
    )


def _heading(result: DemoResult) -> str:
    numbers = "".join(
        f"<div>{value:.3g}<span>{html.escape(_spoken(name))}</span></div>"
        for name, value in result.summary.items()
    )
    return (
        "<header><h1>Balls thrown, seen, learned from and predicted</h1>"
        "<p>A rendered depth camera watched balls thrown into a corner. From what it saw, the "
        "material parameters were learned that make a simulation do the same; then one more throw "
        f'was predicted.</p><div class="numbers">{numbers}</div></header>'
    )


def _spoken(name: str) -> str:
    """Turn a name such as `prediction_error_m` into "prediction error (m)"."""
    words = name.split("_")
    if len(words) > 1 and words[-1] in ("m", "mm", "s", "hz"):
        unit = {"hz": "Hz"}.get(words[-1], words[-1])
        return f"{' '.join(words[:-1])} ({unit})"
    return " ".join(words)


def _parameter_table(learning: LearningOutcome) -> str:
    learned = learning.learned
    names = parameter_names(learned.materials)
    true = parameter_vector(learning.true.extended(learned.materials))
    default = parameter_vector(type(learning.true).uniform(learned.materials))
    values = parameter_vector(learned.parameters)
    known, unknown = [], []
    for i, name in enumerate(names):
        deviation = learned.standard_deviations[i]
        if learned.identified[i]:
            spread = "" if np.isnan(deviation) else f"± {deviation:.2g}"
            cells = (name, f"{values[i]:.4g}", spread, f"{true[i]:.4g}", f"{default[i]:.4g}")
            known.append(_row(cells))
        else:
            unknown.append(name)
    rows = "".join(known)
    note = (
        f"<p>Not identified, since the throws cannot tell them: {html.escape(', '.join(unknown))}."
        "</p>"
        if unknown
        else ""
    )
    head = _row(("parameter", "learned", "", "true", "default"), cell="th")
    return f"<table>{head}{rows}</table>{note}"


def _throw_table(throws: Sequence[ThrowErrors]) -> str:
    head = _row(
        (
            "throw",
            "material",
            "radius (cm)",
            "seen",
            "perception RMSE (mm)",
            "D̄ learned (mm)",
            "D̄ true θ (mm)",
            "D̄ defaults (mm)",
        ),
        cell="th",
    )
    rows = "".join(
        _row(
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
        )
        for throw in throws
    )
    return (
        f"<table>{head}{rows}</table><p>D̄ is the mean distance between the simulated and the "
        "observed trajectory of a throw, under the learned, the true and the default parameters."
        "</p>"
    )


def _footer(result: DemoResult) -> str:
    rows = "; ".join(f"{name}: {value}" for name, value in result.about.items())
    return f"<footer>{html.escape(rows)}</footer>"


def _row(cells: Iterable[str], cell: str = "td") -> str:
    return "<tr>" + "".join(f"<{cell}>{html.escape(text)}</{cell}>" for text in cells) + "</tr>"


def _figure(size: tuple[float, float], draw: Callable[[Any], None], caption: str) -> str:
    data = base64.b64encode(_png(size, draw)).decode("ascii")
    text = html.escape(caption, quote=False)
    return (
        f'<figure><img alt="{html.escape(caption)}" src="data:image/png;base64,{data}">'
        f"<figcaption>{text}</figcaption></figure>"
    )


def _png(size: tuple[float, float], draw: Callable[[Any], None]) -> bytes:
    # The figure alone, without pyplot: no display, no global state.
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=size, layout="constrained")
        FigureCanvasAgg(figure)
        draw(figure)
        buffer = io.BytesIO()
        figure.savefig(buffer, format="png", dpi=RESOLUTION, facecolor="white")
    return buffer.getvalue()


def _draw_parameters(figure: Any, learning: LearningOutcome) -> None:
    grid = figure.add_gridspec(2, 4, height_ratios=(1.0, 0.05))
    first = figure.add_subplot(grid[0, 0])
    others = [figure.add_subplot(grid[0, k], sharey=first) for k in (1, 2, 3)]
    for axes in others:
        axes.tick_params(axis="y", labelleft=False)
    draw_parameters([first, *others], learning)
    below = figure.add_subplot(grid[1, :])
    below.set_axis_off()
    below.legend(handles=parameter_legend(), loc="center", ncols=3)


def _draw_prediction_over_time(figure: Any, result: DemoResult) -> None:
    left, right = figure.subplots(1, 2)
    draw_prediction_side(left, result.prediction)
    draw_prediction_error(right, result.prediction)


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
