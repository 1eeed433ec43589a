"""The demo's figures, after Figs. 1 and 5 to 7 of the paper."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.geometry.polygons import clip_polygon, plane_square
from intuitive_physics.materials import PAIR_COEFFICIENTS, parameter_names
from intuitive_physics.parameter_space import parameter_vector
from intuitive_physics.scene import Environment
from intuitive_physics_cli.report.figure_style import (
    DEFAULT,
    GRAVITY,
    OBSERVED,
    PLANE_COLORS,
    PREDICTED,
    SPHERE,
    TRACK,
    TRUE,
)
from intuitive_physics_experiments.demo.demo_result import (
    ExampleFrame,
    LearningOutcome,
    PredictionOutcome,
)

MOST_SAMPLES_DRAWN = 60  # Samples of a prediction in one picture; more would hide one another


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
    return projected(points, frame.rotation, frame.translation, frame.camera_matrix)


def projected(
    points: NDArray[np.float64],
    rotation: NDArray[np.float64],
    translation: NDArray[np.float64],
    camera_matrix: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the pixels (n, 2) of points (n, 3) m of the environment.

    The `rotation` (3, 3) and `translation` (3,) m lead from the camera to the environment;
    `camera_matrix` (3, 3) is in pixels.
    """
    sensor = (points - translation) @ rotation
    return np.asarray((sensor @ camera_matrix.T)[:, :2] / sensor[:, 2:])


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


def draw_cost(axes: Any, learning: LearningOutcome) -> None:
    """J over iterations, between the default parameters and the true ones, as in Fig. 6."""
    iterations = np.arange(1, learning.cost_history.size + 1)
    axes.axhline(1000.0 * learning.default_cost, color=DEFAULT, lw=1.4, ls="--", label="defaults")
    axes.plot(iterations, 1000.0 * learning.cost_history, color=PREDICTED, lw=2.0, label="learned")
    axes.axhline(1000.0 * learning.oracle_cost, color=TRUE, lw=1.4, ls=":", label="true parameters")
    axes.set(xlabel="iterations", ylabel="cost J (mm)", xscale="log", yscale="log")
    axes.set_xlim(1, iterations[-1])
    _plain_ticks(axes.yaxis)
    axes.grid(axis="y", which="both")
    axes.legend(loc="best")


def draw_coefficient(axes: Any, learning: LearningOutcome, coefficient: str) -> None:
    """One coefficient of the pairs that were identified or should have been, learned and true."""
    rows = identified_pairs(learning)
    labels = [" – ".join(pair) for pair in rows]
    for y, pair in enumerate(rows):
        _draw_parameter(axes, learning, coefficient, pair, len(rows) - 1 - y)
    axes.set_title(coefficient.replace("_", " "), loc="left", fontsize=10, weight="normal")
    axes.set_yticks(range(len(rows)), labels[::-1])
    axes.set_ylim(-0.6, len(rows) - 0.4)
    axes.set_xlim(0.0, 1.08 * axes.get_xlim()[1])
    axes.grid(axis="x")
    axes.spines["left"].set_visible(False)
    axes.tick_params(axis="y", length=0)


def parameter_legend() -> list[Any]:
    """Handles that explain `draw_coefficient`."""
    from matplotlib.lines import Line2D

    return [
        Line2D([], [], marker="|", ms=14, mew=2.2, color=TRUE, lw=0, label="true"),
        Line2D([], [], marker="o", ms=6, color=PREDICTED, lw=1.5, label="learned ± σ"),
        Line2D([], [], marker="o", ms=6, mfc="white", color=DEFAULT, lw=0, label="not identified"),
    ]


def _draw_parameter(
    axes: Any, learning: LearningOutcome, coefficient: str, pair: tuple[str, str], y: int
) -> None:
    learned = learning.learned
    names = parameter_names(learned.materials)
    index = names.index(f"{coefficient}[{pair[0]}, {pair[1]}]")
    value = parameter_vector(learned.parameters)[index]
    deviation = np.nan_to_num(learned.standard_deviations[index])
    axes.plot(learning.true.pair(*pair)[coefficient], y, "|", color=TRUE, ms=16, mew=2.2)
    if learned.identified[index]:
        axes.errorbar(
            value,
            y,
            xerr=_reach(value, deviation, learned.intervals[index]),
            fmt="o",
            color=PREDICTED,
            ms=6,
            capsize=0,
        )
    else:
        axes.plot(value, y, "o", mfc="white", color=DEFAULT, ms=6)


def _reach(value: float, deviation: float, ends: NDArray[np.float64]) -> list[list[float]]:
    """Lengths of the bar down and up: a standard deviation, or the one-sided interval."""
    low, high = np.fmin(value - deviation, ends[0]), np.fmax(value + deviation, ends[1])
    return [[value - float(low)], [float(high) - value]]


def identified_pairs(learning: LearningOutcome) -> list[tuple[str, str]]:
    """Pairs of which at least one coefficient was identified, in the learner's order."""
    learned = learning.learned
    pairs: dict[tuple[str, str], None] = {}
    for name, known in zip(parameter_names(learned.materials), learned.identified, strict=True):
        kind, _, rest = name.partition("[")
        if kind in PAIR_COEFFICIENTS and known:
            a, b = rest.rstrip("]").split(", ")
            pairs[(a, b)] = None
    return list(pairs)


def _plain_ticks(axis: Any) -> None:
    from matplotlib.ticker import LogLocator, ScalarFormatter

    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(ScalarFormatter())
    axis.set_minor_locator(LogLocator(subs=()))


def draw_prediction_3d(axes: Any, prediction: PredictionOutcome) -> None:
    """Samples in thin blue and what was observed in thick green, as in Fig. 1."""
    for sample in prediction.samples[:MOST_SAMPLES_DRAWN]:
        axes.plot(*sample.T, color=PREDICTED, lw=0.6, alpha=0.35)
    axes.plot([], [], color=PREDICTED, lw=1.0, label="predicted")
    axes.plot(*prediction.observed.T, color=OBSERVED, lw=3.0, label="observed")
    axes.scatter(*prediction.mean[0], color=TRUE, s=22, label="predicted from here", zorder=10)
    _frame_3d(axes, prediction)
    axes.legend(loc="upper left")


def _frame_3d(axes: Any, prediction: PredictionOutcome) -> None:
    from matplotlib.ticker import MaxNLocator

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
        axis.set_major_locator(MaxNLocator(4))


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
