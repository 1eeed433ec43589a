"""Questions to a distribution: how likely is it, and when? (Sec. III-E)"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.regions import HalfSpaceRegion, Region
from intuitive_physics.validation import finite_float, unit_vector
from intuitive_physics_predictor.distribution import TrajectoryDistribution

TOUCH_TOLERANCE = 1e-3
"""m. Nearer than this is touching: what gravity bends a path by within a time step of 10 ms."""


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
    return _first(distribution, region.contains(distribution.of(object_id)))


def falls_below(
    distribution: TrajectoryDistribution, object_id: str, height: float, gravity: ArrayLike
) -> EventForecast:
    """Forecast when an object's centre is first lower than `height` (m above the frame's origin).

    Parameters
    ----------
    gravity : (3,) m/s², which says where up is
    """
    up = -unit_vector(gravity, "gravity")
    return enters_region(
        distribution, object_id, HalfSpaceRegion(up, finite_float(height, "height"))
    )


def touches_object(
    distribution: TrajectoryDistribution, object_id: str, other_id: str, reach: float
) -> EventForecast:
    """Forecast when two objects first come as near as `reach` (m between their centres)."""
    if object_id == other_id:
        raise InvalidInputError(f"both objects are {object_id!r}; expected two different ones")
    apart = distribution.of(object_id) - distribution.of(other_id)
    near = _nearest_approach(apart, distribution.times) <= reach + TOUCH_TOLERANCE
    return _first(distribution, near)


def _nearest_approach(
    apart: NDArray[np.float64], times: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Distance that two objects come near to each other until each time, since the one before.

    Two that bounce off each other between two output times are seen apart at both. So the motion
    before each interval is also carried on through it, as if nothing were in the way.

    Parameters
    ----------
    apart : (n_samples, n_times, 3) m
    """
    nearest = np.linalg.norm(apart, axis=-1)
    if times.size > 1:
        moves = np.diff(apart, axis=1)
        passing = _distance_to_path(apart[:, :-1], moves)
        carried_on = moves[:, :-1] * (np.diff(times)[1:] / np.diff(times)[:-1])[:, None]
        passing[:, 1:] = np.minimum(passing[:, 1:], _distance_to_path(apart[:, 1:-1], carried_on))
        nearest[:, 1:] = np.minimum(nearest[:, 1:], passing)
    return nearest


def _distance_to_path(
    starts: NDArray[np.float64], moves: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Distance from the origin to the straight paths start … start + move, arrays (…, 3)."""
    squares = np.maximum((moves**2).sum(axis=-1), 1e-300)
    part = np.clip(-(starts * moves).sum(axis=-1) / squares, 0.0, 1.0)
    return np.asarray(np.linalg.norm(starts + part[..., None] * moves, axis=-1))


def _first(distribution: TrajectoryDistribution, happens: NDArray[np.bool_]) -> EventForecast:
    """Forecast from whether it is so, (n_samples, n_times)."""
    ever = happens.any(axis=1)
    when = distribution.times[happens.argmax(axis=1)][ever]
    order = np.argsort(when, kind="stable")
    weights = distribution.weights[ever][order]
    return EventForecast(float(weights.sum()), when[order], weights)
