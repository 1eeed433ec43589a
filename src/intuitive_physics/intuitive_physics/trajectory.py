"""Trajectories (Eq. 4), their time synchronisation (Eq. 5) and distances (Eqs. 6, 7)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.validation import finite_array, increasing_times, set_fields


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Positions of one object over time, T (Eq. 4).

    Parameters
    ----------
    times : (n_times,) s, strictly increasing
    positions : (n_times, 3) m
    """

    times: NDArray[np.float64]
    positions: NDArray[np.float64]

    def __init__(self, times: ArrayLike, positions: ArrayLike) -> None:
        checked_times = increasing_times(times, "trajectory times")
        checked_positions = finite_array(positions, "trajectory positions", (checked_times.size, 3))
        set_fields(self, times=checked_times, positions=checked_positions)

    def __len__(self) -> int:
        return int(self.times.size)

    @property
    def duration(self) -> float:
        """Time in s between the first and the last point."""
        return float(self.times[-1] - self.times[0])


def synchronise(a: Trajectory, b: Trajectory) -> tuple[Trajectory, Trajectory]:
    """Return `a` and T^c, `b` interpolated linearly at a's times (Eq. 5).

    Points of `a` outside the time span of `b` have no two neighbours there and are left out of
    both.

    Raises
    ------
    InvalidInputError
        When no point of `a` lies within the time span of `b`.
    """
    inside = (a.times >= b.times[0]) & (a.times <= b.times[-1])
    if not inside.any():
        raise InvalidInputError(
            f"trajectory spans {a.times[0]:.6g} to {a.times[-1]:.6g} s and the other "
            f"{b.times[0]:.6g} to {b.times[-1]:.6g} s; expected spans that overlap"
        )
    times = a.times[inside]
    interpolated = np.column_stack([np.interp(times, b.times, b.positions[:, k]) for k in range(3)])
    return Trajectory(times, a.positions[inside]), Trajectory(times, interpolated)


def mean_distance(a: Trajectory, b: Trajectory) -> float:
    """D̄ in m: mean distance of time-synchronised points (Eq. 6)."""
    return float(_point_distances(a, b).mean())


def max_distance(a: Trajectory, b: Trajectory) -> float:
    """D̂ in m: largest distance of time-synchronised points (Eq. 7)."""
    return float(_point_distances(a, b).max())


MEAN_DISTANCE, LARGEST_DISTANCE = "mean", "max"
"""Names of D̄ (Eq. 6) and D̂ (Eq. 7), where a user chooses one of them."""

DISTANCES = {MEAN_DISTANCE: mean_distance, LARGEST_DISTANCE: max_distance}
"""Distances of trajectories by name."""

DISTANCE_GUIDE = (
    "distance of two trajectories in the cost J: mean, that of all points (D̄ of the paper), or "
    "max, the largest of any point (D̂: for few and clean observations, as one outlier decides it)"
)
"""Explanation of the choices of the distance, for users."""


def _point_distances(a: Trajectory, b: Trajectory) -> NDArray[np.float64]:
    at, c = synchronise(a, b)
    return np.linalg.norm(at.positions - c.positions, axis=1)
