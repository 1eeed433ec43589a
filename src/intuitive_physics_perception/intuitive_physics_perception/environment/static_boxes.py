"""Static boxes that objects bounce off: what stands in the scene from the start and is no plane."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.geometry.rotations import rotation_matrix
from intuitive_physics.kernels import allocating_entry, kernel
from intuitive_physics.scene import StaticBox
from intuitive_physics_perception.detection.foreground import Clusters, ForegroundFinder
from intuitive_physics_perception.detection.solids import SolidFinder, holds
from intuitive_physics_perception.detection.spheres import SphereFinder
from intuitive_physics_perception.environment.environment_model import EnvironmentModel
from intuitive_physics_perception.environment.fusion import MAX_EDGE_POINTS, fused_frame
from intuitive_physics_perception.environment.range_cloud import convex_hull
from intuitive_physics_perception.settings import PerceptionSettings

MIN_SIZE = 0.04
"""Smallest length of the longest edge of a box, m: anything smaller is noise at an edge."""

MIN_THICKNESS = 0.02
"""Smallest thickness of a box, m: only the face of a thinner one is visible. With two shorter edges
it is an edge of something or noise, and no box."""

RAYS_THROUGH = 30
"""Number of rays that pass under an object from which on it does not stand there."""

OUTSIDE_FRACTION = 0.01
"""Part of the points that may lie outside at each face, as flying pixels do."""

STANDING_GAP = 0.1
"""Largest distance between a floor and the lowest reading of an object that stands on it, m."""

LEVEL_ANGLE = 10.0
"""Largest tilt of a plane on which boxes stand, degrees."""

FILLED_DIAGONAL = 0.4
"""Part of a box's diagonal that a cluster must extend over to be the box: a smaller cluster may be
an object before or within a rough box."""

STRAY_FRACTION = 0.005
"""Part of the readings on a box that noise puts outside of it."""

CHECKED_POINTS = 1500
"""Largest number of readings of a cluster that are checked."""

SAME_PART = 0.2
"""Part of its diagonal by which a box that is seen again may differ in place and edges."""


def with_static_boxes(
    model: EnvironmentModel,
    frames: Sequence[NDArray[np.float32]],
    settings: PerceptionSettings,
    rng: np.random.Generator,
    old_boxes: Sequence[StaticBox] = (),
) -> EnvironmentModel:
    """Return a model with a box around all that stands still and is no object, where such boxes are
    asked for.

    `frames` (height, width, 3) m each, those the model was made from; `old_boxes`: boxes that
    were there before: what still stands as it did keeps its place and its id.
    """
    if not settings.static_boxes:
        return model
    whole = np.ascontiguousarray(fused_frame(frames, frames[0].size), dtype=np.float32)
    balls = _places_of_spheres(model, whole, settings, rng)
    frame = np.ascontiguousarray(fused_frame([whole], MAX_EDGE_POINTS), dtype=np.float32)
    points = frame.reshape(-1, 3)
    boxes: list[StaticBox] = []
    for indices in ForegroundFinder(model, settings).find(frame).indices:
        box = _box_around(f"box_{len(boxes)}", model, points[indices], settings)
        if box is not None and not any(holds(box, place) for place in balls):
            boxes.append(_down_to_floor(box, model, points))
    if settings.solids_are_objects:
        boxes = _without_objects(boxes, model, frames, settings, rng)
    boxes = _with_old_ids(boxes, old_boxes)
    return replace(model, environment=replace(model.environment, boxes=tuple(boxes)))


def _with_old_ids(boxes: Sequence[StaticBox], old_boxes: Sequence[StaticBox]) -> list[StaticBox]:
    """Boxes, of which those that were there before stay as they were; the others get new ids."""
    number = 1 + max((int(box.id.rsplit("_", 1)[1]) for box in old_boxes), default=-1)
    left, results = list(old_boxes), []
    for box in boxes:
        same = [old for old in left if _difference(box, old) < SAME_PART]
        if same:
            nearest = min(same, key=lambda old: _difference(box, old))
            left.remove(nearest)
            results.append(nearest)
        else:
            results.append(replace(box, id=f"box_{number}"))
            number += 1
    return results


def _difference(box: StaticBox, other: StaticBox) -> float:
    """Distance of two boxes' centres, or sorted edges, in diagonals of the other one."""
    edges = np.sort(box.edge_lengths) - np.sort(other.edge_lengths)
    apart = max(np.linalg.norm(box.center - other.center), np.abs(edges).max())
    return float(apart / np.linalg.norm(other.edge_lengths))


def _places_of_spheres(
    model: EnvironmentModel,
    frame: NDArray[np.float32],
    settings: PerceptionSettings,
    rng: np.random.Generator,
) -> list[NDArray[np.float64]]:
    """Means (3,) m of the clusters of a frame (height, width, 3) m that hold a sphere, in the
    environment's frame."""
    clusters = ForegroundFinder(model, settings).find(frame)
    parts = SphereFinder(model, settings, rng).find(frame, clusters)
    points = frame.reshape(-1, 3)
    middles = [points[part.cluster].mean(axis=0) for part in parts if part.spheres]
    return [model.to_environment(middle) for middle in middles]


def _without_objects(
    boxes: Sequence[StaticBox],
    model: EnvironmentModel,
    frames: Sequence[NDArray[np.float32]],
    settings: PerceptionSettings,
    rng: np.random.Generator,
) -> list[StaticBox]:
    """Boxes in which no frame, which unlike the fused one has all its readings, shows the centre of
    a box or capsule."""
    foreground, finder = ForegroundFinder(model, settings), SolidFinder(model, settings, rng)
    solids = [
        solid
        for frame in frames
        for solid in finder.find(frame, foreground.find(frame).indices)
        if solid is not None
    ]
    centers = [model.to_environment(solid.center) for solid in solids]
    return [box for box in boxes if not any(holds(box, center) for center in centers)]


def _box_around(
    name: str, model: EnvironmentModel, points: NDArray[np.float32], settings: PerceptionSettings
) -> StaticBox | None:
    """The smallest upright box around the readings of a cluster, down to what it stands on; None
    where it is too small or too large."""
    places = model.to_environment(points)
    rectangle = _smallest_rectangle(places[:, :2])
    if rectangle is None:
        return None
    middle, turn, size = rectangle
    low, high = np.quantile(places[:, 2], [OUTSIDE_FRACTION, 1.0 - OUTSIDE_FRACTION])
    low = _floor_below(model, np.append(middle, low))
    edges = np.append(size, high - low)
    thinnest, second, longest = np.sort(edges)
    if not MIN_SIZE <= longest <= settings.static_box_max_size or thinnest <= 0.0:
        return None
    if second < MIN_THICKNESS:
        return None
    center, edges = _thickened(np.append(middle, 0.5 * (low + high)), edges, turn, model)
    # A turn about z.
    orientation = (0.0, 0.0, np.sin(0.5 * turn), np.cos(0.5 * turn))
    return StaticBox(name, settings.plane_material, center, orientation, edges)


def _thickened(
    center: NDArray[np.float64], edges: NDArray[np.float64], turn: float, model: EnvironmentModel
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Centre and edges (3,) of a box that is at least `MIN_THICKNESS` thick: what is seen of a
    thinner one is a face, and it goes on behind that."""
    c, s = np.cos(turn), np.sin(turn)
    axes = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    center, edges = center.copy(), edges.copy()
    for k, axis in enumerate(axes):
        missing = MIN_THICKNESS - edges[k]
        if missing > 0.0:
            away = np.sign(axis @ (center - model.translation)) or 1.0
            center += 0.5 * missing * away * axis
            edges[k] = MIN_THICKNESS
    return center, edges


def _down_to_floor(
    box: StaticBox, model: EnvironmentModel, points: NDArray[np.float32]
) -> StaticBox:
    """The box on the level plane below it, unless readings (n, 3) m show that nothing is between:
    what stands still in the air is the top of something."""
    top = float(box.center[2] + 0.5 * box.edge_lengths[2])
    bottom = float(box.center[2] - 0.5 * box.edge_lengths[2])
    floors = [height for height in _floors_at(model, box.center) if height < bottom]
    if not floors or bottom - max(floors) <= MIN_THICKNESS:
        return box
    edges = np.append(box.edge_lengths[:2], top - max(floors))
    center = np.append(box.center[:2], 0.5 * (top + max(floors)))
    gap = replace(
        box,
        center=np.append(center[:2], 0.5 * (bottom + max(floors))),
        edge_lengths=np.append(0.8 * edges[:2], 0.8 * (bottom - max(floors))),
    )
    # What is known again by how far it extends must not be mostly unseen.
    seen_part = float(np.linalg.norm(box.edge_lengths) / np.linalg.norm(edges))
    if seen_part < 1.5 * FILLED_DIAGONAL or (_rays_through(gap, model, points) >= RAYS_THROUGH):
        return box
    return replace(box, center=center, edge_lengths=edges)


def _rays_through(box: StaticBox, model: EnvironmentModel, points: NDArray[np.float32]) -> int:
    """Number of rays of readings (n, 3), in m, through a box."""
    axes = rotation_matrix(box.orientation)
    ends = (model.to_environment(points[np.isfinite(points[:, 2])]) - box.center) @ axes
    start = (model.translation - box.center) @ axes
    half = 0.5 * np.asarray(box.edge_lengths)
    with np.errstate(divide="ignore", invalid="ignore"):
        first, second = ((side * half - start) / (ends - start) for side in (-1.0, 1.0))
    enter = np.fmin(first, second).max(axis=1)
    leave = np.fmax(first, second).min(axis=1)
    return int(np.count_nonzero((enter < leave) & (enter > 0.0) & (leave < 1.0)))


def _smallest_rectangle(
    places: NDArray[np.float64],
) -> tuple[NDArray[np.float64], float, NDArray[np.float64]] | None:
    """Centre (2,), angle and edge lengths (2,) of the smallest rectangle around most places (n, 2):
    one of its sides lies along their convex hull."""
    hull = convex_hull(places)
    if hull is None:
        return None
    best, least = None, np.inf
    for along in np.roll(hull, -1, axis=0) - hull:
        turn = float(np.arctan2(along[1], along[0]))
        axes = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
        low, high = np.quantile(places @ axes.T, [OUTSIDE_FRACTION, 1.0 - OUTSIDE_FRACTION], axis=0)
        area = float((high - low).prod())
        if area < least:
            best, least = (0.5 * (low + high) @ axes, turn, high - low), area
    return best


def _floor_below(model: EnvironmentModel, lowest: NDArray[np.float64]) -> float:
    """Height of the level plane little below a place (3,), or of the place itself."""
    below = [
        height for height in _floors_at(model, lowest) if abs(lowest[2] - height) < STANDING_GAP
    ]
    return max(below, default=float(lowest[2]))


def _floors_at(model: EnvironmentModel, place: NDArray[np.float64]) -> list[float]:
    """Heights of the level planes above and below a place (3,), m."""
    smallest_cosine = float(np.cos(np.radians(LEVEL_ANGLE)))
    return [
        float(place[2] - plane.signed_distances(place) / plane.normal[2])
        for plane in model.environment.planes
        if plane.normal[2] > smallest_cosine and plane.covers(place)
    ]


class StaticBoxFilter:
    """Knows the static boxes of one environment again."""

    def __init__(self, model: EnvironmentModel, settings: PerceptionSettings) -> None:
        self._settings = settings
        boxes = model.environment.boxes
        self._centers = np.array([box.center for box in boxes]).reshape(-1, 3)
        self._rotations = np.array([rotation_matrix(box.orientation) for box in boxes])
        self._halves = 0.5 * np.array([box.edge_lengths for box in boxes]).reshape(-1, 3)
        self.look_from(model)

    def look_from(self, model: EnvironmentModel) -> None:
        """Take the same environment as the sensor sees it now."""
        self._model = model

    def without(self, points: NDArray[np.float32], clusters: Clusters) -> Clusters:
        """Return clusters of a frame of points (height, width, 3) less those that are a box."""
        if not len(self._centers):
            return clusters
        order, starts = clusters.in_a_row
        model, settings = self._model, self._settings
        allowed = settings.min_points + STRAY_FRACTION * np.diff(starts)
        # What is new is no box from the start, wherever it lies.
        allowed[clusters.new] = 0.0
        out, extents = _outside_boxes(
            points.reshape(-1, 3),
            order,
            starts,
            allowed,
            (model.rotation, model.translation),
            (*model.noise.squares[:3], settings.plane_tolerance, settings.plane_sigmas),
            self._centers,
            self._rotations,
            self._halves,
        )
        diagonals = 2.0 * np.linalg.norm(self._halves, axis=1)
        fills = (extents > FILLED_DIAGONAL * diagonals).any(axis=1)
        there = fills & (out < allowed)
        if not there.any():
            return clusters
        kept = np.flatnonzero(~there)
        return replace(
            clusters,
            indices=[clusters.indices[k] for k in kept],
            new=[clusters.new[k] for k in kept],
        )


@allocating_entry
def _outside_boxes(
    points: Any,
    order: Any,
    starts: Any,
    allowed: Any,
    pose: Any,
    limits: Any,
    centers: Any,
    rotations: Any,
    halves: Any,
) -> tuple[Any, Any]:
    """Count the points (n,) of each cluster that lie in no box, give or take a margin, and measure
    the diagonal (n, n_boxes) m, along its axes, of what lies in each box. Of large clusters every
    k-th point is tested. A cluster is left as soon as `allowed` (n,) points lie in no box, so that
    both are then those of the points tested by then.

    `points` (m, 3) m; `order` and `starts` as in `Clusters.in_a_row`; `pose`: rotation (3, 3) and
    translation (3,) m to the boxes' frame; `limits`: squares of the noise's parameters, tolerance
    in m and standard deviations of the margin.
    """
    rotation, translation = pose
    out = np.zeros(starts.size - 1, dtype=np.int64)
    extents = np.zeros((starts.size - 1, centers.shape[0]))
    low, high = np.empty(centers.shape), np.empty(centers.shape)
    local, place = np.empty(3), np.empty(3)
    for n in range(starts.size - 1):
        low[:], high[:] = np.inf, -np.inf
        every = (starts[n + 1] - starts[n]) // CHECKED_POINTS + 1
        for i in range(starts[n], starts[n + 1], every):
            if out[n] >= allowed[n]:
                break
            x, y, z = points[order[i], 0], points[order[i], 1], points[order[i], 2]
            range2 = x * x + y * y + z * z
            deviation = np.sqrt(min(limits[0] + limits[1] * range2 * range2, limits[2]))
            margin = limits[3] + limits[4] * deviation
            for a in range(3):
                place[a] = rotation[a, 0] * x + rotation[a, 1] * y + rotation[a, 2] * z
                place[a] += translation[a]
            inside_any = False
            for k in range(centers.shape[0]):
                if _is_inside(place, centers[k], rotations[k], halves[k], margin, local):
                    inside_any = True
                    for a in range(3):
                        low[k, a] = min(low[k, a], local[a])
                        high[k, a] = max(high[k, a], local[a])
            out[n] += 0 if inside_any else every
        for k in range(centers.shape[0]):
            if high[k, 0] >= low[k, 0]:
                extents[n, k] = np.sqrt(np.sum((high[k] - low[k]) ** 2))
    return out, extents


@kernel
def _is_inside(
    place: Any, center: Any, rotation: Any, halves: Any, margin: float, local: Any
) -> bool:
    """Whether a place lies in a box, within a margin; writes where along its axes."""
    dx, dy, dz = place[0] - center[0], place[1] - center[1], place[2] - center[2]
    for a in range(3):
        local[a] = dx * rotation[0, a] + dy * rotation[1, a] + dz * rotation[2, a]
        if abs(local[a]) > halves[a] + margin:
            return False
    return True
