"""The paths of throws in segments at a given θ_s: followed farther, linearised, and stepped.

Given θ_s, throws have nothing to do with each other. So a fit has them in several parts, which take
their steps side by side.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.simulation import WorldBatch
from intuitive_physics_learner.joint_estimation.normal_equations import Elimination
from intuitive_physics_learner.segmented_estimation.chaotic_states import CHANGE_SPREADS, moved
from intuitive_physics_learner.segmented_estimation.continuations import (
    BACK,
    FIRST_PARTS,
    Continuations,
)
from intuitive_physics_learner.segmented_estimation.segment_equations import (
    SegmentEquations,
    segment_equations,
)
from intuitive_physics_learner.segmented_estimation.segmented_throws import (
    PathLosses,
    SegmentedThrows,
)

STATE_DAMPINGS = (0.01, 1.0)
"""Dampings of the steps of states that are tried; set by hand."""

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
        if self._followed(worlds, losses, level):
            self._spreads = self.throws.spreads(self._states, level)
            losses = self._losses(worlds, self._states)
        self.explained = self.throws.explained(losses, self._lengths)
        self._equations = self._linearised(unit, deviations, level)
        self._covariances = self._equations.covariances
        eliminated = self._equations.eliminated()
        return replace(eliminated, members=self.throws.members)

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

    def _followed(self, worlds: WorldBatch, losses: PathLosses, level: float) -> bool:
        """Look for a way beyond what is explained; return whether any throw was followed."""
        throws = self.throws
        explained = throws.explained(losses, self._lengths)
        asked = explained < self._limits
        # Where nothing was found, another θ_s is more likely to help than more motions.
        asked &= (explained > self.explained) | (self._steps % 2 == 1)
        rows = np.flatnonzero(asked)
        if not rows.size:
            return False
        first = np.maximum(explained[rows] - BACK, 0)
        begun = self._begun[rows].copy()
        known = np.flatnonzero(self._lengths[rows] > 0)
        begun[known] = self._spread(rows[known], first[known])
        last = np.maximum(first - 1, 0)
        spreads = throws.link_spreads(rows, self._states[rows, last][:, None], begun, level)
        before = throws.link_losses(losses.ends[rows, last][:, None], begun, spreads)
        before = np.where((first == 0)[:, None], throws.initial_losses(rows, begun), before)
        found = Continuations(throws, worlds, rows, first, begun, level, self._generator).follow(
            self._states, self._lengths, self._limits, before
        )
        for a in np.flatnonzero(found.counts).tolist():
            row, begin, count = rows[a], first[a], found.counts[a]
            self._states[row, begin : begin + count] = found.states[a, :count]
            self._lengths[row] = begin + count
        self._limits[rows] = np.minimum(self._limits[rows], found.ends)
        return True

    def _spread(self, rows: NDArray[np.int64], segments: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return states (r, M, 13) about those in which segments (r,) of throws (r,) begin."""
        covariances = self._covariances[rows, segments]
        values, vectors = np.linalg.eigh(covariances)
        factors = vectors * np.sqrt(np.maximum(values, 0.0))[:, None]
        motions = self._begun.shape[1]
        normal = self._generator.normal(size=(rows.size, motions, 12))
        normal *= np.resize(FIRST_PARTS, motions)[:, None]
        normal[:, 0] = 0.0
        changes = normal @ factors.swapaxes(1, 2)
        return moved(self._states[rows, segments][:, None], changes)

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
