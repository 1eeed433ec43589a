"""Observations of equal size as flat arrays, so that many are simulated in one call."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.materials import StaticParameters
from intuitive_physics.observation import Observation, ObservedObject
from intuitive_physics.simulation import Simulator, WorldBatch, WorldStatus, pack_worlds
from intuitive_physics_learner.cost.trials import Trials

START_TOLERANCE = 1e-6
"""s; a point this little before the start was seen at the start: stamps and clocks are rounded."""


@dataclass(frozen=True, eq=False)
class PackedObservations:
    """W observations of O objects each, at up to T times and with up to P points in all.

    Parameters
    ----------
    members : (W,) index of each among all observations
    worlds : their scenes
    times : (W, T) s after the start; every time at which any of the objects was seen
    observed : (W, O, T, 3) m, 0 where the object was not seen at that time
    has_point : (W, O, T) bool
    points : (W, P) index on the axes (O, T) of each point that was seen, object after object, -1
        beyond the last
    """

    members: NDArray[np.int64]
    worlds: WorldBatch
    times: NDArray[np.float64]
    observed: NDArray[np.float64]
    has_point: NDArray[np.bool_]
    points: NDArray[np.int64]

    def simulate(
        self, simulator: Simulator, trials: Trials, rows: NDArray[np.int64]
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_]]:
        """Simulate trials of these observations.

        `rows` (N,) index among these observations of that of each trial. Returns `offsets` (N, O,
        T', 3) m, simulated minus observed position, T' ≤ T; `counted` (N, O, T') bool, which of
        them were seen and wanted; `failed` (N,) bool, which worlds did not simulate to their end.
        """
        tables = self.worlds.taken(rows[:0]).crossed(trials.parameters)
        changes = {
            "parameter_index": trials.parameter_index,
            "density": tables.density,
            "coefficients": tables.coefficients,
        }
        if trials.states is not None:
            changes["states"] = trials.states[:, : self.observed.shape[1]]
        times = self.times[rows]
        if trials.until is not None:
            times[:, 1:][~(times[:, 1:] <= trials.until[:, None])] = np.nan
            times = times[:, : int(np.isfinite(times).sum(axis=1).max())]
        wanted = times.shape[1]
        rollout = simulator.rollout_batch(
            self.worlds.taken(rows, **changes), times, orientations=False
        )
        offsets = rollout.positions - self.observed[rows, :, :wanted]
        counted = self.has_point[rows, :, :wanted] & np.isfinite(times)[:, None]
        return offsets, counted, rollout.status != WorldStatus.OK


def packed_in_groups(
    observations: Sequence[Observation], materials: tuple[str, ...]
) -> list[PackedObservations]:
    """Pack observations in groups so alike that at most half of each is padding."""
    groups: dict[tuple[int, int], list[int]] = {}
    for i, observation in enumerate(observations):
        longest = max(len(track.trajectory) for track in observation.objects)
        groups.setdefault((len(observation.objects), longest.bit_length()), []).append(i)
    neutral = StaticParameters.uniform(materials)
    return [packed(observations, groups[key], neutral) for key in sorted(groups)]


def packed(
    observations: Sequence[Observation], members: list[int], neutral: StaticParameters
) -> PackedObservations:
    """Pack some observations, `members` by their indices, of equally many objects in one group."""
    some = [observations[i] for i in members]
    relative = [
        [times_after_start(observation, track) for track in observation.objects]
        for observation in some
    ]
    unions = [np.unique(np.concatenate(times)) for times in relative]
    unions = [union[union >= 0.0] for union in unions]
    shape = (len(some), len(some[0].objects), max(map(len, unions)))
    times = np.full((shape[0], shape[2]), np.nan)
    observed = np.zeros((*shape, 3))
    has_point = np.zeros(shape, dtype=bool)
    for w, (observation, union) in enumerate(zip(some, unions, strict=True)):
        times[w, : union.size] = union
        for j, track in enumerate(observation.objects):
            after = relative[w][j] >= 0.0
            columns = np.searchsorted(union, relative[w][j][after])
            observed[w, j, columns] = track.trajectory.positions[after]
            has_point[w, j, columns] = True
    worlds = pack_worlds([observation.scene() for observation in some], neutral)
    places = [np.flatnonzero(mask) for mask in has_point]
    points = np.full((len(some), max(map(len, places))), -1)
    for w, place in enumerate(places):
        points[w, : place.size] = place
    return PackedObservations(np.array(members), worlds, times, observed, has_point, points)


def times_after_start(observation: Observation, track: ObservedObject) -> NDArray[np.float64]:
    """Return the times (n_points,) in s after the start; points before it do not count."""
    relative = track.trajectory.times - observation.start_time
    relative[(relative < 0.0) & (relative >= -START_TOLERANCE)] = 0.0
    return relative
