"""J(θ_s), the cost of Eqs. 8 and 9: mean distance between simulated and observed trajectories."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.materials import StaticParameters
from intuitive_physics.observation import Observation, observation_materials
from intuitive_physics.simulation import Simulator, WorldBatch, WorldStatus, pack_worlds
from intuitive_physics_learner.errors import NoObservationsError

FAILED_DISTANCE = 1000.0
"""D̄ in m of each object of a world that did not simulate to its end; no distance counts more."""

START_TOLERANCE = 1e-6
"""s; a point this little before the start was seen at the start: stamps and clocks are rounded."""

LARGEST_CHUNK = 4_000_000
"""Coordinates simulated in one call at most, to bound the memory: 32 MB of positions."""


class TrajectoryCost:
    """J of any θ_s over a fixed set of observations, packed once for many evaluations.

    The simulator is asked at the very times at which the objects were seen, so the interpolation
    of Eq. 5 has nothing left to do. Points before an observation's start time are left out, as
    `trajectory.synchronise` leaves out points that the simulated trajectory does not span.

    Parameters
    ----------
    observations : Y, at least one
    simulator : the engine that makes X
    materials : of the θ_s that will be judged, in their order; by default those of the observations

    Attributes
    ----------
    materials : names
    trajectory_observation : (n_trajectories,) index of the observation each trajectory is from
    trajectory_object : (n_trajectories,) index of its object in that observation
    point_trajectory : (n_points,) index of the trajectory each point of `residuals` is from; the
        points of a trajectory stand together, in the order of their times
    """

    def __init__(
        self,
        observations: Sequence[Observation],
        simulator: Simulator,
        materials: Sequence[str] | None = None,
    ) -> None:
        if len(observations) == 0:
            raise NoObservationsError("there are no observations; expected at least one")
        self.materials = tuple(materials or observation_materials(observations))
        self._simulator = simulator
        owners = [(i, j) for i, seen in enumerate(observations) for j in range(len(seen.objects))]
        self.trajectory_observation = np.array([i for i, _ in owners])
        self.trajectory_object = np.array([j for _, j in owners])
        first = {i: k for k, (i, j) in enumerate(owners) if j == 0}
        self._observation_count = len(observations)
        neutral = StaticParameters.uniform(self.materials)
        self._groups = [
            _pack_group([observations[i] for i in members], [first[i] for i in members], neutral)
            for members in _alike(observations)
        ]
        self.point_trajectory = np.concatenate([group.point_trajectory for group in self._groups])

    def costs(self, candidates: Sequence[StaticParameters]) -> NDArray[np.float64]:
        """J of each candidate (Eq. 8), shape (n_candidates,), in m."""
        return self.distances(candidates).mean(axis=1)

    def observation_costs(self, candidates: Sequence[StaticParameters]) -> NDArray[np.float64]:
        """Mean D̄ over the objects of each observation, shape (n_candidates, n_observations), m."""
        distances = self.distances(candidates)
        objects = np.bincount(self.trajectory_observation, minlength=self._observation_count)
        sums = np.zeros((len(distances), self._observation_count))
        np.add.at(sums.T, self.trajectory_observation, distances.T)
        return sums / objects

    def distances(self, candidates: Sequence[StaticParameters]) -> NDArray[np.float64]:
        """D̄ (Eq. 6) of each trajectory, shape (n_candidates, n_trajectories), in m."""
        distances = np.empty((len(candidates), self.trajectory_observation.size))
        for group in self._groups:
            for part, offsets, failed in self._simulated(group, candidates):
                means = _mean_lengths(offsets, group.seen)
                means[failed] = FAILED_DISTANCE
                means = np.nan_to_num(means, nan=FAILED_DISTANCE, posinf=FAILED_DISTANCE)
                means = np.minimum(means, FAILED_DISTANCE)
                distances[part, group.trajectories] = means.reshape(len(means), -1)
        return distances

    def residuals(self, candidates: Sequence[StaticParameters]) -> NDArray[np.float64]:
        """Simulated minus observed position, shape (n_candidates, n_points, 3), in m.

        NaN where a world did not simulate to its end.
        """
        residuals = np.empty((len(candidates), self.point_trajectory.size, 3))
        end = 0
        for group in self._groups:
            start, end = end, end + group.point_trajectory.size
            for part, offsets, failed in self._simulated(group, candidates):
                offsets[failed] = np.nan
                residuals[part, start:end] = offsets[:, group.seen]
        return residuals

    def _simulated(
        self, group: _Group, candidates: Sequence[StaticParameters]
    ) -> Iterator[tuple[slice, NDArray[np.float64], NDArray[np.bool_]]]:
        """Yield candidates, their offsets (C, W, O, T, 3) and which worlds failed (C, W)."""
        chunk = max(1, LARGEST_CHUNK // group.observed.size)
        for first in range(0, len(candidates), chunk):
            some = candidates[first : first + chunk]
            rollout = self._simulator.rollout_batch(
                group.worlds.crossed(some),
                np.tile(group.times, (len(some), 1)),
                orientations=False,
            )
            shape = (len(some), *group.observed.shape)
            offsets = rollout.positions.reshape(shape) - group.observed
            failed = rollout.status.reshape(shape[:2]) != WorldStatus.OK
            yield slice(first, first + len(some)), offsets, failed


@dataclass(frozen=True, eq=False)
class _Group:
    """W observations of O objects each, at up to T times.

    Parameters
    ----------
    worlds : their scenes
    times : (W, T) s after the start; every time at which any of the objects was seen
    observed : (W, O, T, 3) m, 0 where the object was not seen at that time
    seen : (W, O, T) bool
    trajectories : (W * O,) index of each trajectory among those of all groups
    point_trajectory : (n_points,) the same for each point that was seen
    """

    worlds: WorldBatch
    times: NDArray[np.float64]
    observed: NDArray[np.float64]
    seen: NDArray[np.bool_]
    trajectories: NDArray[np.int64]
    point_trajectory: NDArray[np.int64]


def _alike(observations: Sequence[Observation]) -> list[list[int]]:
    # Equal object counts and times within a factor of two: at most half of a group is padding.
    groups: dict[tuple[int, int], list[int]] = {}
    for i, seen in enumerate(observations):
        longest = max(len(thing.trajectory) for thing in seen.objects)
        groups.setdefault((len(seen.objects), longest.bit_length()), []).append(i)
    return [groups[key] for key in sorted(groups)]


def _pack_group(
    observations: Sequence[Observation],
    first_trajectory: Sequence[int],
    neutral: StaticParameters,
) -> _Group:
    relative = [
        [_relative_times(seen.start_time, thing.trajectory.times) for thing in seen.objects]
        for seen in observations
    ]
    unions = [np.unique(np.concatenate(times)) for times in relative]
    unions = [union[union >= 0.0] for union in unions]
    shape = (len(observations), len(observations[0].objects), max(map(len, unions)))
    times = np.full((shape[0], shape[2]), np.nan)
    observed = np.zeros((*shape, 3))
    seen_at = np.zeros(shape, dtype=bool)
    for w, (seen, union) in enumerate(zip(observations, unions, strict=True)):
        times[w, : union.size] = union
        for j, thing in enumerate(seen.objects):
            after = relative[w][j] >= 0.0
            columns = np.searchsorted(union, relative[w][j][after])
            observed[w, j, columns] = thing.trajectory.positions[after]
            seen_at[w, j, columns] = True
    trajectories = np.array([k + j for k in first_trajectory for j in range(shape[1])])
    return _Group(
        worlds=pack_worlds([seen.scene() for seen in observations], neutral),
        times=times,
        observed=observed,
        seen=seen_at,
        trajectories=trajectories,
        point_trajectory=np.repeat(trajectories, seen_at.sum(axis=2).ravel()),
    )


def _mean_lengths(offsets: NDArray[np.float64], seen: NDArray[np.bool_]) -> NDArray[np.float64]:
    lengths = np.sqrt(np.einsum("cwotk,cwotk->cwot", offsets, offsets))
    lengths[:, ~seen] = 0.0
    return lengths.sum(axis=3) / seen.sum(axis=2)


def _relative_times(start: float, times: NDArray[np.float64]) -> NDArray[np.float64]:
    relative = times - start
    relative[(relative < 0.0) & (relative >= -START_TOLERANCE)] = 0.0
    return relative
