"""RViz markers of objects, environments, trajectories, and predicted distributions (Fig. 1)."""

from __future__ import annotations

import colorsys
import zlib
from collections.abc import Sequence

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Pose, Vector3
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from intuitive_physics.geometry.rotations import rotation_matrix
from intuitive_physics.scene import Environment, Plane, SceneObject, StaticBox
from intuitive_physics.shapes import Box, Capsule, Shape
from intuitive_physics.state import ObjectState
from intuitive_physics_ros.conversions.primitives import (
    point_to_message,
    pose_to_message,
    vector_to_message,
)

EDGELESS_PLANE_SIZE = 4.0
"""Edge length in m of the part of a plane without edges that is shown."""

PLANE_THICKNESS = 1e-3
"""m, of an unbounded plane as it is shown."""

GRAVITY_ARROW_LENGTH = 0.3
"""m"""

SAMPLE_COLOR = ColorRGBA(r=0.15, g=0.45, b=0.85, a=0.35)
"""Colour of a sample: blue, and so transparent that dense bundles look darker."""

MEAN_COLOR = ColorRGBA(r=0.95, g=0.55, b=0.10, a=1.0)
"""Colour of the mean: orange."""

ELLIPSOID_COLOR = ColorRGBA(r=0.95, g=0.55, b=0.10, a=0.20)
"""Colour of a covariance ellipsoid: the mean's orange, transparent."""

SAMPLE_WIDTH = 0.002
"""m, of a sample's line."""

MEAN_WIDTH = 0.006
"""m, of the mean's line."""

TEXT_HEIGHT = 0.05
"""m, of the letters of names."""

TEXT_COLOR = ColorRGBA(r=0.1, g=0.1, b=0.1, a=1.0)
"""Colour of names: dark, for RViz' light ground."""

ELLIPSOIDS = 8
"""Covariance ellipsoids an object, evenly over the horizon."""

MAX_SAMPLES = 50
"""Sample lines an object: more are a blur, and a load on RViz."""


MOST_POINTS = 1000
"""Points of a bundle of lines, evenly over time: Python makes about 300 in a millisecond."""


def clearing_marker() -> Marker:
    """Return what removes all markers of a topic; put first, the others replace the last ones."""
    return Marker(action=Marker.DELETEALL)


def object_markers(
    objects: Sequence[SceneObject],
    states: Sequence[ObjectState],
    header: Header,
    *,
    colors: Sequence[ArrayLike | None] | None = None,
) -> list[Marker]:
    """Return the solids of objects where their states have them.

    Parameters
    ----------
    colors : (3,) red, green and blue of each, 0 to 1; None for that of its material
    """
    markers: list[Marker] = []
    given_colors = colors if colors is not None else [None] * len(objects)
    for moving, state, color in zip(objects, states, given_colors, strict=True):
        for kind, offset, size in _solids(moving.shape):
            center = state.position + rotation_matrix(state.orientation) @ (0.0, 0.0, offset)
            markers.append(
                Marker(
                    header=header,
                    ns="objects",
                    id=len(markers),
                    type=kind,
                    pose=pose_to_message(center, state.orientation),
                    scale=vector_to_message(size),
                    color=material_color(moving.material) if color is None else _color(color),
                )
            )
    return markers


def name_markers(
    objects: Sequence[SceneObject],
    states: Sequence[ObjectState],
    header: Header,
    up: ArrayLike,
) -> list[Marker]:
    """Return the ids of objects as text above them; up (3,) is against gravity, zero means z."""
    length = float(np.linalg.norm(up))
    direction = np.asarray(up) / length if length else np.array([0.0, 0.0, 1.0])
    return [
        Marker(
            header=header,
            ns="names",
            id=i,
            type=Marker.TEXT_VIEW_FACING,
            text=moving.id,
            pose=pose_to_message(
                state.position + (moving.shape.bounding_radius + TEXT_HEIGHT) * direction
            ),
            scale=Vector3(z=TEXT_HEIGHT),
            color=TEXT_COLOR,
        )
        for i, (moving, state) in enumerate(zip(objects, states, strict=True))
    ]


def environment_markers(environment: Environment, stamp: Time | None = None) -> list[Marker]:
    """Return the planes and boxes of an environment, half transparent."""
    header = Header(stamp=stamp or Time(), frame_id=environment.frame_id)
    bodies = [
        *(_plane_marker(plane) for plane in environment.planes),
        *(_box_marker(box) for box in environment.boxes),
    ]
    for i, marker in enumerate(bodies):
        marker.header, marker.ns, marker.id = header, "environment", i
    return bodies


def gravity_marker(environment: Environment, stamp: Time | None = None) -> Marker:
    """Return an arrow that ends at the environment's origin and points along gravity."""
    strength = max(float(np.linalg.norm(environment.gravity)), 1e-9)
    tail = -GRAVITY_ARROW_LENGTH * environment.gravity / strength
    return Marker(
        header=Header(stamp=stamp or Time(), frame_id=environment.frame_id),
        ns="gravity",
        type=Marker.ARROW,
        pose=pose_to_message((0.0, 0.0, 0.0)),
        scale=vector_to_message((0.01, 0.03, 0.05)),
        color=ColorRGBA(r=1.0, a=1.0),
        points=[point_to_message(tail), point_to_message(np.zeros(3))],
    )


def trajectory_marker(
    positions: ArrayLike,
    header: Header,
    color: ColorRGBA,
    *,
    namespace: str = "trajectories",
    id: int = 0,
    width: float = 0.004,
) -> Marker:
    """Return trajectories as one bundle of lines.

    Parameters
    ----------
    positions : (n, n_times, 3) m; times that are not finite are left out
    width : m, of the lines
    """
    paths = np.asarray(positions, dtype=np.float64)
    n, n_times = paths.shape[:2]
    kept = max(2, min(n_times, MOST_POINTS // (2 * max(n, 1)) + 1))
    paths = paths[:, np.linspace(0, n_times - 1, kept).round().astype(int)]
    segments = np.stack([paths[:, :-1], paths[:, 1:]], axis=2).reshape(-1, 2, 3)
    segments = segments[np.isfinite(segments).all(axis=(1, 2))]
    return Marker(
        header=header,
        ns=namespace,
        id=id,
        type=Marker.LINE_LIST,
        pose=Pose(),
        scale=Vector3(x=width),
        color=color,
        points=[point_to_message(point) for point in segments.reshape(-1, 3)],
    )


def material_color(material: str, alpha: float = 1.0) -> ColorRGBA:
    """Return the colour of a material: always the same for the same name."""
    hue = (zlib.crc32(material.encode()) % 360) / 360.0
    r, g, b = colorsys.hsv_to_rgb(hue, 0.6, 0.9)
    return ColorRGBA(r=r, g=g, b=b, a=alpha)


def _color(rgb: ArrayLike) -> ColorRGBA:
    r, g, b = map(float, np.asarray(rgb))
    return ColorRGBA(r=r, g=g, b=b, a=1.0)


def _solids(shape: Shape) -> list[tuple[int, float, tuple[float, float, float]]]:
    """Kind of marker, offset along the body's z in m, and size in m of each part of a shape."""
    match shape:
        case Box():
            return [(Marker.CUBE, 0.0, shape.edge_lengths)]
        case Capsule():
            d, half = 2.0 * shape.radius, 0.5 * shape.length
            return [
                (Marker.CYLINDER, 0.0, (d, d, shape.length)),
                (Marker.SPHERE, half, (d, d, d)),
                (Marker.SPHERE, -half, (d, d, d)),
            ]
        case _:
            d = 2.0 * shape.bounding_radius
            return [(Marker.SPHERE, 0.0, (d, d, d))]


def _plane_marker(plane: Plane) -> Marker:
    color = material_color(plane.material, alpha=0.5)
    if plane.boundary is None:
        return Marker(
            type=Marker.CUBE,
            pose=pose_to_message(plane.normal * plane.offset, _z_axis_onto(plane.normal)),
            scale=vector_to_message((EDGELESS_PLANE_SIZE, EDGELESS_PLANE_SIZE, PLANE_THICKNESS)),
            color=color,
        )
    corners = [point_to_message(corner) for corner in plane.boundary]
    fan = [
        corner
        for i in range(1, len(corners) - 1)
        for corner in (corners[0], corners[i], corners[i + 1])
    ]
    return Marker(
        type=Marker.TRIANGLE_LIST,
        pose=Pose(),
        scale=Vector3(x=1.0, y=1.0, z=1.0),
        color=color,
        points=fan,
    )


def _box_marker(box: StaticBox) -> Marker:
    return Marker(
        type=Marker.CUBE,
        pose=pose_to_message(box.center, box.orientation),
        scale=vector_to_message(box.edge_lengths),
        color=material_color(box.material, alpha=0.5),
    )


def _z_axis_onto(direction: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the shortest rotation that turns z onto a unit vector, as (x, y, z, w)."""
    x, y, z = direction
    if z < -1.0 + 1e-9:
        return np.array([1.0, 0.0, 0.0, 0.0])
    # Half way between z and the direction: (z × d, 1 + z · d), scaled to one.
    quaternion = np.array([-y, x, 0.0, 1.0 + z])
    return quaternion / np.linalg.norm(quaternion)


def distribution_markers(
    header: Header,
    object_ids: Sequence[str],
    positions: NDArray[np.float64],
    mean: NDArray[np.float64],
    covariance: NDArray[np.float64],
) -> MarkerArray:
    """Return thin lines for the samples, a line for the mean, 2 σ ellipsoids for the covariance.

    Parameters
    ----------
    positions : (n_samples, n_objects, n_times, 3) m
    mean : (n_objects, n_times, 3) m
    covariance : (n_objects, n_times, 3, 3) m²; an ellipsoid is left out where one is not finite
    """
    markers = [clearing_marker()]
    for i in range(len(object_ids)):
        samples, middle = positions[:MAX_SAMPLES, i], mean[i : i + 1]
        markers += [
            trajectory_marker(
                samples, header, SAMPLE_COLOR, namespace="samples", id=i, width=SAMPLE_WIDTH
            ),
            trajectory_marker(middle, header, MEAN_COLOR, namespace="mean", id=i, width=MEAN_WIDTH),
        ]
        shown = np.linspace(0, mean.shape[1] - 1, ELLIPSOIDS + 1).round().astype(int)[1:]
        finite = np.isfinite(mean[i]).all(axis=1) & np.isfinite(covariance[i]).all(axis=(1, 2))
        for k in np.unique(shown[finite[shown]]):
            marker = _ellipsoid(mean[i, k], covariance[i, k])
            marker.header, marker.id = header, i * ELLIPSOIDS + len(markers)
            markers.append(marker)
    return MarkerArray(markers=markers)


def _ellipsoid(center: NDArray[np.float64], covariance: NDArray[np.float64]) -> Marker:
    """Return the ellipsoid of two standard deviations to each side."""
    variances, axes = np.linalg.eigh(covariance)
    if np.linalg.det(axes) < 0.0:
        axes[:, 0] = -axes[:, 0]
    size = 4.0 * np.sqrt(np.maximum(variances, 1e-8))
    return Marker(
        ns="covariance",
        type=Marker.SPHERE,
        pose=pose_to_message(center, Rotation.from_matrix(axes).as_quat()),
        scale=vector_to_message(size),
        color=ELLIPSOID_COLOR,
    )
