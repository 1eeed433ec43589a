"""One set of colours, one style and one place of legends for all figures."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

OBSERVED = "#16a34a"
"""Green: what was seen."""
PREDICTED = "#2563eb"
"""Blue: what was predicted or learned."""
TRUE = "#111827"
"""Nearly black: the truth."""
DEFAULT = "#9ca3af"
"""Grey: defaults, and what is not identified."""
GRAVITY = "#dc2626"
"""Red: gravity, and errors."""
SPHERE = "#06b6d4"
"""Cyan: detected spheres."""
TRACK = "#d946ef"
"""Magenta: a track."""
PLANE_COLORS = ("#f59e0b", "#84cc16", "#38bdf8", "#a78bfa", "#fb7185", "#2dd4bf")
"""One for each plane, in turn."""

STYLE: dict[Any, Any] = {
    "font.size": 10.0,
    "axes.titlesize": 11.0,
    "axes.titleweight": "bold",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#6b7280",
    "axes.labelcolor": "#374151",
    "xtick.color": "#6b7280",
    "ytick.color": "#6b7280",
    "text.color": "#111827",
    "grid.color": "#e5e7eb",
    "legend.frameon": False,
    "legend.fontsize": 9.0,
}
"""Matplotlib settings of all figures."""


def legend_below(figure: Any, handles: Sequence[Any], columns: int) -> None:
    """Put a legend of artists with labels below all axes of a figure with constrained layout."""
    legend = figure.legend(handles=handles, loc="lower center", ncols=columns)
    height = legend.get_window_extent().y1 / figure.bbox.height
    figure.get_layout_engine().set(rect=(0.0, height, 1.0, 1.0 - height))
