"""Pieces that every report's page is put together from."""

from __future__ import annotations

import base64
import html
import io
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.materials import StaticParameters, parameter_names
from intuitive_physics.parameter_space import parameter_vector
from intuitive_physics_cli.parameter_table import parameter_notes, unidentified
from intuitive_physics_cli.report.figure_style import STYLE

RESOLUTION = 150
QUANTILE_95 = 1.96

PAGE_STYLE = """
body { font: 16px/1.55 system-ui, sans-serif; color: #111827; max-width: 62rem;
       margin: 0 auto; padding: 2.5rem 1.5rem; }
h1 { font-size: 1.9rem; margin: 0 0 .3rem; }
h2 { font-size: 1.25rem; margin: 2.6rem 0 .5rem; }
h3 { font-size: 1rem; margin: 1.6rem 0 .2rem; }
p, figcaption { color: #4b5563; max-width: 46rem; }
figure { margin: 1rem 0; }
img, .plot { max-width: 100%; height: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: .93rem; }
th, td { padding: .32rem .9rem .32rem 0; text-align: right; border-bottom: 1px solid #e5e7eb; }
th { color: #6b7280; font-weight: 600; }
th:first-child, td:first-child { text-align: left; }
.numbers { display: flex; flex-wrap: wrap; gap: 1rem 2.4rem; margin: 1.6rem 0 0; }
.numbers div { font-size: 1.5rem; font-weight: 650; }
.numbers span { display: block; font-size: .82rem; font-weight: 400; color: #6b7280; }
footer { margin-top: 3rem; font-size: .85rem; color: #6b7280; }
"""


def page(title: str, scripts: str, sections: Sequence[str]) -> str:
    """Return a whole page that needs nothing else.

    Parameters
    ----------
    title : plain text
    scripts : HTML that belongs into the head, such as a library
    sections : HTML, in their order
    """
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{html.escape(title)}</title><style>{PAGE_STYLE}</style>{scripts}</head>\n<body>\n"
        + "\n".join(sections)
        + "\n</body></html>\n"
    )


def heading(title: str, introduction: str, numbers: Mapping[str, float]) -> str:
    """Return the page's head: what it is about and its most telling numbers."""
    told = "".join(
        f"<div>{value:.3g}<span>{html.escape(spoken(name))}</span></div>"
        for name, value in numbers.items()
    )
    return (
        f"<header><h1>{html.escape(title)}</h1><p>{html.escape(introduction)}</p>"
        f'<div class="numbers">{told}</div></header>'
    )


def footer(about: Mapping[str, str]) -> str:
    """Return how the page was made."""
    rows = "; ".join(f"{name}: {value}" for name, value in about.items())
    return f"<footer>{html.escape(rows)}</footer>"


def spoken(name: str) -> str:
    """Turn a name such as `prediction_error_m` into "prediction error (m)"."""
    words = name.split("_")
    if len(words) > 1 and words[-1] in ("m", "mm", "s", "hz"):
        unit = {"hz": "Hz"}.get(words[-1], words[-1])
        return f"{' '.join(words[:-1])} ({unit})"
    return " ".join(words)


def table(header: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """Return a table of plain text."""
    return f"<table>{_row(header, 'th')}{''.join(_row(row, 'td') for row in rows)}</table>"


def parameter_section(learned: LearnedParameters, true: StaticParameters | None = None) -> str:
    """Return what was learned, with intervals, and by name what the observations cannot tell.

    Parameters
    ----------
    true : θ_s to compare with, where it is known
    """
    names = parameter_names(learned.materials)
    values = parameter_vector(learned.parameters)
    default = parameter_vector(StaticParameters.uniform(learned.materials))
    known = None if true is None else parameter_vector(true.extended(learned.materials))
    notes = parameter_notes(learned)
    rows = []
    for i in np.flatnonzero(learned.identified):
        row = [names[i], f"{values[i]:.4g}"]
        row += _spread(
            names[i], values[i], learned.standard_deviations[i], learned.intervals[i].tolist()
        )
        row += [] if known is None else [f"{known[i]:.4g}"]
        rows.append([*row, f"{default[i]:.4g}", notes[i]])
    header = ["parameter", "learned", "± σ", "95 % interval"]
    header += [*([] if known is None else ["true"]), "default", ""]
    unknown = unidentified(learned)
    told = (
        f"<p>Not identified, since the observations cannot tell them: "
        f"{html.escape('; '.join(unknown))}.</p>"
        if unknown
        else ""
    )
    return (table(header, rows) if rows else "") + told


def png_figure(size: tuple[float, float], draw: Callable[[Any], None], caption: str) -> str:
    """Return a picture that `draw` makes on a Matplotlib figure of `size` inches."""
    data = base64.b64encode(png(size, draw)).decode("ascii")
    text = html.escape(caption, quote=False)
    return (
        f'<figure><img alt="{html.escape(caption)}" src="data:image/png;base64,{data}">'
        f"<figcaption>{text}</figcaption></figure>"
    )


def png(size: tuple[float, float], draw: Callable[[Any], None]) -> bytes:
    """Return a PNG file of what `draw` makes on a Matplotlib figure of `size` inches."""
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


def _spread(name: str, value: float, deviation: float, ends: Sequence[float]) -> list[str]:
    """Standard deviation and 95 % interval, within what the parameter can be."""
    if np.isnan(deviation):
        return ["", ""]
    low = max(value - QUANTILE_95 * deviation, 0.0)
    high = value + QUANTILE_95 * deviation
    # As good up to an end that is farther away.
    low, high = float(np.fmin(low, ends[0])), float(np.fmax(high, ends[1]))
    if name.startswith("restitution"):
        high = min(high, 1.0)
    return [f"{deviation:.2g}", f"{low:.3g} to {high:.3g}"]


def _row(cells: Iterable[str], cell: str) -> str:
    return "<tr>" + "".join(f"<{cell}>{html.escape(text)}</{cell}>" for text in cells) + "</tr>"
