"""J(θ_s), the cost of Eqs. 8 and 9: mean distance between simulated and observed trajectories.

The distance of two trajectories is D̄, the mean over their points, as in the paper, or D̂, the
largest (Eqs. 6 and 7).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import UnknownNameError
from intuitive_physics.materials import StaticParameters
from intuitive_physics.observation import Observation, observation_materials
from intuitive_physics.simulation import Simulator
from intuitive_physics.trajectory import DISTANCES, LARGEST_DISTANCE, MEAN_DISTANCE
from intuitive_physics_learner.cost.packed_observations import PackedObservations, packed_in_groups
from intuitive_physics_learner.cost.trials import Trials
from intuitive_physics_learner.errors import NoObservationsError

FAILED_DISTANCE = 1000.0
"""Distance in m of each object of a world that did not simulate to its end; none counts more."""

LARGEST_CHUNK = 4_000_000
"""Largest number of coordinates simulated in one call, to bound the memory: 32 MB of positions."""


class Cost(ABC):
    """J of any θ_s over a fixed set of observations; subclasses say what simulates them.

    Parameters
    ----------
    observations : Y, at least one
    materials : of the θ_s that will be judged, in their order; by default those of the observations

    Attributes
    ----------
    trajectory_observation : (n_trajectories,) index of the observation each trajectory is from
    trajectory_object : (n_trajectories,) index of its object in that observation
    threads : of those who evaluate it, among which they may share work of their own

    Raises
    ------
    NoObservationsError
        When there are none.
    """

    def __init__(
        self, observations: Sequence[Observation], materials: Sequence[str] | None = None
    ) -> None:
        if len(observations) == 0:
            raise NoObservationsError("there are no observations; expected at least one")
        self.threads = 1
        self.observations = tuple(observations)
        self.materials = tuple(materials or observation_materials(observations))
        counts = [len(observation.objects) for observation in observations]
        self.trajectory_observation = np.repeat(np.arange(len(counts)), counts)
        self.trajectory_object = np.concatenate([np.arange(count) for count in counts])

    def costs(self, candidates: Sequence[StaticParameters]) -> NDArray[np.float64]:
        """J of each candidate (Eq. 8), shape (n_candidates,), in m."""
        return self.distances(candidates).mean(axis=1)

    def observation_costs(self, candidates: Sequence[StaticParameters]) -> NDArray[np.float64]:
        """Mean over the objects of each observation, shape (n_candidates, n_observations), in m."""
        distances = self.distances(candidates)
        objects = np.bincount(self.trajectory_observation)
        sums = np.zeros((len(distances), len(self.observations)))
        np.add.at(sums.T, self.trajectory_observation, distances.T)
        return sums / objects

    def distances(self, candidates: Sequence[StaticParameters]) -> NDArray[np.float64]:
        """D̄ or D̂ of each trajectory, shape (n_candidates, n_trajectories), in m."""
        count = len(self.observations)
        by_trial = self.trial_distances(Trials.crossed(candidates, count))
        by_object = by_trial.reshape(len(candidates), count, -1)
        return by_object[:, self.trajectory_observation, self.trajectory_object]

    @abstractmethod
    def trial_distances(self, trials: Trials) -> NDArray[np.float64]:
        """D̄ or D̂ (Eqs. 6 and 7) of each object of each trial, shape (N, O), in m.

        `FAILED_DISTANCE` where a world did not simulate to its end, NaN for objects beyond those
        that an observation has.
        """

    @abstractmethod
    def trial_residuals(self, trials: Trials) -> NDArray[np.float64]:
        """Simulated minus observed position of each point of each trial, shape (N, P, 3), in m.

        The points of one object after those of the other, each in the order of times. Without
        `Trials.columns`, P is the largest number of points of an observation. NaN beyond those that
        an observation has or a trial wants, and in all points of a world that did not simulate to
        its end.
        """


MakeCost = Callable[[Sequence[Observation], Simulator, Sequence[str], str], Cost]
"""Makes the J of observations over materials, by a simulator and with a distance, as
`TrajectoryCost` does."""


class TrajectoryCost(Cost):
    """J by simulating in this process, with the observations packed once for many evaluations.

    The simulator returns positions at the times at which the objects were seen, so the
    interpolation of Eq. 5 is not needed. Points before an observation's start time are left out, as
    `trajectory.synchronise` leaves out points that the simulated trajectory does not span.

    Parameters
    ----------
    observations : Y, at least one
    simulator : the engine that makes X
    materials : of the θ_s that will be judged, in their order; by default those of the observations
    distance : one of `trajectory.DISTANCES`

    Raises
    ------
    UnknownNameError
        When no distance has that name.
    """

    def __init__(
        self,
        observations: Sequence[Observation],
        simulator: Simulator,
        materials: Sequence[str] | None = None,
        distance: str = MEAN_DISTANCE,
    ) -> None:
        super().__init__(observations, materials)
        if distance not in DISTANCES:
            raise UnknownNameError(
                f"distance is {distance!r}; expected one of {', '.join(DISTANCES)}"
            )
        self._largest = distance == LARGEST_DISTANCE
        self._simulator = simulator
        self.threads = simulator.threads
        self._groups = packed_in_groups(self.observations, self.materials)
        self._row = np.empty(len(self.observations), dtype=np.int64)
        self._group = np.empty(len(self.observations), dtype=np.int64)
        for g, group in enumerate(self._groups):
            self._row[group.members] = np.arange(group.members.size)
            self._group[group.members] = g
        self._objects = max(group.has_point.shape[1] for group in self._groups)
        self._points = max(group.points.shape[1] for group in self._groups)

    def trial_distances(self, trials: Trials) -> NDArray[np.float64]:
        distances = np.full((trials.size, self._objects), np.nan)
        for part in self._simulated(trials):
            lengths = np.sqrt(np.einsum("notk,notk->not", part.offsets, part.offsets))
            lengths[~part.counted] = 0.0
            # An object that was not seen early enough to count is at no distance.
            if self._largest:
                means = lengths.max(axis=2)
            else:
                means = lengths.sum(axis=2) / np.maximum(part.counted.sum(axis=2), 1)
            means[part.failed] = FAILED_DISTANCE
            means = np.nan_to_num(means, nan=FAILED_DISTANCE, posinf=FAILED_DISTANCE)
            distances[part.trials, : means.shape[1]] = np.minimum(means, FAILED_DISTANCE)
        return distances

    def trial_residuals(self, trials: Trials) -> NDArray[np.float64]:
        columns = np.arange(self._points) if trials.columns is None else trials.columns
        residuals = np.full((trials.size, columns.size, 3), np.nan)
        for part in self._simulated(trials):
            points = part.group.points
            there = columns < points.shape[1]
            residuals[np.ix_(part.trials, there)] = part.residuals(points[:, columns[there]])
        return residuals

    def _simulated(self, trials: Trials) -> Iterator[_Simulated]:
        for g, group in enumerate(self._groups):
            members = np.flatnonzero(self._group[trials.observation_index] == g)
            for part in chunks(members, LARGEST_CHUNK // group.observed[0].size):
                some = trials.taken(part)
                rows = self._row[some.observation_index]
                yield _Simulated(part, group, rows, *group.simulate(self._simulator, some, rows))


@dataclass(frozen=True, eq=False)
class _Simulated:
    """Some trials, the group they are in and their rows there; the rest as `simulate` returns."""

    trials: NDArray[np.int64]
    group: PackedObservations
    rows: NDArray[np.int64]
    offsets: NDArray[np.float64]
    counted: NDArray[np.bool_]
    failed: NDArray[np.bool_]

    def residuals(self, points: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return offsets (N, P, 3) m of points (W, P), given as `PackedObservations.points`."""
        count, objects, simulated = self.counted.shape
        owner, column = np.divmod(points, self.group.has_point.shape[2])
        there = (points >= 0) & (column < simulated)
        place = np.where(there, owner * simulated + column, 0)[self.rows]
        place += objects * simulated * np.arange(count)[:, None]
        wanted = self.counted.reshape(-1)[place] & there[self.rows] & ~self.failed[:, None]
        taken = self.offsets.reshape(-1, 3)[place]
        taken[~wanted] = np.nan
        return taken


def chunks(indices: NDArray[np.int64], size: int) -> Iterator[NDArray[np.int64]]:
    """Yield parts of an array of indices (n,), of `size` each at most, or of one."""
    step = max(1, size)
    for first in range(0, indices.size, step):
        yield indices[first : first + step]
