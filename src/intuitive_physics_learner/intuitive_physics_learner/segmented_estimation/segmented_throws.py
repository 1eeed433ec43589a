"""Throws of an object cut into segments of time, each of which begins in a state of its own.

Where motion is chaotic, no initial state explains it as a whole: what slopes say of a state ends at
the next contacts. A segment is short enough for slopes. Its state is bound to where the segment
before it ends by a Gaussian of some spread: a weak constraint, as in the assimilation of weather
(Trémolet 2006, *Accounting for an imperfect model in 4D-Var*). As the spread goes to zero, the
segments become one motion.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.materials import StaticParameters
from intuitive_physics.simulation import Simulator, WorldBatch
from intuitive_physics_learner.cost.packed_observations import packed
from intuitive_physics_learner.joint_estimation.joint_fit import JointFit
from intuitive_physics_learner.segmented_estimation.chaotic_states import (
    CHANGE_SPREADS,
    change,
    chaos_scales,
    followed,
    surface_speeds,
)
from intuitive_physics_learner.segmented_estimation.seen_points import (
    FEWEST_POINTS,
    SeenPoints,
    point_losses,
)

SEGMENT = 1.0 / 3.0
"""Duration of a segment, s: ten points at 30 Hz."""

FAILED_LOSS = 1e8
"""Loss of what a simulation that failed would be compared with."""

EXACT_PRECISION = 1e10
"""Of a component of an initial state that is known exactly, in SI units: it moves by rounding."""

LARGEST_SEGMENT_LOSS = 3.0
"""Loss per point of a segment that is explained, at most: ten points of noise, 1.5 on the average,
exceed it with a probability of 1e-4."""

LARGEST_LINK_LOSS = 12.0
"""Loss of a link between segments that is explained, at most: half of a χ² of twelve degrees of
freedom exceeds it with a probability of 0.02."""


@dataclass(frozen=True, eq=False)
class SegmentPoints:
    """Points of A throws in up to K segments of up to N points.

    Parameters
    ----------
    times : (A, K, N) s after the start of the segment, NaN beyond the last
    observed : (A, K, N, 3) m, without shared errors
    whitening : (A, K, N, 3, 3) 1/m, 0 where there is no point
    counts : (A,) segments of each throw
    ends : (A, K) column of the last point of each segment among all times of its throw
    """

    times: NDArray[np.float64]
    observed: NDArray[np.float64]
    whitening: NDArray[np.float64]
    counts: NDArray[np.int64]
    ends: NDArray[np.int64]

    @staticmethod
    def of(seen: SeenPoints) -> SegmentPoints:
        """Cut throws of one object each into segments."""
        rows = np.arange(len(seen.times))
        bounds = [np.full(rows.size, -1)]
        while (bounds[-1] < seen.last).any():
            bounds.append(seen.ends(bounds[-1], SEGMENT))
        begin, end = np.array(bounds[:-1]).T, np.array(bounds[1:]).T
        offsets = 1 + np.arange((end - begin).max())
        there = begin[..., None] + offsets <= end[..., None]
        columns = np.where(there, begin[..., None] + offsets, 0)
        at = rows[:, None, None], columns
        starts = np.array([seen.starts(rows, each) for each in begin.T]).T
        return SegmentPoints(
            np.where(there, seen.times[at] - starts[..., None], np.nan),
            seen.observed[:, 0][at],
            seen.whitening[:, 0][at] * there[..., None, None],
            (end > begin).sum(axis=1),
            end,
        )

    def losses(
        self, throws: NDArray[np.int64], segments: NDArray[np.int64], offsets: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Losses (n, ...) of offsets (n, ..., N, 3) m from the points of n segments.

        `throws` (n,) and `segments` (n,) by their indices.
        """
        extra = (slice(None), *(None,) * (offsets.ndim - 3))
        whitening = self.whitening[throws, segments][extra]
        return np.asarray(point_losses(whitening, offsets).sum(axis=-1))

    @property
    def largest_losses(self) -> NDArray[np.float64]:
        """Largest loss (A, K) of each segment that is explained."""
        there = self.whitening.any(axis=(-2, -1)).sum(axis=-1)
        return LARGEST_SEGMENT_LOSS * np.maximum(there, FEWEST_POINTS)


@dataclass(eq=False)
class PathLosses:
    """What the states of a path leave unexplained.

    Parameters
    ----------
    points : (A, K) loss of each segment's points
    links : (A, K) loss of the link from the end of each segment to the next; 0 without a next
    first : (A,) loss of the first state by what is known of it
    ends : (A, K, 13) states at the ends of the segments
    """

    points: NDArray[np.float64]
    links: NDArray[np.float64]
    first: NDArray[np.float64]
    ends: NDArray[np.float64]

    def totals(self, explained: NDArray[np.int64]) -> NDArray[np.float64]:
        """Loss (A,) of the first segments of each throw, `explained` (A,), and between them."""
        segment = np.arange(self.points.shape[1])
        points = np.where(segment < explained[:, None], self.points, 0.0).sum(axis=1)
        links = np.where(segment + 1 < explained[:, None], self.links, 0.0).sum(axis=1)
        return points + links + self.first

    def take(self, others: PathLosses, rows: NDArray[np.bool_]) -> None:
        """Take those of some throws, `rows` (A,), from other paths."""
        for name in ("points", "links", "first", "ends"):
            getattr(self, name)[rows] = getattr(others, name)[rows]


class SegmentedThrows:
    """A throws of the object of a fit, and the simulation of their segments.

    `members` (A,) indices of these throws among the observations of the fit; None: all of them.

    Attributes
    ----------
    members : (A,) as given
    points : of the segments
    seen : the same points, not cut
    radii : (A,) m, of the bounding spheres
    initial_states : (A, 13) as they were observed
    initial_precisions : (A, 12) of the components of the initial states, in SI units
    simulations : of whole throws, so far
    """

    def __init__(
        self, fit: JointFit, simulator: Simulator, members: NDArray[np.int64] | None = None
    ) -> None:
        cost = fit.model.cost
        count = len(cost.observations)
        self.members = np.arange(count) if members is None else members
        neutral = StaticParameters.uniform(cost.materials)
        group = packed(cost.observations, self.members.tolist(), neutral)
        self.seen = SeenPoints.of(fit, group, np.arange(self.members.size))
        self.points = SegmentPoints.of(self.seen)
        self._simulator, self._space = simulator, fit.model.space
        self._worlds = group.worlds
        objects = [cost.observations[member].objects[0] for member in self.members]
        self.radii = np.array([each.object.shape.bounding_radius for each in objects])
        self.initial_states = np.array([each.initial_state.to_vector() for each in objects])
        initial_precisions = np.full((count, 12), EXACT_PRECISION)
        for block in fit.model.blocks:
            components = block.initial_states.components
            precisions = block.prior_deviations[:, : components.shape[1]] ** -2.0
            initial_precisions[block.members[:, None], components] = precisions
        self.initial_precisions = initial_precisions[self.members]
        self.simulations = 0.0

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of throws A and of segments K."""
        throws, segments = self.points.ends.shape
        return throws, segments

    def worlds(self, units: list[NDArray[np.float64]]) -> WorldBatch:
        """Return the worlds of all throws under each θ_s, `units` (n,), the first θ_s first."""
        return self._worlds.crossed([self._space.to_parameters(unit) for unit in units])

    def simulated(
        self,
        worlds: WorldBatch,
        throws: NDArray[np.int64],
        segments: NDArray[np.int64],
        states: NDArray[np.float64],
        index: NDArray[np.int64] | None = None,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Simulate n segments, each from m states.

        `throws` (n,) and `segments` (n,) by their indices; `states` (n, m, 13); `index` (m,) of the
        θ_s of each among those of the worlds; None: the first. Returns offsets (n, m, N, 3) m from
        the points, and states (n, m, 13) at the ends; NaN where a simulation failed.
        """
        n, m = states.shape[:2]
        relative = self.points.times[throws, segments]
        chosen = np.zeros(m, dtype=np.int64) if index is None else index
        taken = worlds.taken(
            np.repeat(throws, m),
            states=states.reshape(n * m, 1, 13),
            parameter_index=np.tile(chosen, n),
        )
        positions, ends = followed(self._simulator, taken, relative, m)
        durations = np.nanmax(relative, axis=1) / np.nanmax(self.seen.times[throws], axis=1)
        self.simulations += m * float(durations.sum())
        offsets = positions.reshape(n, m, -1, 3) - self.points.observed[throws, segments][:, None]
        return offsets, ends.reshape(n, m, 13)

    def scales(self, throws: NDArray[np.int64], states: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the part (n, ...) of the spreads that states (n, ..., 13) of throws (n,) have."""
        radii = self.radii[throws].reshape(-1, *(1,) * (states.ndim - 2))
        return chaos_scales(surface_speeds(states, radii))

    def link_losses(
        self, ends: NDArray[np.float64], states: NDArray[np.float64], spreads: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Losses (...,) of links from `ends` (..., 13) to `states` (..., 13).

        `spreads` (..., 12) of the links.
        """
        lengths = change(ends, states) / spreads
        return 0.5 * np.nan_to_num(lengths**2, nan=FAILED_LOSS).sum(axis=-1)

    def initial_losses(
        self, throws: NDArray[np.int64], states: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Losses (n, m) of initial states (n, m, 13) of throws (n,), by what is known of them."""
        apart = change(states, self.initial_states[throws][:, None])
        return 0.5 * (self.initial_precisions[throws][:, None] * apart**2).sum(axis=-1)

    def link_spreads(
        self,
        throws: NDArray[np.int64],
        before: NDArray[np.float64],
        after: NDArray[np.float64],
        level: float,
    ) -> NDArray[np.float64]:
        """Spreads (a, ..., 12) of links of throws (a,), between two states (a, ..., 13) each.

        By the faster one, `before` (a, ..., 13) or `after` (a, ..., 13): what comes to rest was
        chaotic just before.
        """
        scales = np.maximum(self.scales(throws, before), self.scales(throws, after))
        return level * scales[..., None] * CHANGE_SPREADS

    def spreads(self, states: NDArray[np.float64], level: float) -> NDArray[np.float64]:
        """Spreads (A, K, 12) of the links of paths, `states` (A, K, 13); the last has no next."""
        following = np.concatenate([states[:, 1:], states[:, -1:]], axis=1)
        return self.link_spreads(np.arange(len(states)), states, following, level)

    def losses(
        self,
        worlds: WorldBatch,
        states: NDArray[np.float64],
        lengths: NDArray[np.int64],
        spreads: NDArray[np.float64],
    ) -> PathLosses:
        """Simulate paths, `states` (A, K, 13), of the first `lengths` (A,) segments of each throw.

        `spreads` (A, K, 12) of the links.
        """
        inside = np.arange(self.shape[1]) < lengths[:, None]
        throws, segments = np.nonzero(inside)
        points, links = np.zeros(self.shape), np.zeros(self.shape)
        ends = np.full(states.shape, np.nan)
        if throws.size:
            offsets, reached = self.simulated(worlds, throws, segments, states[inside][:, None])
            points[inside] = self.points.losses(throws, segments, offsets)[:, 0]
            ends[inside] = reached[:, 0]
        linked = inside[:, 1:]
        links[:, :-1][linked] = self.link_losses(
            ends[:, :-1][linked], states[:, 1:][linked], spreads[:, :-1][linked]
        )
        every = np.arange(len(states))
        return PathLosses(points, links, self.initial_losses(every, states[:, :1])[:, 0], ends)

    def explained(self, losses: PathLosses, lengths: NDArray[np.int64]) -> NDArray[np.int64]:
        """Number (A,) of segments of each throw before the first one that is not explained.

        `lengths` (A,) of the paths.
        """
        good = np.arange(self.shape[1]) < lengths[:, None]
        good &= losses.points <= self.points.largest_losses
        good[:, 1:] &= losses.links[:, :-1] <= LARGEST_LINK_LOSS
        return np.asarray(np.logical_and.accumulate(good, axis=1).sum(axis=1))

    def explained_by_one(
        self, worlds: WorldBatch, states: NDArray[np.float64], lengths: NDArray[np.int64]
    ) -> NDArray[np.int64]:
        """Number (A,) of segments of each throw that one motion explains, without links.

        It begins in `states` (A, 13); of at most `lengths` (A,) segments.
        """
        every = np.arange(len(states))
        begun = worlds.taken(every, states=states[:, None])
        positions, _ = followed(self._simulator, begun, self.seen.times, 1)
        self.simulations += every.size
        points = point_losses(self.seen.whitening[:, 0], positions[:, 0] - self.seen.observed[:, 0])
        summed = points.cumsum(axis=1)[every[:, None], self.points.ends]
        fine = np.diff(summed, prepend=0.0) <= self.points.largest_losses
        fine &= np.arange(self.shape[1]) < lengths[:, None]
        return np.asarray(np.logical_and.accumulate(fine, axis=1).sum(axis=1))
