"""The figure of the search methods, after the paper's Fig. 6."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from intuitive_physics_cli.report.figure_style import DEFAULT, TRUE

METHOD_COLORS = (
    "#9ca3af",
    "#a16207",
    "#f59e0b",
    "#84cc16",
    "#16a34a",
    "#06b6d4",
    "#2563eb",
    "#d946ef",
    "#dc2626",
)


def draw_search_methods(
    figure: Any, curves: Sequence[dict[str, Any]], final: Sequence[dict[str, Any]]
) -> None:
    """Draw J over iterations, a column for each number of objects, a row for that of samples.

    Parameters
    ----------
    curves, final : rows as `search_methods` writes them
    """
    objects = sorted({row["objects"] for row in curves})
    samples = sorted({row["samples"] for row in curves})
    methods = list(dict.fromkeys(row["method"] for row in curves))
    grid = figure.subplots(len(samples), len(objects), squeeze=False, sharex=True)
    for axes_row, n in zip(grid, samples, strict=True):
        for axes, m in zip(axes_row, objects, strict=True):
            here = [row for row in curves if (row["objects"], row["samples"]) == (m, n)]
            of_set = next(row for row in final if (row["objects"], row["samples"]) == (m, n))
            for color, method in zip(METHOD_COLORS, methods, strict=False):
                line = [row for row in here if row["method"] == method]
                label = method.replace("_", " ")
                x, y = [row["iteration"] for row in line], [row["J"] for row in line]
                axes.plot(x, y, color=color, lw=1.5, label=label)
            axes.axhline(of_set["oracle"], color=TRUE, lw=1.0, ls=":", label="true θ_s")
            axes.axhline(of_set["default"], color=DEFAULT, lw=1.0, ls="--", label="default θ_s")
            title = f"{m} objects × {n}: {of_set['parameters']} parameters"
            axes.set_title(title, loc="left", fontsize=10, weight="normal")
            axes.set_xscale("log")
            axes.set_ylim(0.0, 1.1 * max(row["J"] for row in here if row["iteration"] > 5))
            axes.grid(axis="y")
    for axes in grid[-1]:
        axes.set_xlabel("evaluations of J")
    for axes in grid[:, 0]:
        axes.set_ylabel("J (m)")
    handles, labels = grid[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2 * len(objects) + 1)
