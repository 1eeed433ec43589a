"""One set of colours and one style for all figures."""

from __future__ import annotations

from typing import Any

OBSERVED = "#16a34a"
PREDICTED = "#2563eb"
TRUE = "#111827"
DEFAULT = "#9ca3af"
GRAVITY = "#dc2626"
SPHERE = "#06b6d4"
TRACK = "#d946ef"
PLANE_COLORS = ("#f59e0b", "#84cc16", "#38bdf8", "#a78bfa", "#fb7185", "#2dd4bf")

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
