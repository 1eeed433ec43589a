"""Interactive plots of the report, as Plotly figures in plain data."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.geometry.polygons import clip_polygon, plane_square
from intuitive_physics_cli.evaluation.prediction_case import LEVELS, PredictionCase, binomial_error
from intuitive_physics_cli.report.figure_style import (
    DEFAULT,
    GRAVITY,
    OBSERVED,
    PLANE_COLORS,
    PREDICTED,
    TRUE,
)

MOST_SAMPLES_DRAWN = 30
"""Sample paths in one plot; more are a blur."""

MOST_POINTS_DRAWN = 120
"""Points of a path in one plot, evenly over time."""

MARGIN = 0.2
"""m of a plane that is shown beyond the trajectories."""

SMALL_PLOT, LARGE_PLOT = 380, 600
"""Heights in pixels of plots in several columns, and of one alone."""

LAYOUT: dict[str, Any] = {
    "margin": {"l": 60, "r": 15, "t": 10, "b": 45},
    "paper_bgcolor": "white",
    "plot_bgcolor": "white",
    "font": {"family": "system-ui, sans-serif", "color": "#111827", "size": 13},
    "legend": {"orientation": "h", "y": 1.02, "yanchor": "bottom", "x": 0.0},
}
"""Layout that all plots share."""

BAND = "rgba(156, 163, 175, 0.25)"
"""Grey that shows what is behind it."""

GRID = {"gridcolor": "#e5e7eb", "zerolinecolor": "#e5e7eb"}
"""Look of an axis."""

VIEW_DISTANCE = 1.55
"""Distance of the camera from a scene, in sizes of the scene."""


def library_script() -> str:
    """Return Plotly itself, to be put into a page once."""
    from plotly.offline import get_plotlyjs

    return f"<script>{get_plotlyjs()}</script>"


def plot(name: str, data: list[dict[str, Any]], layout: dict[str, Any], height: int) -> str:
    """Return the HTML of one plot, `height` pixels high.

    The name is unique on the page: letters, digits and hyphens. So it is below.
    """
    figure = json.dumps([data, {**LAYOUT, **layout, "height": height}], allow_nan=False)
    # A name in it must not end the script.
    figure = figure.replace("</", "<\\/")
    return (
        f'<div id="{name}" class="plot"></div>'
        f'<script>Plotly.newPlot("{name}", ...{figure}, '
        "{responsive: true, displaylogo: false, displayModeBar: false})</script>"
    )


def prediction_plot(name: str, case: PredictionCase, height: int = LARGE_PLOT) -> str:
    """Samples in thin blue, what was seen in green, the error at each point in red (Fig. 5)."""
    step = max(1, -(-len(case.times) // MOST_POINTS_DRAWN))
    samples = case.samples[:MOST_SAMPLES_DRAWN, ::step]
    mean, observed = case.mean[::step], case.observed[::step]
    data = [
        _line(_chained(samples), "predicted", PREDICTED, 1.0, opacity=0.35),
        _line(_chained(np.stack([mean, observed], axis=1)), "error", GRAVITY, 1.5, opacity=0.6),
        _line(mean, "mean of the prediction", TRUE, 3.0),
        _line(observed, "observed", OBSERVED, 6.0),
        *_planes(case),
    ]
    axis = {"backgroundcolor": "white", **GRID}
    scene = {
        "aspectmode": "data",
        "xaxis": {"title": {"text": "x (m)"}, **axis},
        "yaxis": {"title": {"text": "y (m)"}, **axis},
        "zaxis": {"title": {"text": "z (m)"}, **axis},
        "camera": _camera(case),
    }
    # A scene has no axis labels outside of it that would need a margin.
    margin = {"l": 0, "r": 0, "t": 0, "b": 0}
    legend = {**LAYOUT["legend"], "y": 0.0, "yanchor": "top"}
    return plot(name, data, {"scene": scene, "margin": margin, "legend": legend}, height)


def cost_plot(name: str, history: NDArray[np.float64], levels: dict[str, float]) -> str:
    """The lowest J after each iteration, (n,) m, with levels in m to compare with, by label."""
    iterations = np.arange(1, history.size + 1)
    changed = np.flatnonzero(np.append(True, np.diff(history) != 0.0))
    shown = np.unique(np.append(changed, history.size - 1))
    data = [
        {
            "x": iterations[shown].tolist(),
            "y": history[shown].tolist(),
            "name": "lowest J so far",
            "mode": "lines",
            "line": {"color": PREDICTED, "width": 2.5, "shape": "hv"},
        }
    ]
    for color, (label, value) in zip((DEFAULT, TRUE), levels.items(), strict=False):
        data.append(
            {
                "x": [1, history.size],
                "y": [value, value],
                "name": label,
                "mode": "lines",
                "line": {"color": color, "width": 1.5, "dash": "dash"},
            }
        )
    axes = {
        "xaxis": {"title": {"text": "iterations"}, "type": "log", **GRID},
        "yaxis": {"title": {"text": "J (m)"}, "type": "log", **GRID},
    }
    return plot(name, data, axes, SMALL_PLOT)


def coverage_plot(name: str, shares: NDArray[np.float64], count: int) -> str:
    """Share (n_levels,) of points inside each region against the share the region claims.

    A band has the binomial standard error of the `count` motions that the points are of.
    """
    claimed = np.linspace(0.0, 1.0, 41)
    error = np.array([binomial_error(share, count) for share in claimed])
    edge = {"x": claimed.tolist(), "mode": "lines", "line": {"width": 0}, "hoverinfo": "skip"}
    data = [
        {**edge, "y": (claimed - error).tolist(), "showlegend": False},
        {
            **edge,
            "y": (claimed + error).tolist(),
            "name": "its standard error",
            "fill": "tonexty",
            "fillcolor": BAND,
        },
        {
            "x": [0, 1],
            "y": [0, 1],
            "name": "as claimed",
            "mode": "lines",
            "line": {"color": DEFAULT, "dash": "dash", "width": 1.5},
        },
        {
            "x": LEVELS.tolist(),
            "y": shares.tolist(),
            "name": "as seen",
            "mode": "lines+markers",
            "line": {"color": PREDICTED, "width": 2.5},
        },
    ]
    axes = {
        "xaxis": {"title": {"text": "share the region claims to hold"}, "range": [0, 1], **GRID},
        "yaxis": {"title": {"text": "share of points in it"}, "range": [0, 1], **GRID},
    }
    return plot(name, data, axes, SMALL_PLOT)


def _camera(case: PredictionCase) -> dict[str, Any]:
    """A view that shows walls from their front, from above and somewhat from the side."""
    gravity = case.environment.gravity
    up = -gravity / max(float(np.linalg.norm(gravity)), 1e-9)
    walls = [plane.normal for plane in case.environment.planes if abs(plane.normal @ up) < 0.5]
    front = np.sum(walls, axis=0) if walls else np.array([1.0, -1.0, 0.0])
    if np.linalg.norm(front[:2]) < 0.1:
        front = np.array([1.0, -1.0, 0.0])
    azimuth = np.arctan2(front[1], front[0]) + 0.35
    eye = VIEW_DISTANCE * np.array([0.9 * np.cos(azimuth), 0.9 * np.sin(azimuth), 0.45])
    x, y, z = eye.round(3).tolist()
    return {"eye": {"x": x, "y": y, "z": z}, "center": {"x": 0, "y": 0, "z": -0.12}}


def _line(
    points: NDArray[np.float64], label: str, color: str, width: float, opacity: float = 1.0
) -> dict[str, Any]:
    x, y, z = ([_number(v) for v in axis] for axis in points.T)
    return {
        "type": "scatter3d",
        "mode": "lines",
        "x": x,
        "y": y,
        "z": z,
        "name": label,
        "opacity": opacity,
        "line": {"color": color, "width": width},
        "hoverinfo": "skip" if opacity < 1.0 else "all",
    }


def _number(value: float) -> float | None:
    return None if np.isnan(value) else round(float(value), 5)


def _chained(paths: NDArray[np.float64]) -> NDArray[np.float64]:
    """Paths (n, points, 3) as one line with gaps, (n * (points + 1), 3)."""
    gaps = np.full((len(paths), 1, 3), np.nan)
    return np.concatenate([paths, gaps], axis=1).reshape(-1, 3)


def _planes(case: PredictionCase) -> list[dict[str, Any]]:
    """The part of each plane about the trajectories, cut off by the others."""
    points = np.concatenate([case.observed, case.mean])
    low = points.min(axis=0) - MARGIN - case.radius
    high = points.max(axis=0) + MARGIN + case.radius
    planes = case.environment.planes
    surfaces = []
    for k, plane in enumerate(planes):
        reach = 2.0 * float(np.linalg.norm(high - low))
        corners = plane_square(plane.normal, plane.offset, (low + high) / 2.0, reach)
        for axis in np.eye(3):
            corners = clip_polygon(corners, axis, float(low @ axis))
            corners = clip_polygon(corners, -axis, float(-(high @ axis)))
        for other in planes:
            if other is not plane and len(corners):
                corners = clip_polygon(corners, other.normal, other.offset)
        if len(corners) >= 3:
            surfaces.append(_surface(corners, plane.id, PLANE_COLORS[k % len(PLANE_COLORS)]))
    return surfaces


def _surface(corners: NDArray[np.float64], label: str, color: str) -> dict[str, Any]:
    x, y, z = corners.round(5).T.tolist()
    fan = range(1, len(corners) - 1)
    return {
        "type": "mesh3d",
        "x": x,
        "y": y,
        "z": z,
        "i": [0 for _ in fan],
        "j": list(fan),
        "k": [n + 1 for n in fan],
        "color": color,
        "opacity": 0.18,
        "name": label,
        "hoverinfo": "name",
    }
