"""Questions to a distribution: how likely is it, and when? (Sec. III-E)"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.regions import HalfSpaceRegion, Region
from intuitive_physics.scene import Scene
from intuitive_physics.shapes import Sphere
from intuitive_physics.validation import finite_float, unit_vector
from intuitive_physics_predictor.distribution import TrajectoryDistribution
from intuitive_physics_predictor.queries.touching import touching

PARTS = 8
"""Into which the way between two output times is cut: a fast object crosses a small region."""

REST_DISTANCE = 1e-3
"""m that an object at rest, its surface included, stays within of where it ends."""
REST_TIME = 0.2
"""s for which it has to, else it is only just slow, as at the top of a throw."""


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

    Parameters
    ----------
    gravity : (3,) m/s², which says where up is
    """
    up = -unit_vector(gravity, "gravity")
    return enters_region(
        distribution, object_id, HalfSpaceRegion(up, finite_float(height, "height"))
    )


def touches(
    distribution: TrajectoryDistribution, scene: Scene, object_id: str, other_id: str
) -> EventForecast:
    """Forecast when an object first touches another, a plane or a static box of its scene.

    Parameters and errors as `touching`.
    """
    happens = touching(distribution, scene, object_id, other_id)
    return _first(distribution, happens, distribution.times)


def comes_to_rest(
    distribution: TrajectoryDistribution, scene: Scene, object_id: str
) -> EventForecast:
    """Forecast when an object begins to lie still until the horizon.

    A sphere may spin on the spot, which nobody sees.

    Parameters
    ----------
    distribution : with orientations where the object is not a sphere
    scene : it was predicted from
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
