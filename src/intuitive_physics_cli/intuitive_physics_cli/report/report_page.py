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
"""Dots per inch of a picture: sharp at twice the width it is shown at."""

QUANTILE_95 = 1.96
"""Standard deviations to each side of a normal distribution that hold 95 %."""

PAGE_STYLE = """
:root { --ink: #111827; --soft: #4b5563; --faint: #6b7280; --line: #e5e7eb; --paper: #f6f7f9;
        --accent: #2563eb; }
* { box-sizing: border-box; }
body { font: 16px/1.6 system-ui, -apple-system, "Segoe UI", sans-serif; color: var(--ink);
       background: var(--paper); margin: 0; }
header { background: linear-gradient(135deg, #0b1f4b, #1d4ed8 70%, #0e7490); color: white;
         padding: 3rem max(1.25rem, calc(50vw - 35rem)) 2.4rem; }
header h1 { font-size: clamp(1.7rem, 4.5vw, 2.6rem); line-height: 1.15; margin: 0 0 .8rem;
            letter-spacing: -.02em; }
header p { color: #dbeafe; font-size: 1.08rem; margin: 0; max-width: 46rem; }
main { max-width: 72.5rem; margin: 0 auto; padding: 1.5rem 1.25rem 0; }
section { background: white; border: 1px solid var(--line); border-radius: 14px;
          padding: 1.4rem clamp(1rem, 3vw, 2rem) 1.6rem; margin: 0 0 1.5rem; }
h2 { font-size: 1.35rem; letter-spacing: -.01em; margin: 0 0 .4rem; }
h3 { font-size: 1rem; font-weight: 600; margin: .2rem 0; }
p, figcaption, summary { color: var(--soft); max-width: 48rem; margin: .3rem 0 1rem; }
figure { margin: 1rem 0; }
figure img { display: block; width: 100%; height: auto; border-radius: 8px; }
figcaption { font-size: .92rem; margin: .5rem 0 0; }
.side-by-side { display: grid; gap: 1rem 1.5rem; align-items: start;
                grid-template-columns: repeat(auto-fit, minmax(min(100%, 21rem), 1fr)); }
.side-by-side > div { min-width: 0; }
.side-by-side figure { margin: 0; }
.plot { width: 100%; }
.numbers { display: flex; flex-wrap: wrap; gap: .8rem; margin: 1.8rem 0 0; }
.numbers div { font-size: 1.6rem; font-weight: 650; line-height: 1.2; flex: 1 1 8.5rem;
               background: rgb(255 255 255 / 12%); border-radius: 10px; padding: .8rem 1rem; }
.numbers span { display: block; font-size: .84rem; font-weight: 400; color: #dbeafe; }
.table { overflow-x: auto; margin: 1rem 0; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums;
        font-size: .93rem; }
th, td { padding: .42rem .8rem; text-align: right; border-bottom: 1px solid var(--line);
         white-space: nowrap; }
th { color: var(--faint); font-weight: 600; }
tr:hover td { background: #f8fafc; }
th:first-child, td:first-child { text-align: left; padding-left: 0; }
summary { cursor: pointer; font-weight: 600; margin: .6rem 0; }
footer { max-width: 72.5rem; margin: 0 auto; padding: .5rem 1.25rem 3rem; font-size: .86rem;
         color: var(--faint); }
@media (max-width: 40rem) { section { border-radius: 10px; } .numbers div { flex-basis: 40%; } }
"""
"""Style sheet of every page: one column of cards, from 360 pixels to wide screens."""


def page(title: str, scripts: str, head: str, sections: Sequence[str], foot: str) -> str:
    """Return a whole page that needs nothing else: of HTML but for the title, which is text."""
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{html.escape(title)}</title><style>{PAGE_STYLE}</style>{scripts}</head>\n<body>\n"
        + f"{head}\n<main>\n"
        + "\n".join(sections)
        + f"\n</main>\n{foot}\n</body></html>\n"
    )


def section(title: str, *parts: str, introduction: str = "") -> str:
    """Return one card of the page: title and introduction are plain text, parts are HTML."""
    opening = f"<h2>{html.escape(title)}</h2>"
    if introduction:
        opening += f"<p>{html.escape(introduction)}</p>"
    return f"<section>{opening}" + "\n".join(parts) + "</section>"


def side_by_side(parts: Iterable[str]) -> str:
    """Return HTML that stands in columns where the page is wide enough, else one below another."""
    return '<div class="side-by-side">' + "".join(f"<div>{part}</div>" for part in parts) + "</div>"


def heading(title: str, introduction: str, numbers: Mapping[str, float]) -> str:
    """Return the page's head: what it is about and its most important numbers."""
    cards = "".join(
        f"<div>{value:.3g}<span>{html.escape(spoken(name))}</span></div>"
        for name, value in numbers.items()
    )
    return (
        f"<header><h1>{html.escape(title)}</h1><p>{html.escape(introduction)}</p>"
        f'<div class="numbers">{cards}</div></header>'
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
    """Return a table of plain text, which scrolls by itself where it is wider than the page."""
    body = "".join(_row(row, "td") for row in rows)
    return f'<div class="table"><table>{_row(header, "th")}{body}</table></div>'


def parameter_section(learned: LearnedParameters, true: StaticParameters | None = None) -> str:
    """Return what was learned, beside the truth where known, and what is not identified."""
    names = parameter_names(learned.materials)
    values = parameter_vector(learned.parameters)
    default = parameter_vector(StaticParameters.uniform(learned.materials))
    truth = None if true is None else parameter_vector(true.extended(learned.materials))
    notes = parameter_notes(learned)
    rows = []
    for i in np.flatnonzero(learned.identified):
        row = [names[i], f"{values[i]:.4g}"]
        row += _spread(
            names[i], values[i], learned.standard_deviations[i], learned.intervals[i].tolist()
        )
        row += [] if truth is None else [f"{truth[i]:.4g}"]
        rows.append([*row, f"{default[i]:.4g}", notes[i]])
    header = ["parameter", "learned", "± σ", "95 % interval"]
    header += [*([] if truth is None else ["true"]), "default", ""]
    unknown = unidentified(learned)
    missing = (
        "<details><summary>Not identified by these observations</summary>"
        f"<p>{html.escape('; '.join(unknown))}.</p></details>"
        if unknown
        else ""
    )
    return (table(header, rows) if rows else "") + missing


def png_figure(size: tuple[float, float], draw: Callable[[Any], None], caption: str) -> str:
    """Return a picture that `draw` makes on a Matplotlib figure of `size` inches."""
    data = base64.b64encode(png(size, draw)).decode("ascii")
    return (
        f'<figure><img alt="{html.escape(caption)}" src="data:image/png;base64,{data}">'
        f"<figcaption>{html.escape(caption, quote=False)}</figcaption></figure>"
    )


def png(
    size: tuple[float, float], draw: Callable[[Any], None], about: Mapping[str, str] | None = None
) -> bytes:
    """Return a PNG file of what `draw` makes on a Matplotlib figure of `size` inches.

    The file keeps `about`, how it was made, as text.
    """
    # The figure alone, without pyplot: no display, no global state.
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=size, layout="constrained")
        FigureCanvasAgg(figure)
        draw(figure)
        buffer = io.BytesIO()
        figure.savefig(buffer, format="png", dpi=RESOLUTION, facecolor="white", metadata=about)
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
