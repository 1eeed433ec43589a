"""A depth frame with what perception found in it, as in Fig. 7 of the paper."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_cli.report.figure_style import GRAVITY, PLANE_COLORS, SPHERE, TRACK
from intuitive_physics_experiments.demo.demo_result import ExampleFrame


def draw_frame(axes: Any, frame: ExampleFrame) -> None:
    """A depth frame with planes, sphere, track and gravity drawn in, as in Fig. 7."""
    depth = np.where(frame.depth > 0, frame.depth / 1000.0, np.nan)
    axes.imshow(depth, cmap="gray_r", vmin=np.nanmin(depth) - 0.3, vmax=np.nanmax(depth) + 0.3)
    height, width = depth.shape
    for k, (plane, outline) in enumerate(
        zip(frame.environment.planes, frame.plane_outlines, strict=True)
    ):
        color = PLANE_COLORS[k % len(PLANE_COLORS)]
        pixels = _pixels(frame, outline)
        axes.fill(*pixels.T, facecolor=color, alpha=0.16, edgecolor="none")
        axes.plot(
            *np.vstack([pixels, pixels[:1]]).T,
            color=color,
            lw=1.6,
            label=plane.id.replace("_", " "),
        )
    axes.plot(
        *_pixels(frame, frame.track).T, color=TRACK, lw=1.2, marker="o", ms=2.2, label="track"
    )
    axes.plot(*_pixels(frame, _silhouette(frame)).T, color=SPHERE, lw=2.2, label="sphere", zorder=5)
    _draw_gravity(axes, frame)
    axes.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), xticks=[], yticks=[])
    axes.spines[:].set_visible(False)
    axes.legend(
        loc="lower center",
        bbox_to_anchor=(0.5, -0.09),
        ncols=len(frame.plane_outlines) + 3,
        handlelength=1.2,
        columnspacing=1.2,
    )


def _draw_gravity(axes: Any, frame: ExampleFrame) -> None:
    gravity = frame.environment.gravity / np.linalg.norm(frame.environment.gravity)
    height, width = frame.depth.shape
    middle = np.median(frame.depth[frame.depth > 0]) / 1000.0
    ray = np.linalg.solve(frame.camera_matrix, [0.4 * width, 0.1 * height, 1.0])
    start = frame.rotation @ (ray * middle) + frame.translation
    tail, head = _pixels(frame, np.stack([start, start + 0.4 * gravity]))
    arrow = {"arrowstyle": "-|>", "color": GRAVITY, "lw": 2.4, "mutation_scale": 16}
    axes.annotate("", xy=head, xytext=tail, arrowprops=arrow)
    axes.annotate(
        "g",
        xy=(tail + head) / 2.0,
        xytext=(7, 0),
        textcoords="offset points",
        color=GRAVITY,
        fontsize=13,
        style="italic",
        weight="bold",
        va="center",
    )


def _pixels(frame: ExampleFrame, points: NDArray[np.float64]) -> NDArray[np.float64]:
    sensor = (points - frame.translation) @ frame.rotation
    return (sensor @ frame.camera_matrix.T)[:, :2] / sensor[:, 2:]


def _silhouette(frame: ExampleFrame) -> NDArray[np.float64]:
    """Circle (n, 3) where the camera's rays touch the sphere."""
    to_center = frame.sphere_center - frame.translation
    distance = np.linalg.norm(to_center)
    axis = to_center / distance
    side = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    side /= np.linalg.norm(side)
    sine = frame.sphere_radius / distance
    radius = frame.sphere_radius * np.sqrt(1.0 - sine**2)
    middle = frame.sphere_center - axis * frame.sphere_radius * sine
    angle = np.linspace(0.0, 2.0 * np.pi, 60)[:, None]
    return middle + radius * (np.cos(angle) * side + np.sin(angle) * np.cross(axis, side))
