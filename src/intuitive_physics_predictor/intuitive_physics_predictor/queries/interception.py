"""Where and when to wait for an object: the place that most samples pass."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.regions import BoxRegion
from intuitive_physics.validation import non_negative_float, positive_float
from intuitive_physics_predictor.distribution import TrajectoryDistribution

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
        found = _best_place(paths[:, k], distribution.weights, reachable, reach)
        if found is None:
            continue
        probability, spread, position = found
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
    squares = _squares(inside, points)
    place = inside[int(_caught(squares, weights, reach).argmax())]
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
