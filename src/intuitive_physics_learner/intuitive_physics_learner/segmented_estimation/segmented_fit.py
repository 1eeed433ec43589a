"""The fit of θ_s to throws in segments, whose links become exact while θ_s becomes known.

A fit from one initial state for each throw ends where motion becomes chaotic: boxes that tumble for
five seconds are explained for one. And there it holds θ_s at one of many optima. Here each segment
has a state of its own (`segmented_throws`), first with links so loose that a wrong θ_s explains the
whole motion. θ_s and all states take Gauss-Newton steps (`segment_equations`); throws go on where
many motions find a way (`continuations`); and as soon as θ_s has settled with some spread of links,
the spread becomes smaller (annealing).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.simulation import Simulator, WorldBatch
from intuitive_physics_learner.joint_estimation.joint_fit import LARGEST_MOVE, JointFit
from intuitive_physics_learner.joint_estimation.normal_equations import (
    Elimination,
    agreement_weights,
    bounded_step,
    reduced_equations,
)
from intuitive_physics_learner.joint_estimation.widened_uncertainty import (
    deviations_by_value,
    jackknife_variances,
    widened_information,
)
from intuitive_physics_learner.search.gaussian import Gaussian, LocalLikelihood
from intuitive_physics_learner.segmented_estimation.chaotic_states import CHANGE_SPREADS, moved
from intuitive_physics_learner.segmented_estimation.continuations import (
    BACK,
    FIRST_PARTS,
    MOTIONS,
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

FIRST_LEVEL, LAST_LEVEL = 4.0, 0.05
"""Spread of links at first and at last, in `chaotic_states.SPREADS`. At 4 a filter follows boxes to
their end at the θ_s at which a fit of initial states has stopped, at 1 to a third of it."""

ANNEALING = 0.75
"""Factor on the spread after a step at which θ_s has settled; from 0.7 to 0.88 the same errors;
set by hand."""

SETTLED_DECREMENT = 1.0
"""Square of a Newton step in standard deviations, for each parameter, below which θ_s has settled
at a spread; set by hand."""

STEP_PART = 0.5
"""Part of a Newton step of θ_s that is taken: states follow it by one step only; set by hand."""

STATE_DAMPINGS = (0.01, 1.0)
"""Dampings of the steps of states that are tried; set by hand."""

LARGEST_STATE_STEP = 10.0
"""Largest step of a component of a state, in spreads; set by hand."""

AVERAGED = 4
"""Steps that the result is the mean over; set by hand."""

EARLIER = 7
"""Steps before the last ones with which these are compared: the spread of links was seven times as
large then."""

MOST_STEPS = 60
"""Steps at most; set by hand."""

USABLE_LEVEL = 1.0
"""Spread of links from which on the result is better than that of a fit of single states, where the
time ends before the last one; set by hand."""

SIMULATIONS = 570
"""Simulations of whole throws that take as long as a fit in segments of one of them."""


def segment_simulations(fit: JointFit) -> float:
    """Simulations of single observations that take as long as a fit in segments, about."""
    return float(SIMULATIONS * len(fit.model.cost.observations))


class SegmentedFit:
    """Goes on from where a fit of initial states has stopped.

    Parameters
    ----------
    fit : to throws of one object each, from single initial states
    simulator : of the segments
    generator : of the motions that are tried

    Attributes
    ----------
    unit : (n,) θ_s on the unit cube
    deviations : (n,) standard deviation of each parameter, widths
    level : spread of links
    steps : taken so far
    explained : (A,) segments of each throw that are explained
    """

    def __init__(self, fit: JointFit, simulator: Simulator, generator: np.random.Generator) -> None:
        self._prior, self._space, self._generator = fit.prior, fit.model.space, generator
        self.throws = SegmentedThrows(fit, simulator)
        self.unit, self.deviations = fit.unit.copy(), fit.deviations.copy()
        self.level, self.steps = FIRST_LEVEL, 0
        self._begun = fit.state_draws(generator, MOTIONS)[:, :, 0]
        shape = self.throws.shape
        self._states = np.zeros((*shape, 13))
        self._states[..., 6] = 1.0
        self._lengths = np.zeros(shape[0], dtype=np.int64)
        self._limits = self.throws.points.counts.copy()
        self.explained = self._lengths
        self._covariances = np.zeros((*shape, 12, 12))
        self._given_weights = self._weights = fit.model.task.weights
        self._units: list[NDArray[np.float64]] = []
        self._said: list[LocalLikelihood] = []

    @property
    def finished(self) -> bool:
        """Whether links are as exact as they shall be, and θ_s has settled."""
        return self.level < LAST_LEVEL or self.steps >= MOST_STEPS

    @property
    def usable(self) -> bool:
        """Whether the result is better than that of the fit it began at."""
        return self.level <= USABLE_LEVEL and self.steps > AVERAGED

    def knowledge(self) -> Gaussian:
        """Return what all throws say of θ_s: with the prior of the fit, the mean of the last steps.

        To the variances by slopes are added those of the jackknife, for throws that have taken a
        wrong turn, and the square of what θ_s has moved while links became more exact. They are
        those of values in SI units.
        """
        mean = np.mean(self._units[-AVERAGED:], axis=0)
        earlier = np.mean(self._units[-AVERAGED - EARLIER : -EARLIER] or self._units[:1], axis=0)
        observed = Gaussian.nothing(mean.size).plus(self._said, self._weights)
        slopes = np.diag(observed.bounded(mean).covariance)
        left_out = jackknife_variances(observed, mean, self._said, self._weights)
        deviations = np.sqrt(slopes + left_out + (mean - earlier) ** 2)
        deviations = deviations_by_value(self._space, np.clip(mean, 0.0, 1.0), deviations)
        factors = deviations / np.sqrt(slopes)
        precision = widened_information(observed.precision, factors, deviations)
        # Where the whole loss is least, the throws pull as the prior does, to the other side.
        return Gaussian(precision, precision @ mean + self._prior.scores(mean))

    def step(self) -> None:
        """Let throws go on, and take a step of θ_s and all states."""
        self.steps += 1
        worlds = self.throws.worlds([self.unit])
        spreads = self.throws.spreads(self._states, self.level)
        losses = self._losses(worlds, spreads)
        if self._go_on(worlds, losses):
            spreads = self.throws.spreads(self._states, self.level)
            losses = self._losses(worlds, spreads)
        self.explained = self.throws.explained(losses, self._lengths)
        equations = self._equations(spreads)
        eliminated = equations.eliminated()
        step = self._step_parameters(eliminated)
        self._step_states(equations, eliminated, step, spreads)
        self._units.append(self.unit)

    def _losses(self, worlds: WorldBatch, spreads: NDArray[np.float64]) -> PathLosses:
        return self.throws.losses(worlds, self._states, self._lengths, spreads)

    def _go_on(self, worlds: WorldBatch, losses: PathLosses) -> bool:
        """Look for a way beyond what is explained; return whether any throw was followed."""
        throws = self.throws
        explained = throws.explained(losses, self._lengths)
        asked = explained < self._limits
        # Where nothing was found, another θ_s is more likely to help than more motions.
        asked &= (explained > self.explained) | (self.steps % 2 == 1)
        rows = np.flatnonzero(asked)
        if not rows.size:
            return False
        first = np.maximum(explained[rows] - BACK, 0)
        begun = self._begun[rows].copy()
        known = np.flatnonzero(self._lengths[rows] > 0)
        begun[known] = self._spread(rows[known], first[known])
        last = np.maximum(first - 1, 0)
        spreads = throws.link_spreads(rows, self._states[rows, last][:, None], begun, self.level)
        before = throws.link_losses(losses.ends[rows, last][:, None], begun, spreads)
        before = np.where((first == 0)[:, None], throws.initial_losses(rows, begun), before)
        followed = Continuations(
            throws, worlds, rows, first, begun, self.level, self._generator
        ).follow(self._states, self._lengths, self._limits, before)
        for a in np.flatnonzero(followed.counts).tolist():
            row, begin, count = rows[a], first[a], followed.counts[a]
            self._states[row, begin : begin + count] = followed.states[a, :count]
            self._lengths[row] = begin + count
        self._limits[rows] = np.minimum(self._limits[rows], followed.ends)
        return True

    def _spread(self, rows: NDArray[np.int64], segments: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return states (r, M, 13) about those in which segments (r,) of throws (r,) begin."""
        covariances = self._covariances[rows, segments]
        values, vectors = np.linalg.eigh(covariances)
        factors = vectors * np.sqrt(np.maximum(values, 0.0))[:, None]
        normal = self._generator.normal(size=(rows.size, MOTIONS, 12))
        normal *= np.resize(FIRST_PARTS, MOTIONS)[:, None]
        normal[:, 0] = 0.0
        changes = normal @ factors.swapaxes(1, 2)
        return moved(self._states[rows, segments][:, None], changes)

    def _equations(self, spreads: NDArray[np.float64]) -> SegmentEquations:
        deviations = np.sqrt(np.einsum("akii->aki", self._covariances))
        # A state that is new is spread as its link is.
        first = np.broadcast_to(self.level * CHANGE_SPREADS, spreads[:, :1].shape)
        new = np.concatenate([first, spreads[:, :-1]], axis=1)
        deviations = np.where(deviations > 0.0, deviations, new)
        return segment_equations(
            self.throws,
            self._states,
            self.explained,
            spreads,
            deviations,
            self.unit,
            self.deviations,
        )

    def _step_parameters(self, eliminated: Elimination) -> NDArray[np.float64]:
        """Take a part of a Newton step of θ_s, and let links be more exact; return it (n,)."""
        agreement = agreement_weights(self._prior, self.unit, [eliminated], self._weights)
        self._weights = self._given_weights * agreement
        information, scores = reduced_equations(self._prior, self.unit, [eliminated], self._weights)
        self._said = [
            LocalLikelihood(parameters, self.unit, each, score, 0.0)
            for parameters, each, score in zip(
                eliminated.parameters, eliminated.information, eliminated.scores, strict=True
            )
        ]
        whole = bounded_step(self.unit, information, scores, 0.0)
        step = STEP_PART * np.clip(whole, -LARGEST_MOVE, LARGEST_MOVE)
        self.unit = self.unit + step
        self.deviations = np.sqrt(np.diag(np.linalg.inv(information)))
        if whole @ information @ whole < SETTLED_DECREMENT * whole.size:
            self.level *= ANNEALING
        return step

    def _step_states(
        self,
        equations: SegmentEquations,
        eliminated: Elimination,
        step: NDArray[np.float64],
        spreads: NDArray[np.float64],
    ) -> None:
        """Take the best of several damped steps of the states of each throw."""
        self._covariances = equations.covariances
        worlds = self.throws.worlds([self.unit])
        best = self._losses(worlds, spreads)
        states = self._states.copy()
        for damping in STATE_DAMPINGS:
            gains, offsets = equations.solved(damping)
            changes = np.clip(
                -offsets - gains @ step,
                -LARGEST_STATE_STEP * CHANGE_SPREADS,
                LARGEST_STATE_STEP * CHANGE_SPREADS,
            )
            trying = moved(self._states, changes)
            losses = self.throws.losses(worlds, trying, self._lengths, spreads)
            better = losses.totals(self.explained) < best.totals(self.explained)
            states[better] = trying[better]
            best.take(losses, better)
        self._states = states
