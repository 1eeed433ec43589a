"""The error by ball size, after the paper's Fig. 8."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from intuitive_physics_cli.report.figure_style import DEFAULT, OBSERVED, PREDICTED, TRUE


def draw_errors_by_size(figure: Any, rows: Sequence[dict[str, Any]]) -> None:
    """Draw mean ± σ of each error for each ball, the smallest first.

    Parameters
    ----------
    rows : as `rgbd` writes them
    """
    axes = figure.add_subplot()
    ordered = sorted(rows, key=lambda row: row["radius"])
    places = np.arange(len(ordered))
    kinds = (
        ("learned", "learned", PREDICTED),
        ("test", "throws not learned from", OBSERVED),
        ("true_parameters", "true parameters", TRUE),
        ("default", "default parameters", DEFAULT),
    )
    for k, (name, label, color) in enumerate(kinds):
        axes.bar(
            places + 0.2 * (k - 1.5),
            [1e3 * row[name] for row in ordered],
            0.18,
            yerr=[1e3 * row[f"{name}_deviation"] for row in ordered],
            color=color,
            alpha=0.8,
            error_kw={"lw": 1.0, "ecolor": "#374151"},
            label=label,
        )
    axes.set_xticks(places, [f"{100.0 * row['radius']:.0f} cm, {row['ball']}" for row in ordered])
    axes.set(xlabel="radius", ylabel="mean distance (mm)")
    axes.set_ylim(bottom=0.0)
    axes.grid(axis="y")
    axes.set_axisbelow(True)
    axes.legend()
