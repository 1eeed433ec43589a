"""The paths of throws in segments at a given θ_s: followed farther, linearised, and stepped.

Given θ_s, throws have nothing to do with each other. So a fit has them in several parts, which take
their steps side by side.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.simulation import WorldBatch
from intuitive_physics_learner.joint_estimation.normal_equations import Elimination
from intuitive_physics_learner.segmented_estimation.chaotic_states import (
    CHANGE_SPREADS,
    change,
    moved,
)
from intuitive_physics_learner.segmented_estimation.continuations import (
    FIRST_PARTS,
    Continuation,
    Continuations,
    Stretch,
)
from intuitive_physics_learner.segmented_estimation.segment_equations import (
    STATE_DAMPINGS,
    SegmentEquations,
    segment_equations,
)
from intuitive_physics_learner.segmented_estimation.segmented_throws import (
    PathLosses,
    SegmentedThrows,
)
from intuitive_physics_learner.segmented_estimation.shooting import (
    FIRST_SHOOTING_LEVEL,
    Shooting,
)
from intuitive_physics_learner.segmented_estimation.smoothed_states import (
    KnownStates,
    SmoothedStates,
)

LARGEST_STATE_STEP = 10.0
"""Largest step of a component of a state, in spreads; set by hand."""


class SegmentedPaths:
    """Paths of A throws in K segments, which begin with none.

    Parameters
    ----------
    throws : that the paths are of
    begun : (A, M, 13) states in which M motions of each throw may begin
    generator : of the motions that are tried

    Attributes
    ----------
    explained : (A,) segments of each throw that are explained
    """

    def __init__(
        self, throws: SegmentedThrows, begun: NDArray[np.float64], generator: np.random.Generator
    ) -> None:
        self.throws, self._begun, self._generator = throws, begun, generator
        self._states = np.zeros((*throws.shape, 13))
        self._states[..., 6] = 1.0
        self._lengths = np.zeros(len(begun), dtype=np.int64)
        self._limits = throws.points.counts.copy()
        self.explained = self._lengths
        self._covariances = np.zeros((*throws.shape, 12, 12))
        self._smoothed = SmoothedStates(*np.zeros((3, *throws.shape, 12, 12)))
        self._steps = 0

    def go_on(
        self, unit: NDArray[np.float64], deviations: NDArray[np.float64], level: float
    ) -> Elimination:
        """Follow throws farther, and return what their points say of θ_s near a point `unit` (n,).

        `deviations` (n,) standard deviation of each parameter, widths; `level` spread of links.
        """
        self._steps += 1
        worlds = self.throws.worlds([unit])
        self._spreads = self.throws.spreads(self._states, level)
        losses = self._losses(worlds, self._states)
        losses = self._followed(worlds, losses, level)
        self.explained = self.throws.explained(losses, self._lengths)
        self._equations = self._linearised(unit, deviations, level)
        self._covariances = self._equations.covariances
        self._smoothed = self._equations.smoothed
        eliminated = self._equations.eliminated()
        return replace(eliminated, members=self.throws.members)

    def known_starts(
        self, unit: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return the states in which throws begin, and how long one motion from them explains.

        `unit` (n,) θ_s. Returns states (A, 13), standard deviations (A, 12) of them, and times (A,)
        in s of the last points explained; 0 where none are.
        """
        throws, states = self.throws, self._states[:, 0]
        counts = throws.explained_by_one(throws.worlds([unit]), states, self.explained)
        every = np.arange(counts.size)
        until = throws.seen.times[every, throws.points.ends[every, np.maximum(counts - 1, 0)]]
        variances = np.einsum("aii->ai", self._smoothed.covariances[:, 0])
        return states, np.sqrt(variances), np.where(counts > 0, until, 0.0)

    def take_steps(self, unit: NDArray[np.float64], step: NDArray[np.float64]) -> None:
        """Take the best of several damped steps of the states of each throw.

        `step` (n,) widths, by which θ_s has come to the point `unit` (n,).
        """
        worlds = self.throws.worlds([unit])
        best = self._losses(worlds, self._states)
        states = self._states.copy()
        for damping in STATE_DAMPINGS:
            gains, offsets = self._equations.solved(damping)
            changes = np.clip(
                -offsets - gains @ step,
                -LARGEST_STATE_STEP * CHANGE_SPREADS,
                LARGEST_STATE_STEP * CHANGE_SPREADS,
            )
            trying = moved(self._states, changes)
            losses = self._losses(worlds, trying)
            better = losses.totals(self.explained) < best.totals(self.explained)
            states[better] = trying[better]
            best.take(losses, better)
        self._states = states

    def _losses(self, worlds: WorldBatch, states: NDArray[np.float64]) -> PathLosses:
        return self.throws.losses(worlds, states, self._lengths, self._spreads)

    def _followed(self, worlds: WorldBatch, losses: PathLosses, level: float) -> PathLosses:
        """Look for ways beyond what is explained; return the losses after it."""
        losses = self._tried(self._drawn, worlds, losses, level)
        if level <= FIRST_SHOOTING_LEVEL:
            losses = self._tried(self._shot, worlds, losses, level)
        return losses

    def _tried(
        self,
        way: Callable[[Stretch], Continuation],
        worlds: WorldBatch,
        losses: PathLosses,
        level: float,
    ) -> PathLosses:
        """Let throws go on one way, where more is explained then; return the losses after it."""
        throws = self.throws
        explained = throws.explained(losses, self._lengths)
        asked = explained < self._limits
        # Where nothing was found, another θ_s is more likely to help than more motions.
        asked &= (explained > self.explained) | (self._steps % 2 == 1)
        rows = np.flatnonzero(asked)
        if not rows.size:
            return losses
        present = self._states, self._lengths, self._spreads
        old = [each.copy() for each in present]
        stretch = Stretch(throws, worlds, rows, explained[rows], level)
        found = way(stretch)
        self._take(stretch, found)
        self._limits[rows] = np.minimum(self._limits[rows], found.ends)
        self._spreads[:] = throws.spreads(self._states, level)
        after = self._losses(worlds, self._states)
        lost = throws.explained(after, self._lengths) < explained
        for new, kept in zip(present, old, strict=True):
            new[lost] = kept[lost]
        after.take(losses, lost)
        return after

    def _drawn(self, stretch: Stretch) -> Continuation:
        """Follow motions that are drawn, with links between segments."""
        begun = self._begun_at(stretch)
        before = self._known_at(stretch).losses(begun)
        motions = Continuations(stretch, begun, self._generator)
        return motions.follow(self._states, self._lengths, self._limits, before)

    def _shot(self, stretch: Stretch) -> Continuation:
        """Lead motions without links to the points."""
        shooting = Shooting(stretch, self._limits[stretch.rows], self._known_at(stretch))
        return shooting.go_on(self._begun_at(stretch))

    def _known_at(self, stretch: Stretch) -> KnownStates:
        """Return what is known of the states in which motions begin."""
        rows, first = stretch.rows, stretch.first
        covariances = self._smoothed.covariances[rows, first]
        centres = self._states[rows, first]
        precisions = self._smoothed.precisions[rows, first]
        starts = first == 0
        centres[starts] = self.throws.initial_states[rows[starts]]
        initial = self.throws.initial_precisions[rows[starts]]
        precisions[starts] = initial[:, :, None] * np.eye(initial.shape[1])
        return KnownStates(centres, precisions, np.sqrt(np.einsum("rii->ri", covariances)))

    def _begun_at(self, stretch: Stretch) -> NDArray[np.float64]:
        """Draw states (r, M, 13) in which motions begin; the first is that of the present path."""
        rows, first = stretch.rows, stretch.first
        scales = np.resize(FIRST_PARTS, self._begun.shape[1])
        scales[0] = 0.0
        changes = self._smoothed.drawn(rows, first, scales, self._generator)
        begun = moved(self._states[rows, first][:, None], changes)
        new = self._lengths[rows] == 0
        begun[new] = self._begun[rows[new]]
        return begun

    def _take(self, stretch: Stretch, found: Continuation) -> None:
        """Let throws go on as found, the states before follow."""
        rows, first = stretch.rows, stretch.first
        for a in np.flatnonzero(found.counts).tolist():
            row, begin, end = int(rows[a]), int(first[a]), int(first[a] + found.counts[a])
            moves = change(found.states[a, 0], self._states[row, begin])
            follow = self._smoothed.before(row, begin, moves)
            self._states[row, :begin] = moved(self._states[row, :begin], follow)
            self._states[row, begin:end] = found.states[a, : end - begin]
            self._lengths[row] = end

    def _linearised(
        self, unit: NDArray[np.float64], deviations: NDArray[np.float64], level: float
    ) -> SegmentEquations:
        state_deviations = np.sqrt(np.einsum("akii->aki", self._covariances))
        # A state that is new is spread as its link is.
        first = np.broadcast_to(level * CHANGE_SPREADS, self._spreads[:, :1].shape)
        new = np.concatenate([first, self._spreads[:, :-1]], axis=1)
        state_deviations = np.where(state_deviations > 0.0, state_deviations, new)
        return segment_equations(
            self.throws,
            self._states,
            self.explained,
            self._spreads,
            state_deviations,
            unit,
            deviations,
        )
