"""The figure of the learning curve, after the paper's Fig. 4."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from intuitive_physics_cli.report.figure_style import DEFAULT, OBSERVED, PREDICTED, TRUE

PAPER_ERROR, PAPER_DEVIATION = 0.911, 0.189
"""m, mean test error and its σ (Sec. IV-D)."""

SOURCE_TITLES = {
    "three_points": "initial states from 3 points, as in the paper",
    "flight": "initial states from all points before the first bounce",
    "true": "true initial states",
}


def draw_learning_curve(figure: Any, summary: Sequence[dict[str, Any]]) -> None:
    """Draw bars of training and test error for each set, a panel for each source of initial states.

    Parameters
    ----------
    summary : rows as `learning_curve` writes them
    """
    sources = list(dict.fromkeys(line["first_states"] for line in summary))
    panels = np.atleast_1d(figure.subplots(1, len(sources), sharey=True))
    for axes, source in zip(panels, sources, strict=True):
        lines = [line for line in summary if line["first_states"] == source]
        _draw_panel(axes, lines)
        axes.set_title(SOURCE_TITLES[source], loc="left", fontsize=10, weight="normal")
    panels[0].set_ylabel("J (m)")
    panels[-1].legend(loc="upper right")


def _draw_panel(axes: Any, lines: Sequence[dict[str, Any]]) -> None:
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
