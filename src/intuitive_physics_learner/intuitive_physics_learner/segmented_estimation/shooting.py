"""How a throw may go on without links: motions that are led to the points by shooting.

Of motions that are only drawn (`continuations`) hardly any flies as the points do after a contact
or two, and the more exact links are the less they give way. Here a motion is one simulation
through several segments, and what is looked for is the state it begins in, as a boundary value
problem is solved by shooting. The best of the motions drawn take Gauss-Newton steps: first to the
points of the first segment that is not explained, then to those after it as well.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_learner.joint_estimation.fit_horizons import FAILED_LENGTH
from intuitive_physics_learner.joint_estimation.normal_equations import huber_weights
from intuitive_physics_learner.segmented_estimation.chaotic_states import CHANGE_SPREADS, moved
from intuitive_physics_learner.segmented_estimation.continuations import (
    AHEAD,
    Continuation,
    Stretch,
)
from intuitive_physics_learner.segmented_estimation.segment_equations import (
    COMPONENTS,
    LOOSE,
    SMALLEST_CHANGE,
    STATE_DAMPINGS,
)
from intuitive_physics_learner.segmented_estimation.smoothed_states import KnownStates

FIRST_SHOOTING_LEVEL = 0.3
"""Spread of links from which on there is shooting: from 1 on 31 boxes were learned as well, in more
time."""

SHOTS = (4, 2, 2)
"""Motions that take each of the steps; on three boxes 8 in all steps got no farther, nor did two
more steps."""

STEPS_AHEAD = (1, 2, 2)
"""Segments that are not explained to whose points each of the steps leads."""

LARGEST_SHOT_LOSS = 100.0
"""Loss of a segment at most where motions are chosen: one that misses all later points may still be
the one to lead there; on three boxes 30 was worse."""

LARGEST_SHOT_STEP = 3.0
"""Largest step of a component of a state, in its standard deviations or in `LEAST_SPREAD` of the
spread of its link, whichever is larger; set by hand."""

LEAST_SPREAD = 0.2
"""Part of the spread of links by which a state may be wrong, however well it is known; set by
hand."""

DIFFERENCE_PART = 0.1
"""Step of a finite difference, in standard deviations: motions after contacts amplify it; set by
hand."""

LARGEST_DIFFERENCES = np.repeat((0.01, 0.02, 0.02, 0.2), 3)
"""Largest step of a finite difference of a state, in the unit of its component; set by hand."""


@dataclass(frozen=True, eq=False)
class Flight:
    """Motions of r throws, m of each, through up to S segments.

    Parameters
    ----------
    offsets : (r, m, S, N, 3) m from the points, NaN where there is none or a
        simulation failed, 0 where none was asked for
    losses : (r, m, S) of the points of each segment
    states : (r, m, S, 13) in which segments begin, NaN after a simulation that failed
    """

    offsets: NDArray[np.float64]
    losses: NDArray[np.float64]
    states: NDArray[np.float64]


class Shooting:
    """Motions of r throws, each one simulation.

    Parameters
    ----------
    stretch : on which they are followed
    limits : (r,) segments after which a throw rests or ends
    known : of the states in which motions begin
    """

    def __init__(self, stretch: Stretch, limits: NDArray[np.int64], known: KnownStates) -> None:
        self._throws, self._worlds, self._rows = stretch.throws, stretch.worlds, stretch.rows
        self._first, self._known = stretch.first, known
        self._missed = stretch.explained - self._first
        self._counts = np.minimum(stretch.explained + AHEAD, limits) - self._first
        least = LEAST_SPREAD * stretch.level * CHANGE_SPREADS
        self._largest = LARGEST_SHOT_STEP * np.maximum(known.deviations, least)[:, None]
        self._differences = np.clip(
            DIFFERENCE_PART * known.deviations, SMALLEST_CHANGE, LARGEST_DIFFERENCES
        )

    def go_on(self, begun: NDArray[np.float64]) -> Continuation:
        """Lead the best of motions that begin in states `begun` (r, M, 13) on to the points.

        Of a throw of which none gets farther than is explained no segment counts.
        """
        states = begun
        for shots, ahead in zip(SHOTS, STEPS_AHEAD, strict=True):
            counts = np.minimum(self._missed + ahead, self._counts)
            states = self._stepped(self._best(states, shots, counts), counts)
        return self._farthest(states)

    def _best(
        self, states: NDArray[np.float64], shots: int, counts: NDArray[np.int64]
    ) -> NDArray[np.float64]:
        """Choose states (r, shots, 13) of states (r, m, 13), by `counts` (r,) segments."""
        if states.shape[1] == shots:
            return states
        losses = np.minimum(self._flown(states, counts).losses, LARGEST_SHOT_LOSS)
        losses = losses.sum(axis=2) + self._known.losses(states)
        best = np.argpartition(losses, shots - 1, axis=1)[:, :shots]
        return np.take_along_axis(states, best[..., None], axis=1)

    def _stepped(
        self, states: NDArray[np.float64], counts: NDArray[np.int64]
    ) -> NDArray[np.float64]:
        """Take the best damped step of states (r, m, 13), to points of `counts` (r,) segments."""
        flight, hessian, gradient = self._linearised(states, counts)
        best, least = states, flight.losses[:, :: 1 + COMPONENTS].sum(axis=2)
        least += self._known.losses(states)
        axes = np.arange(COMPONENTS)
        for damping in STATE_DAMPINGS:
            damped = hessian.copy()
            damped[..., axes, axes] *= 1.0 + damping
            step = -np.linalg.solve(damped, gradient[..., None])[..., 0]
            trying = moved(states, np.clip(step, -self._largest, self._largest))
            losses = self._flown(trying, counts).losses.sum(axis=2) + self._known.losses(trying)
            better = losses < least
            best = np.where(better[..., None], trying, best)
            least = np.where(better, losses, least)
        return best

    def _linearised(
        self, states: NDArray[np.float64], counts: NDArray[np.int64]
    ) -> tuple[Flight, NDArray[np.float64], NDArray[np.float64]]:
        """Take differences along each component of states (r, m, 13), over `counts` (r,) segments.

        Returns the motions, 1 + 12 for each state, and matrix (r, m, 12, 12) and gradient (r, m,
        12) of their losses.
        """
        r, m = states.shape[:2]
        axes = np.arange(COMPONENTS)
        moves = np.zeros((r, 1, 1 + COMPONENTS, COMPONENTS))
        moves[:, 0, 1 + axes, axes] = self._differences
        flight = self._flown(moved(states[:, :, None], moves).reshape(r, -1, 13), counts)
        residuals = self._residuals(flight.offsets).reshape(r, m, 1 + COMPONENTS, -1, 3)
        rooted = np.sqrt(huber_weights(np.linalg.norm(residuals[:, :, 0], axis=-1)))
        residuals = (residuals * rooted[:, :, None, :, None]).reshape(r, m, 1 + COMPONENTS, -1)
        slopes = residuals[:, :, 1:] - residuals[:, :, :1]
        slopes /= self._differences[:, None, :, None]
        hessian = slopes @ slopes.swapaxes(2, 3) + self._known.precisions[:, None]
        hessian[..., axes, axes] += (LOOSE * CHANGE_SPREADS) ** -2.0
        gradient = (slopes @ residuals[:, :, 0, :, None])[..., 0] + self._known.scores(states)
        return flight, hessian, gradient

    def _farthest(self, states: NDArray[np.float64]) -> Continuation:
        """Choose of states (r, m, 13) for each throw that whose motion explains most."""
        flight = self._flown(states, self._counts)
        segments = np.arange(flight.losses.shape[2])
        allowed = self._throws.points.largest_losses[self._places(segments.size)]
        fine = flight.losses <= allowed[:, None]
        fine &= segments < self._counts[:, None, None]
        counts = np.logical_and.accumulate(fine, axis=2).sum(axis=2)
        # Of those that explain as much the one that suits best what was before it.
        best = np.lexsort((self._known.losses(states), -counts), axis=1)[:, 0]
        every = np.arange(best.size)
        reached = counts[every, best]
        counted = np.where(reached > self._missed, reached, 0)
        return Continuation(
            counted, flight.states[every, best], self._throws.points.counts[self._rows]
        )

    def _places(self, count: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return throws (r, 1) and segments (r, count) on from the first, the last one repeated."""
        segments = np.minimum(self._first[:, None] + np.arange(count), self._throws.shape[1] - 1)
        return self._rows[:, None], segments

    def _residuals(self, offsets: NDArray[np.float64]) -> NDArray[np.float64]:
        """Whiten offsets (r, m, S, N, 3) m from points; 0 where there is none."""
        whitening = self._throws.points.whitening[self._places(offsets.shape[2])][:, None]
        residuals = np.nan_to_num((whitening @ offsets[..., None])[..., 0], nan=FAILED_LENGTH)
        there = np.asarray(whitening.any(axis=(-2, -1)))
        return np.where(there[..., None], residuals, 0.0)

    def _flown(self, states: NDArray[np.float64], counts: NDArray[np.int64]) -> Flight:
        """Simulate motions that begin in states (r, m, 13), through `counts` (r,) segments."""
        r, m, most = *states.shape[:2], int(counts.max())
        passed = np.zeros((r, m, most, *self._throws.points.observed.shape[2:]))
        losses = np.zeros((r, m, most))
        begun = np.full((r, m, most, 13), np.nan)
        begun[:, :, 0] = states
        for s in range(most):
            going = np.flatnonzero(counts > s)
            throws, places = self._rows[going], self._first[going] + s
            present = begun[going, :, s]
            failed = ~np.isfinite(present).all(axis=2)
            present = np.where(failed[..., None], states[going], present)
            offsets, ends = self._throws.simulated(self._worlds, throws, places, present)
            offsets[failed], ends[failed] = np.nan, np.nan
            passed[going, :, s] = offsets
            losses[going, :, s] = self._throws.points.losses(throws, places, offsets)
            if s + 1 < most:
                begun[going, :, s + 1] = ends
        return Flight(passed, losses, begun)
