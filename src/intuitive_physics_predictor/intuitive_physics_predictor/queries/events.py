"""Questions to a distribution: how likely is it, when, and where is an object best caught?"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.errors import InvalidInputError, UnknownNameError
from intuitive_physics.geometry.gaps import Body, gap_between, gap_to_plane
from intuitive_physics.regions import BoxRegion, HalfSpaceRegion, Region
from intuitive_physics.scene import Plane, Scene
from intuitive_physics.shapes import Box, Sphere
from intuitive_physics.validation import (
    finite_float,
    non_negative_float,
    positive_float,
    unit_vector,
)
from intuitive_physics_predictor.distribution import TrajectoryDistribution

PARTS = 8
"""Parts of the path between two output times: a fast object crosses a small region. Our choice."""

REST_DISTANCE = 1e-3
"""m that an object at rest, its surface included, stays within of where it ends."""

REST_TIME = 0.2
"""s for which it has to, else it is only just slow, as at the top of a throw."""

TOUCH_TOLERANCE = 1e-3
"""m. Nearer than this is touching: what gravity bends a path by within a time step of 10 ms."""

TOUCH_PARTS = 8
"""Parts of the time between two outputs where a touch is possible. Our choice."""

Gap = Callable[[list[Body]], NDArray[np.float64]]
"""Gap between bodies at the poses they are given with."""


@dataclass(frozen=True, eq=False)
class EventForecast:
    """Chance and time of an event.

    Parameters
    ----------
    probability : weight of the samples in which it happens within the horizon
    times : (n,) s, ascending, when it first happens in each of those samples
    weights : (n,), of those samples, summing to `probability`
    """

    probability: float
    times: NDArray[np.float64]
    weights: NDArray[np.float64]


def enters_region(
    distribution: TrajectoryDistribution, object_id: str, region: Region
) -> EventForecast:
    """Forecast when an object's centre is first inside a region."""
    paths, times = _finer(distribution.of(object_id)), _finer(distribution.times[None, :, None])
    return _first(distribution, region.contains(paths), times[0, :, 0])


def falls_below(
    distribution: TrajectoryDistribution, object_id: str, height: float, gravity: ArrayLike
) -> EventForecast:
    """Forecast when an object's centre is first lower than `height` (m above the frame's origin).

    gravity (3,) m/s² gives the direction of up.
    """
    up = -unit_vector(gravity, "gravity")
    return enters_region(
        distribution, object_id, HalfSpaceRegion(up, finite_float(height, "height"))
    )


def touches(
    distribution: TrajectoryDistribution, scene: Scene, object_id: str, other_id: str
) -> EventForecast:
    """Forecast when an object first touches another, a plane or a static box of its scene.

    See `touching`.
    """
    happens = touching(distribution, scene, object_id, other_id)
    return _first(distribution, happens, distribution.times)


def comes_to_rest(
    distribution: TrajectoryDistribution, scene: Scene, object_id: str
) -> EventForecast:
    """Forecast when an object begins to lie still until the horizon.

    A sphere may spin on the spot, which changes nothing visible. Other shapes need a distribution
    with orientations.
    """
    paths = distribution.of(object_id)
    away = np.linalg.norm(paths - paths[:, -1:], axis=-1)
    shape = scene.objects[distribution.index(object_id)].shape
    if distribution.orientations is not None and not isinstance(shape, Sphere):
        turned = distribution.orientations[:, distribution.index(object_id)]
        cosine = np.abs((turned * turned[:, -1:]).sum(axis=-1))
        away = away + shape.bounding_radius * 2.0 * np.arccos(np.minimum(cosine, 1.0))
    still = np.logical_and.accumulate((away <= REST_DISTANCE)[:, ::-1], axis=1)[:, ::-1]
    still &= distribution.times <= distribution.times[-1] - REST_TIME
    return _first(distribution, still, distribution.times)


def _finer(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values (n, n_times, …) with as many more on the straight way between each two as PARTS."""
    starts, steps = values[:, :-1, None], np.diff(values, axis=1)[:, :, None]
    between = starts + np.arange(PARTS)[:, None] / PARTS * steps
    return np.concatenate([between.reshape(len(values), -1, values.shape[2]), values[:, -1:]], 1)


def _first(
    distribution: TrajectoryDistribution,
    happens: NDArray[np.bool_],
    times: NDArray[np.float64],
) -> EventForecast:
    """Forecast from whether it is so, (n_samples, n), at `times` (n,)."""
    ever = happens.any(axis=1)
    when = times[happens.argmax(axis=1)][ever]
    order = np.argsort(when, kind="stable")
    weights = distribution.weights[ever][order]
    return EventForecast(float(weights.sum()), when[order], weights)


def joined_forecasts(parts: Sequence[EventForecast]) -> EventForecast:
    """Return the forecast of all samples from those of parts of them, in the samples' order."""
    times = np.concatenate([part.times for part in parts])
    order = np.argsort(times, kind="stable")
    weights = np.concatenate([part.weights for part in parts])[order]
    return EventForecast(float(weights.sum()), times[order], weights)


def touching(
    distribution: TrajectoryDistribution, scene: Scene, object_id: str, other_id: str
) -> NDArray[np.bool_]:
    """Whether an object touches another body since the output time before.

    Two that bounce off each other between two output times are apart at both. So where they are
    near enough, the motion before an interval is also carried on through it, as if nothing were in
    the way.

    Parameters
    ----------
    distribution : with orientations
    scene : it was predicted from
    other_id : of an object, or of a plane or static box of the environment

    Returns
    -------
    (n_samples, n_times)

    Raises
    ------
    UnknownNameError
        When there is nothing of that name.
    InvalidInputError
        When both are the same.
    """
    if object_id == other_id:
        raise InvalidInputError(f"both objects are {object_id!r}; expected two different ones")
    bodies = [_path(distribution, scene, object_id)]
    if other_id in distribution.object_ids:
        bodies.append(_path(distribution, scene, other_id))
        return _near(bodies, lambda moved: gap_between(*moved))
    primitive = _primitive(scene, other_id)
    if isinstance(primitive, Plane):
        plane = primitive
        return _near(bodies, lambda moved: gap_to_plane(moved[0], plane))
    return _near(bodies, lambda moved: gap_between(moved[0], primitive))


def _path(distribution: TrajectoryDistribution, scene: Scene, object_id: str) -> Body:
    i = distribution.index(object_id)
    if distribution.orientations is None:
        raise InvalidInputError("distribution has no orientations; expected a prediction of them")
    return Body(
        scene.objects[i].shape, distribution.positions[:, i], distribution.orientations[:, i]
    )


def _primitive(scene: Scene, name: str) -> Plane | Body:
    environment = scene.environment
    for plane in environment.planes:
        if plane.id == name:
            return plane
    for box in environment.boxes:
        if box.id == name:
            return Body(Box(tuple(box.edge_lengths.tolist())), box.center, box.orientation)
    names = [
        *(scene_object.id for scene_object in scene.objects),
        *(plane.id for plane in environment.planes),
        *(box.id for box in environment.boxes),
    ]
    raise UnknownNameError(f"other is {name!r}; expected one of {', '.join(names)}")


def _near(bodies: list[Body], gap: Gap) -> NDArray[np.bool_]:
    """Whether the gap of moving bodies is closed since the output time before."""
    gaps = gap(bodies)
    near = gaps <= TOUCH_TOLERANCE
    times = gaps.shape[1]
    if times < 2:
        return near
    steps = sum(
        np.linalg.norm(np.diff(body.positions, axis=1), axis=-1)
        + body.shape.bounding_radius * _turns(body.orientations)
        for body in bodies
    )
    # What was as fast before or after as in between may come so near to the other and back.
    most = np.maximum(steps, np.maximum(np.roll(steps, 1, axis=1), np.roll(steps, -1, axis=1)))
    smallest = np.minimum(gaps[:, 1:], gaps[:, :-1])
    sample, k = np.nonzero((smallest <= most + TOUCH_TOLERANCE) & ~near[:, 1:])
    closed = np.zeros(sample.size, dtype=bool)
    for part in np.arange(1, TOUCH_PARTS) / TOUCH_PARTS:
        closed |= gap([_between(b, sample, k, k + 1, part) for b in bodies]) <= TOUCH_TOLERANCE
        for before, after, share in _carried_on(k, times, part):
            moved = [_between(body, sample, before, after, share) for body in bodies]
            closed |= gap(moved) <= TOUCH_TOLERANCE
    near[sample[closed], k[closed] + 1] = True
    return near


def _carried_on(
    k: NDArray[np.int64], times: int, part: float
) -> list[tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]]:
    """Output times between which motion is known, and where on it an interval's part would be.

    The motion of the interval before is carried on; into the first one that of the next, back.
    """
    if times < 3:
        return []
    first = k == 0
    before = np.where(first, 1, k - 1)
    share = np.where(first, part - 1.0, 1.0 + part)
    return [(before, before + 1, share)]


def _between(
    body: Body,
    sample: NDArray[np.int64],
    before: NDArray[np.int64],
    after: NDArray[np.int64],
    share: NDArray[np.float64] | float,
) -> Body:
    """Poses on the straight way from one output time to another; a share above 1 is beyond it."""
    u = np.broadcast_to(share, sample.shape)[:, None]
    start, end = body.positions[sample, before], body.positions[sample, after]
    q, p = body.orientations[sample, before], body.orientations[sample, after]
    p = p * np.where((q * p).sum(axis=-1, keepdims=True) < 0.0, -1.0, 1.0)
    turned = q + u * (p - q)
    turned = turned / np.linalg.norm(turned, axis=-1, keepdims=True)
    return Body(body.shape, start + u * (end - start), turned)


def _turns(orientations: NDArray[np.float64]) -> NDArray[np.float64]:
    """Angles in rad between neighbours along axis 1."""
    cosine = np.abs((orientations[:, 1:] * orientations[:, :-1]).sum(axis=-1))
    return np.asarray(2.0 * np.arccos(np.minimum(cosine, 1.0)))


LARGEST_SQUARES = 1_000_000
"""Distances of places and samples that are held at once, 30 MB. Our choice."""

MOST_PLACES = 64
"""Samples whose positions are tried as places: probabilities a few % apart are distinguished."""


@dataclass(frozen=True, eq=False)
class Interception:
    """The best place and time to wait for an object.

    Parameters
    ----------
    probability : weight of the samples that are within reach of the place at the time; 0: no sample
        comes into the box, and place and time mean nothing
    position : (3,) m, in the box
    time : s
    """

    probability: float
    position: NDArray[np.float64]
    time: float


def best_interception(
    distribution: TrajectoryDistribution,
    object_id: str,
    reachable: BoxRegion,
    reach: float,
    *,
    earliest: float = 0.0,
) -> Interception:
    """Find the place in a box, and the time, that an object is most likely within reach of.

    Where several are as likely, the one whose samples lie closest together, then the earliest.

    Parameters
    ----------
    reachable : where the hand can be
    reach : m, from the hand's centre to the object's where it still catches
    earliest : s, before which the hand cannot be anywhere
    """
    reach = positive_float(reach, "reach")
    earliest = non_negative_float(earliest, "earliest time")
    paths = distribution.of(object_id)
    times = np.flatnonzero(distribution.times >= earliest)
    if times.size == 0:
        raise InvalidInputError(
            f"earliest time is {earliest:g} s; expected at most the horizon, "
            f"{distribution.times[-1]:g} s"
        )
    best = Interception(0.0, np.array(reachable.center), float(distribution.times[times[0]]))
    least_spread = np.inf
    for k in times:
        candidate = _best_place(paths[:, k], distribution.weights, reachable, reach)
        if candidate is None:
            continue
        probability, spread, position = candidate
        gain = probability - best.probability
        if gain > 1e-9 or (gain > -1e-9 and spread < 0.99 * least_spread):
            best = Interception(probability, position, float(distribution.times[k]))
            least_spread = spread
    return best


def _best_place(
    points: NDArray[np.float64],
    weights: NDArray[np.float64],
    reachable: BoxRegion,
    reach: float,
) -> tuple[float, float, NDArray[np.float64]] | None:
    """Chance, mean square distance (m²) and place of the best place among points (n, 3)."""
    inside = points[reachable.contains(points)][:MOST_PLACES]
    if not len(inside):
        return None
    together = max(1, LARGEST_SQUARES // len(points))
    by_place = [
        _caught(_squares(inside[i : i + together], points), weights, reach)
        for i in range(0, len(inside), together)
    ]
    place = inside[int(np.concatenate(by_place).argmax())]
    # The middle of what that place catches lies in the box too, and may catch more.
    caught = _squares(place[None], points)[0] <= reach**2
    middle = np.average(points[caught], axis=0, weights=weights[caught])
    both = np.stack([place, middle] if reachable.contains(middle[None])[0] else [place])
    squares = _squares(both, points)
    chances = _caught(squares, weights, reach)
    winner = len(both) - 1 if chances[-1] >= chances[0] else 0
    held = squares[winner] <= reach**2
    spread = float(np.average(squares[winner][held], weights=weights[held]))
    return float(chances[winner]), spread, both[winner]


def _squares(places: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    return ((places[:, None] - points[None]) ** 2).sum(axis=-1)


def _caught(
    squares: NDArray[np.float64], weights: NDArray[np.float64], reach: float
) -> NDArray[np.float64]:
    return (squares <= reach**2) @ weights
