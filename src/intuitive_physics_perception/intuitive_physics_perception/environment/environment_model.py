"""The environment Ω_e: modelled from the first frames, and revised when the scene has changed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.errors import IntuitivePhysicsError
from intuitive_physics.frames.change_of_frame import RigidTransform, environment_in
from intuitive_physics.geometry.polygons import clip_polygon
from intuitive_physics.scene import Environment, Plane
from intuitive_physics_perception.environment.fusion import fuse
from intuitive_physics_perception.environment.gravity import (
    UP_TOLERANCE,
    Upward,
    facing,
    upright,
)
from intuitive_physics_perception.environment.noise import RangeNoise
from intuitive_physics_perception.environment.plane_edges import with_edges
from intuitive_physics_perception.environment.planes import DetectedPlane, detect_planes
from intuitive_physics_perception.environment.range_cloud import (
    RangeCloud,
    angle_between_lines,
    angle_between_readings,
    spacing_of,
)
from intuitive_physics_perception.environment.ray_planes import PlaneAgreement, RayPlanes
from intuitive_physics_perception.settings import PerceptionSettings

MIN_POINTS = 50
"""Points in range that the first frames, or the part of a later frame that is checked, must have:
too few show no plane. Set by hand."""

VERTICAL_VIEW_COSINE = float(np.cos(np.radians(10.0)))
"""Cosine of the angle between optical axis and vertical below which the view counts as vertical:
the horizontal part of the optical axis is then too short to give a direction. Set by hand."""


class NoEnvironmentError(IntuitivePhysicsError):
    """The frames show no plane that could support anything."""


@dataclass(frozen=True, eq=False)
class EnvironmentModel:
    """The environment, and where the sensor stands in it.

    The environment's frame has z against gravity, which is along the normal of the supporting
    plane unless it was measured, its origin where a plumb line from the sensor meets that plane,
    or the sensor where there is none, and x along the horizontal part of the sensor's optical axis
    (z), or of the sensor's x axis where the optical axis is vertical within 10°. Modelled again
    from elsewhere it keeps its frame (`in_frame_of`).

    Parameters
    ----------
    environment : Ω_e; its first plane is the support where there is one; planes end where edges
        were seen
    detected : the same planes in the sensor's frame, with their hulls
    rotation : (3, 3) and
    translation : (3,) m: p_environment = rotation p_sensor + translation
    noise : of the range readings, measured on the planes
    agreement : of the readings with the planes when they were modelled
    has_support : whether the first plane supports objects; without one the origin is the sensor
    gravity_doubt : one sentence on why gravity may be elsewhere; empty where nothing speaks for it
    """

    environment: Environment
    detected: tuple[DetectedPlane, ...]
    rotation: NDArray[np.float64]
    translation: NDArray[np.float64]
    noise: RangeNoise
    agreement: PlaneAgreement
    has_support: bool = True
    gravity_doubt: str = ""

    def to_environment(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return points (..., 3) of the sensor's frame in the environment's frame, m."""
        return np.asarray(points, dtype=np.float64) @ self.rotation.T + self.translation

    def to_sensor(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return points (..., 3) of the environment's frame in the sensor's frame, m."""
        return (np.asarray(points, dtype=np.float64) - self.translation) @ self.rotation

    @cached_property
    def sensor_pose(self) -> RigidTransform:
        """Pose of the sensor in the environment's frame."""
        from scipy.spatial.transform import Rotation

        return RigidTransform(self.translation, Rotation.from_matrix(self.rotation).as_quat())

    def seen_from(self, way: RigidTransform) -> EnvironmentModel:
        """Return the same environment as a sensor sees it that has moved; `way` leads from its
        frame now to that of this model."""
        turn, shift = way.matrix, way.translation
        detected = tuple(
            replace(
                plane,
                normal=turn.T @ plane.normal,
                offset=plane.offset - float(plane.normal @ shift),
                hull=(plane.hull - shift) @ turn,
                boundary=None if plane.boundary is None else (plane.boundary - shift) @ turn,
                openings=None if plane.openings is None else plane.openings.seen_from(way),
                parts=tuple((part - shift) @ turn for part in plane.parts),
                relief=None if plane.relief is None else plane.relief.seen_from(way),
            )
            for plane in self.detected
        )
        return replace(
            self,
            detected=detected,
            rotation=self.rotation @ turn,
            translation=self.rotation @ shift + self.translation,
        )

    def in_frame_of(self, known: EnvironmentModel) -> EnvironmentModel:
        """Return the same model in the frame of another one that is seen from the same place."""
        way = known.sensor_pose.after(self.sensor_pose.inverse)
        frame_id = self.environment.frame_id
        return replace(
            self,
            environment=environment_in(self.environment, frame_id, way),
            rotation=known.rotation,
            translation=known.translation,
        )

    def seen_environment(self) -> Environment:
        """Return the environment with its planes cut to what was seen of them, as to be shown."""
        hulls = dict(zip(self.plane_ids, self.hulls(), strict=True))
        seen = [
            (plane, _within_boundary(hulls[plane.id.partition("/")[0]], plane))
            for plane in self.environment.planes
        ]
        planes = tuple(
            Plane(plane.id, plane.material, plane.normal, plane.offset, corners)
            for plane, corners in seen
            if len(corners) >= 3
        )
        return replace(self.environment, planes=planes)

    @property
    def plane_ids(self) -> list[str]:
        """Ids of the detected planes: those of their first parts."""
        return [plane.id for plane in self.environment.planes if "/" not in plane.id]

    def hulls(self) -> list[NDArray[np.float64]]:
        """Return the convex hull (n, 3), m, of what was seen of each plane, in its frame."""
        return [self.to_environment(plane.hull) for plane in self.detected]


def _within_boundary(hull: NDArray[np.float64], plane: Plane) -> NDArray[np.float64]:
    """Part (k, 3) of a convex polygon (n, 3) in a plane that lies within the plane's boundary."""
    if plane.boundary is None:
        return hull
    sides = np.roll(plane.boundary, -1, axis=0) - plane.boundary
    inward = np.cross(plane.normal, sides)
    inward /= np.linalg.norm(inward, axis=1, keepdims=True)
    for corner, normal in zip(plane.boundary, inward, strict=True):
        hull = clip_polygon(hull, normal, float(normal @ corner))
    return hull


def model_environment(
    frames: Sequence[NDArray[np.float32]],
    settings: PerceptionSettings,
    rng: np.random.Generator,
    up: ArrayLike | None = None,
) -> EnvironmentModel:
    """Fuse frames of points and model what is static in them (Sec. VI-B).

    Parameters
    ----------
    frames : each (height, width, 3) m, NaN where nothing was read, the sensor at the origin
    up : (3,) unit vector against gravity in the sensor's frame, as an accelerometer has measured
        it; None: what `gravity_source` says, the normal of the supporting plane or `up_hint`

    Raises
    ------
    NoEnvironmentError
        When there are too few points; when no plane faces up and up_hint says where that is; when
        an unorganised cloud has no plane.
    """
    measured = up is not None
    if up is None and settings.gravity_source == "up_hint":
        up = settings.up_hint
    points = fuse(frames, settings, rng)
    if len(points) < MIN_POINTS:
        raise NoEnvironmentError(
            f"{len(frames)} frames have {len(points)} points between {settings.min_range:g} and "
            f"{settings.max_range:g} m; expected at least {MIN_POINTS}"
        )
    assumed = RangeNoise.from_settings(settings)
    planes = detect_planes(points, assumed, settings, rng)
    upward = _upward(
        planes, settings, up, len(points), measured=measured, organised=is_organised(frames)
    )
    noise = _measured_noise(frames, upward.planes, assumed, settings, rng)
    planes = with_edges(upward.planes, frames, noise, settings, rng)
    rotation, translation = _gravity_aligned(planes[0] if upward.has_support else None, upward.up)
    names = [f"plane_{k}" for k in range(len(planes))]
    environment = Environment(
        _placed(planes, names, rotation, translation, settings),
        gravity=(0.0, 0.0, -settings.gravity),
        frame_id=settings.environment_frame_id,
    )
    agreement = RayPlanes(planes, noise, settings).agreement(points.astype(np.float32))
    return EnvironmentModel(
        environment=environment,
        detected=tuple(planes),
        rotation=rotation,
        translation=translation,
        noise=noise,
        agreement=agreement,
        has_support=upward.has_support,
        gravity_doubt=upward.doubt,
    )


def is_organised(frames: Sequence[NDArray[np.float32]]) -> bool:
    """Whether frames (height, width, 3) m have the same pixels, whose rays stay."""
    return frames[0].shape[0] > 1 and all(frame.shape == frames[0].shape for frame in frames)


def revised_environment(
    model: EnvironmentModel,
    frame: NDArray[np.float32],
    settings: PerceptionSettings,
    rng: np.random.Generator,
) -> EnvironmentModel:
    """Model the planes again where the sensor still stands as it did.

    A plane that is still there keeps its id and its place, so that the frame stays; where it ends
    is determined again.

    `frame` (height, width, 3) m, what has been seen for some time, NaN where nothing was read.
    The result has no static boxes.

    Raises
    ------
    NoEnvironmentError
        When the support has gone or come, and with it the frame.
    """
    points = fuse([frame], settings, rng)
    old_planes = {plane.numbers.tobytes(): plane.numbers for plane in model.detected}
    planes = detect_planes(points, model.noise, settings, rng, list(old_planes.values()))
    planes, names = _named(planes, model)
    if model.has_support:
        is_supported = "plane_0" in names
    else:
        is_supported = facing(planes, model.rotation[2]) is not None
    if model.has_support != is_supported:
        change = "gone" if model.has_support else "come"
        raise NoEnvironmentError(f"the support has {change}: the environment is modelled again")
    planes = with_edges(planes, [frame], model.noise, settings, rng)
    environment = replace(
        model.environment,
        planes=_placed(planes, names, model.rotation, model.translation, settings),
        boxes=(),
    )
    agreement = RayPlanes(planes, model.noise, settings).agreement(points.astype(np.float32))
    return replace(model, environment=environment, detected=tuple(planes), agreement=agreement)


def _named(
    planes: Sequence[DetectedPlane], model: EnvironmentModel
) -> tuple[list[DetectedPlane], list[str]]:
    """Sort planes, the support first, and give each the id of the one it was, or a new one; of the
    surfaces of one plane each is that of the nearest middle."""
    names = [""] * len(planes)
    for old, old_id in zip(model.detected, model.plane_ids, strict=True):
        middle = old.hull.mean(axis=0)
        same = [
            (float(np.linalg.norm(plane.hull.mean(axis=0) - middle)), k)
            for k, plane in enumerate(planes)
            if not names[k] and np.array_equal(plane.numbers, old.numbers)
        ]
        if same:
            names[min(same)[1]] = old_id
    numbers = [int(old_id.rsplit("_", 1)[1]) for old_id in model.plane_ids]
    number = 1 + max(numbers, default=0)
    for k, name in enumerate(names):
        if not name:
            names[k], number = f"plane_{number}", number + 1
    order = sorted(range(len(planes)), key=lambda k: (names[k] != "plane_0", k))
    return [planes[k] for k in order], [names[k] for k in order]


def _placed(
    planes: Sequence[DetectedPlane],
    names: Sequence[str],
    rotation: NDArray[np.float64],
    translation: NDArray[np.float64],
    settings: PerceptionSettings,
) -> tuple[Plane, ...]:
    """Planes of the sensor's frame in the environment's; the first part of one has its id."""
    return tuple(
        Plane(
            name if k == 0 else f"{name}/part_{k + 1}",
            settings.plane_material,
            rotation @ plane.normal,
            plane.offset + float(rotation @ plane.normal @ translation),
            None if sheet is None else sheet @ rotation.T + translation,
        )
        for plane, name in zip(planes, names, strict=True)
        for k, sheet in enumerate(plane.sheets)
    )


def _upward(
    planes: Sequence[DetectedPlane],
    settings: PerceptionSettings,
    up: ArrayLike | None,
    points: int,
    *,
    measured: bool,
    organised: bool,
) -> Upward:
    """Find up, and the supporting plane. A hint may be wrong, so a plane must agree with it; what
    was measured holds without one."""
    given = settings.up_hint if up is None else up
    if given is None and organised and settings.camera_upright:
        return upright(planes)
    if not planes and not (measured and organised):
        raise NoEnvironmentError(
            f"no plane holds {settings.plane_min_fraction:.0%} of the {points} points; "
            "expected a floor or table: turn the sensor to it or lower plane_min_fraction"
        )
    if given is None:
        return Upward(planes[0].normal, tuple(planes), True)
    direction = np.asarray(given, dtype=np.float64)
    sorted_planes = facing(planes, direction)
    if sorted_planes is not None:
        return Upward(sorted_planes[0].normal if up is None else direction, sorted_planes, True)
    if measured and organised:
        return Upward(direction, tuple(planes), False)
    named = ", ".join(f"{x:.2f}" for x in direction)
    raise NoEnvironmentError(
        f"none of {len(planes)} planes faces up, ({named}) in the sensor's frame, within "
        f"{UP_TOLERANCE:g}°; expected a floor or table: correct up_hint, or the "
        "orientation of the IMU"
    )


def _measured_noise(
    frames: Sequence[NDArray[np.float32]],
    planes: Sequence[DetectedPlane],
    assumed: RangeNoise,
    settings: PerceptionSettings,
    rng: np.random.Generator,
) -> RangeNoise:
    """Measure the range noise of the last frame on the points nearest to each plane, and how errors
    of neighbours go together in the last two; of a camera that moves, which shows the same scene in
    one frame only, on the planes."""
    if not settings.estimate_noise or not planes:
        return assumed
    points, errors = _errors_on_planes(fuse(frames[-1:], settings, rng), planes, assumed, settings)
    measured = assumed.measured(np.linalg.norm(points, axis=1), errors)
    if frames[-1].shape[0] == 1:
        return _scan_noise(measured, frames[-1], planes, settings, rng)
    if len(frames) < 2:
        readings = fuse(frames, settings, rng, frames[0][..., 0].size)
        points, errors = _scaled_errors(readings, planes, measured, settings)
        return measured.with_correlation_on_surfaces(points, errors, spacing_of(frames[0], rng))
    before, after = (np.linalg.norm(frame.astype(np.float64), axis=2) for frame in frames[-2:])
    return measured.with_correlation(before, after)


def _scan_noise(
    measured: RangeNoise,
    frame: NDArray[np.float32],
    planes: Sequence[DetectedPlane],
    settings: PerceptionSettings,
    rng: np.random.Generator,
) -> RangeNoise:
    """Noise of a cloud without pixels (1, n, 3), whose noise along the rays is known."""
    readings = fuse([frame], settings, rng, frame.shape[1])
    spacing = angle_between_readings(RangeCloud.of_scene(readings, measured, settings), rng)
    if spacing <= 0.0:
        return measured
    points, errors = _scaled_errors(readings, planes, measured, settings)
    measured = replace(
        measured,
        # A beam is about as wide as readings are apart, and its reading comes from anywhere in it.
        lateral=max(measured.lateral, 0.5 * spacing),
        between_lines=angle_between_lines(readings),
    )
    return measured.with_correlation_on_surfaces(points, errors, spacing)


def _scaled_errors(
    points: NDArray[np.float64],
    planes: Sequence[DetectedPlane],
    noise: RangeNoise,
    settings: PerceptionSettings,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points, of (n, 3), that lie on a plane, and their errors along their rays, in standard
    deviations."""
    on_planes, errors = _errors_on_planes(points, planes, noise, settings)
    return on_planes, errors / noise.deviation(np.linalg.norm(on_planes, axis=1))


def _errors_on_planes(
    points: NDArray[np.float64],
    planes: Sequence[DetectedPlane],
    noise: RangeNoise,
    settings: PerceptionSettings,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points, of (n, 3), that lie on a plane, and their errors along their rays, m."""
    ranges = np.linalg.norm(points, axis=1)
    normals = np.stack([plane.normal for plane in planes])
    along = points @ normals.T
    errors = along - np.array([plane.offset for plane in planes])
    errors -= np.column_stack([plane.heights(points) for plane in planes])
    nearest = np.abs(errors).argmin(axis=1)
    rows = np.arange(len(points))
    error, cosine = errors[rows, nearest], along[rows, nearest] / ranges
    # Grazing rays measure the plane's unevenness, not the noise along the ray.
    frontal = np.abs(cosine) > 0.25
    near = np.abs(error) < settings.plane_tolerance + settings.plane_sigmas * np.abs(
        cosine
    ) * noise.deviation(ranges)
    use = frontal & near
    return points[use], error[use] / cosine[use]


def _gravity_aligned(
    support: DetectedPlane | None, up: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Rotation and translation from the sensor's frame to the environment's."""
    optical, sideways = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])
    ahead = sideways if abs(optical @ up) > VERTICAL_VIEW_COSINE else optical
    x = ahead - (ahead @ up) * up
    x /= np.linalg.norm(x)
    rotation = np.stack([x, np.cross(up, x), up])
    if support is None:
        return rotation, np.zeros(3)
    # Straight down from the sensor the support is offset / (normal · up) along up.
    return rotation, np.array([0.0, 0.0, -support.offset / float(support.normal @ up)])
