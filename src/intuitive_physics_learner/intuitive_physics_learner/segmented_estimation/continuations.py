"""How a throw may go on beyond the segments that are explained: many motions, and the best of them.

From a state shortly before the first segment or link that is not explained, many motions are
followed, as by a particle filter (Gordon, Salmond and Smith 1993): each segment begins at ends of
the last one, drawn by how well they explain the points, and spread. Of all states that occur that
sequence is taken whose points and links have the least loss, by dynamic programming (Godsill,
Doucet and West 2001, *Maximum a posteriori sequence estimation using Monte Carlo particle
filters*). The present path is one of the motions, so that what is known is not lost.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.simulation import WorldBatch
from intuitive_physics_learner.segmented_estimation.chaotic_states import (
    CHANGE_SPREADS,
    RESTING_SPEED,
    drawn_again,
    moved,
    surface_speeds,
)
from intuitive_physics_learner.segmented_estimation.jumps import asked_jump
from intuitive_physics_learner.segmented_estimation.seen_points import mean_precisions
from intuitive_physics_learner.segmented_estimation.segmented_throws import SegmentedThrows

MOTIONS = 48
"""Motions that are followed; on thirteen boxes 64 did no better, 32 a little worse."""

BACK = 3
"""Segments before the first one that is not explained from which on they are followed; set by hand:
on 16 boxes the mean excess was 0.10 with 2 and with 4."""

AHEAD = 2
"""Segments from that one on; set by hand."""

PARENTS = 32
"""Motions of the least loss that a segment may go on from."""

SPREAD_PARTS = (0.1, 0.3, 1.0)
"""Parts of the spread of links that motions have, one after the other: many small ones find what is
near, few large ones what is not; set by hand."""

FIRST_PARTS = (1.0, 0.3, 2.0, 1.0)
"""Parts of their smoothed standard deviation by which the first states are spread, likewise."""

JUMP_PART = 0.4
"""Part of the jumps that points ask for which a motion makes at a spread of 1; set by hand."""

UNREACHED = 1e12
"""Loss of a motion whose simulation failed."""


@dataclass(frozen=True, eq=False)
class Continuation:
    """The best motions of r throws.

    Parameters
    ----------
    counts : (r,) segments that each goes on for
    states : (r, S, 13) in which they begin
    ends : (r,) number of segments after which it rests; the number of segments of the throw where
        it does not
    """

    counts: NDArray[np.int64]
    states: NDArray[np.float64]
    ends: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Stretch:
    """Where r throws are to go on: from some segments before the first one that is not explained.

    Parameters
    ----------
    throws : all of them
    worlds : of θ_s
    rows : (r,) those that are to go on
    explained : (r,) segments of each that are explained
    level : of the spreads of links
    """

    throws: SegmentedThrows
    worlds: WorldBatch
    rows: NDArray[np.int64]
    explained: NDArray[np.int64]
    level: float

    @property
    def first(self) -> NDArray[np.int64]:
        """Segment (r,) of each from which on motions are followed."""
        return np.maximum(self.explained - BACK, 0)


class Continuations:
    """M motions of each of r throws.

    Parameters
    ----------
    stretch : on which they are followed
    begun : (r, M, 13) states in which they begin; the first is that of the present path
    generator : of the draws
    """

    def __init__(
        self, stretch: Stretch, begun: NDArray[np.float64], generator: np.random.Generator
    ) -> None:
        self._throws, self._worlds, self._rows = stretch.throws, stretch.worlds, stretch.rows
        self._first, self._level, self._generator = stretch.first, stretch.level, generator
        self._cloud = begun
        shape = (BACK + AHEAD, *begun.shape[:2])
        self._states, self._reached = np.full((2, *shape, 13), np.nan)
        self._least = np.full(shape, UNREACHED)
        self._before = np.zeros(shape, dtype=np.int64)
        self._counts, self._best = np.zeros((2, self._rows.size), dtype=np.int64)
        self._ends = self._throws.points.counts[self._rows].copy()

    def follow(
        self,
        path: NDArray[np.float64],
        lengths: NDArray[np.int64],
        limits: NDArray[np.int64],
        first_losses: NDArray[np.float64],
    ) -> Continuation:
        """Follow all motions.

        `path` (A, K, 13) the present one, of `lengths` (A,) segments; `limits` (A,) segments after
        which a throw rests or ends; `first_losses` (r, M) of what is before the states in which
        motions begin.
        """
        going = np.arange(self._rows.size)
        for s in range(BACK + AHEAD):
            segments = self._first + s
            going = going[segments[going] < limits[self._rows[going]]]
            if not going.size:
                break
            throws, places = self._rows[going], segments[going]
            known = places < lengths[throws]
            states = self._cloud[going]
            if s > 0:
                states = self._spread(throws, states)
                states[known, 0] = path[throws[known], places[known]]
            states, losses = self._segment(s, going, places, states, known)
            before = first_losses[going] if s == 0 else self._joined(s, going, throws, states)
            self._least[s, going] = np.where(
                np.isfinite(self._reached[s, going]).all(axis=2), losses + before, UNREACHED
            )
            best = self._least[s, going].argmin(axis=1)
            left = np.take_along_axis(losses, best[:, None], axis=1)[:, 0]
            fine = (left <= self._throws.points.largest_losses[throws, places]) | (s < BACK)
            self._counts[going[fine]], self._best[going[fine]] = s + 1, best[fine]
            self._go_on(s, going, places, best)
            going = going[fine]
        return Continuation(self._counts, self._traced(), self._ends)

    def _spread(
        self, throws: NDArray[np.int64], states: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Spread states (a, M, 13) at the start of a segment."""
        count = states.shape[1]
        parts = self._level * np.resize(SPREAD_PARTS, count)
        scales = self._throws.scales(throws, states) * parts
        normal = self._generator.normal(size=(*scales.shape, 12))
        return moved(states, scales[..., None] * CHANGE_SPREADS * normal)

    def _segment(
        self,
        s: int,
        going: NDArray[np.int64],
        places: NDArray[np.int64],
        states: NDArray[np.float64],
        known: NDArray[np.bool_],
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Simulate a segment, and let motions jump as its points ask for; the present path stays.

        Returns states (a, M, 13) after the jump, and losses (a, M) of the points.
        """
        throws, points = self._rows[going], self._throws.points
        offsets, reached = self._throws.simulated(self._worlds, throws, places, states)
        times = np.nan_to_num(points.times[throws, places])
        precisions = mean_precisions(points.whitening[throws, places])
        size = JUMP_PART * self._level if s > 0 else 0.0
        scales = np.maximum(size * self._throws.scales(throws, states), np.finfo(float).eps)
        jump = asked_jump(offsets[:, :, None], times, precisions[:, None], scales[..., None])
        displacements, velocities = jump.displacements[:, :, 0], jump.velocities[:, :, 0]
        stays = known[:, None] & (np.arange(states.shape[1]) == 0)
        displacements[stays], velocities[stays] = 0.0, 0.0
        apart = np.where(stays[..., None, None], offsets, jump.offsets[:, :, 0])
        states = states.copy()
        states[..., :3] -= displacements
        states[..., 7:10] -= velocities
        span = times.max(axis=1)[:, None, None]
        reached[..., :3] -= displacements + velocities * span
        reached[..., 7:10] -= velocities
        self._states[s, going], self._reached[s, going] = states, reached
        return states, points.losses(throws, places, apart)

    def _joined(
        self,
        s: int,
        going: NDArray[np.int64],
        throws: NDArray[np.int64],
        states: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """Let each state (a, M, 13) follow the motion that is best; return losses (a, M) so far."""
        least = self._least[s - 1, going]
        likely = np.argpartition(least, min(PARENTS, least.shape[1]) - 1, axis=1)[:, :PARENTS]
        # The present path may go on.
        likely[:, -1] = 0
        ends = np.take_along_axis(self._reached[s - 1, going], likely[..., None], axis=1)
        begun = np.take_along_axis(self._states[s - 1, going], likely[..., None], axis=1)
        after = states[:, None]
        spreads = self._throws.link_spreads(throws, begun[:, :, None], after, self._level)
        losses = self._throws.link_losses(ends[:, :, None], after, spreads)
        losses += np.take_along_axis(least, likely, axis=1)[..., None]
        chosen = losses.argmin(axis=1)
        self._before[s, going] = np.take_along_axis(likely, chosen, axis=1)
        return np.take_along_axis(losses, chosen[:, None], axis=1)[:, 0]

    def _go_on(
        self, s: int, going: NDArray[np.int64], places: NDArray[np.int64], best: NDArray[np.int64]
    ) -> None:
        """Draw the ends that the next segment begins at, and note what rests."""
        reached, least = self._reached[s, going], self._least[s, going]
        failed = ~np.isfinite(reached).all(axis=2)
        drawn = drawn_again(least, failed, self._generator)
        cloud = np.take_along_axis(reached, drawn[..., None], axis=1)
        there = np.isfinite(cloud).all(axis=2, keepdims=True)
        self._cloud[going] = np.where(there, cloud, self._states[s, going])
        throws, seen = self._rows[going], self._throws.seen
        columns = self._throws.points.ends[throws, places]
        speeds = surface_speeds(self._cloud[going], self._throws.radii[throws, None])
        slow = (speeds.mean(axis=1) < RESTING_SPEED) & (columns < seen.last[throws])
        for a in np.flatnonzero(slow).tolist():
            if seen.stays(int(throws[a]), int(columns[a]), reached[a, best[a], None, :3]):
                self._ends[going[a]] = places[a] + 1

    def _traced(self) -> NDArray[np.float64]:
        """Return the states (r, S, 13) of the best motion of each throw."""
        every = np.arange(self._rows.size)
        states = np.full((every.size, len(self._states), 13), np.nan)
        motion = self._best.copy()
        for s in reversed(range(len(self._states))):
            inside = every[s < self._counts]
            states[inside, s] = self._states[s, inside, motion[inside]]
            if s > 0:
                motion[inside] = self._before[s, inside, motion[inside]]
        return states
