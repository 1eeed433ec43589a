"""A predicted throw against what then happened, as in Figs. 1 and 5 of the paper."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.geometry.polygons import clip_polygon, plane_square
from intuitive_physics.scene import Environment
from intuitive_physics_cli.report.figure_style import (
    DEFAULT,
    OBSERVED,
    PLANE_COLORS,
    PREDICTED,
    TRUE,
)
from intuitive_physics_experiments.demo.demo_result import PredictionOutcome

MOST_SAMPLES_DRAWN = 60


def draw_prediction_3d(axes: Any, prediction: PredictionOutcome) -> None:
    """Samples in thin blue and what was observed in thick green, as in Fig. 1."""
    for sample in _drawn_samples(prediction):
        axes.plot(*sample.T, color=PREDICTED, lw=0.6, alpha=0.35)
    axes.plot([], [], color=PREDICTED, lw=1.0, label="predicted")
    axes.plot(*prediction.observed.T, color=OBSERVED, lw=3.0, label="observed")
    axes.scatter(*prediction.mean[0], color=TRUE, s=22, label="predicted from here", zorder=10)
    _frame_3d(axes, prediction)
    axes.legend(loc="upper left")


def draw_prediction_side(axes: Any, prediction: PredictionOutcome) -> None:
    """Height over time of the same throw."""
    up = -prediction.environment.gravity / np.linalg.norm(prediction.environment.gravity)
    for sample in _drawn_samples(prediction):
        axes.plot(prediction.times, sample @ up, color=PREDICTED, lw=0.6, alpha=0.35)
    axes.plot([], [], color=PREDICTED, lw=1.0, label="predicted")
    axes.plot(
        prediction.observed_times,
        prediction.observed @ up,
        color=OBSERVED,
        lw=3.0,
        label="observed",
    )
    axes.plot(prediction.times, prediction.true @ up, color=TRUE, lw=1.0, ls="--", label="true")
    axes.axvline(0.0, color=DEFAULT, lw=1.0)
    axes.set(xlabel="time after the prediction (s)", ylabel="height (m)")
    axes.grid(axis="y")
    axes.legend(loc="upper right")


def draw_prediction_error(axes: Any, prediction: PredictionOutcome) -> None:
    """Distance of the predicted mean from the truth, and the spread the prediction claims."""
    error = np.linalg.norm(prediction.mean - prediction.true, axis=1)
    offsets = prediction.samples - prediction.mean
    spread = np.sqrt((offsets**2).sum(axis=2).mean(axis=0))
    axes.fill_between(
        prediction.times, 0.0, 1000.0 * spread, color=PREDICTED, alpha=0.15, lw=0, label="spread"
    )
    axes.plot(prediction.times, 1000.0 * error, color=PREDICTED, lw=1.8, label="error of the mean")
    axes.set(xlabel="time after the prediction (s)", ylabel="distance (mm)", ylim=(0.0, None))
    axes.grid(axis="y")
    axes.legend(loc="upper left")


def _drawn_samples(prediction: PredictionOutcome) -> NDArray[np.float64]:
    return prediction.samples[:MOST_SAMPLES_DRAWN]


def _frame_3d(axes: Any, prediction: PredictionOutcome) -> None:
    points = np.concatenate([prediction.observed, prediction.mean])
    low = points.min(axis=0) - [0.25, 0.25, prediction.radius]
    high = points.max(axis=0) + 0.25
    _draw_planes_3d(axes, prediction.environment, low, high)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set_box_aspect(high - low, zoom=1.05)
    axes.set(xlabel="x (m)", ylabel="y (m)")
    axes.set_zlabel("z (m)", labelpad=0.0)
    axes.view_init(elev=20.0, azim=_azimuth_before_walls(prediction.environment))
    axes.grid(False)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.pane.set_visible(False)
        axis.line.set_color("#9ca3af")
        axis.set_major_locator(_sparse_ticks())


def _azimuth_before_walls(environment: Environment) -> float:
    """Direction in degrees from which walls show their front, somewhat from the side."""
    up = -environment.gravity / np.linalg.norm(environment.gravity)
    front = sum((p.normal for p in environment.planes if abs(p.normal @ up) < 0.5), np.zeros(3))
    if np.linalg.norm(front[:2]) < 0.1:
        return -60.0
    return float(np.degrees(np.arctan2(front[1], front[0]))) + 18.0


def _draw_planes_3d(
    axes: Any, environment: Environment, low: NDArray[np.float64], high: NDArray[np.float64]
) -> None:
    """Draw the part of each plane inside the box, cut off by the other planes."""
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    for k, plane in enumerate(environment.planes):
        corners = _plane_in_box(plane.normal, plane.offset, low, high)
        for other in environment.planes:
            if other is not plane and len(corners):
                corners = clip_polygon(corners, other.normal, other.offset)
        if len(corners) >= 3:
            color = PLANE_COLORS[k % len(PLANE_COLORS)]
            patch = Poly3DCollection([corners], facecolor=color, edgecolor=color, alpha=0.12)
            axes.add_collection3d(patch)


def _plane_in_box(
    normal: NDArray[np.float64], offset: float, low: NDArray[np.float64], high: NDArray[np.float64]
) -> NDArray[np.float64]:
    reach = 2.0 * float(np.linalg.norm(high - low))
    corners = plane_square(normal, offset, (low + high) / 2.0, reach)
    for axis in np.eye(3):
        corners = clip_polygon(corners, axis, float(low @ axis))
        corners = clip_polygon(corners, -axis, float(-(high @ axis)))
    return corners


def _sparse_ticks() -> Any:
    from matplotlib.ticker import MaxNLocator

    return MaxNLocator(4)
