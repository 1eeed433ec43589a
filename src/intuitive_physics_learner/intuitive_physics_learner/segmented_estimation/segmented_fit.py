"""The fit of θ_s to throws in segments, whose links become exact while θ_s becomes known.

A fit from one initial state for each throw ends where motion becomes chaotic: boxes that tumble for
five seconds are explained for one. And there it holds θ_s at one of many optima. Here each segment
has a state of its own (`segmented_throws`), first with links so loose that a wrong θ_s explains the
whole motion. θ_s and all states take Gauss-Newton steps (`segment_equations`); throws go on where
many motions find a way (`continuations`); and as soon as θ_s has settled with some spread of links,
the spread becomes smaller (annealing).
"""

from __future__ import annotations

from collections.abc import Sequence
from operator import methodcaller

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.simulation import Simulator
from intuitive_physics.simulation.shares import mapped_in_shares
from intuitive_physics_learner.joint_estimation.damped_steps import LARGEST_MOVE
from intuitive_physics_learner.joint_estimation.joint_fit import JointFit, ObservationFit
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
from intuitive_physics_learner.segmented_estimation.chaotic_states import change
from intuitive_physics_learner.segmented_estimation.continuations import MOTIONS
from intuitive_physics_learner.segmented_estimation.segmented_paths import SegmentedPaths
from intuitive_physics_learner.segmented_estimation.segmented_throws import SegmentedThrows

FIRST_LEVEL, LAST_LEVEL = 4.0, 0.01
"""Spread of links at first and at last, in `chaotic_states.SPREADS`. At 4 a filter follows boxes to
their end at the θ_s at which a fit of initial states has stopped, at 1 to a third of it. With an
end at 0.05 the mean excess of 31 boxes was 0.12, at 0.02 and 0.01 0.09 to 0.10, at 0.004 0.11."""

ANNEALING = 0.75
"""Factor on the spread after a step at which θ_s has settled; from 0.7 to 0.88 the same errors;
set by hand."""

SETTLED_DECREMENT = 1.0
"""Square of a Newton step in standard deviations, for each parameter, below which θ_s has settled
at a spread; set by hand."""

STEP_PART = 0.5
"""Part of a Newton step of θ_s that is taken: states follow it by one step only; set by hand."""

THROWS_OF_A_PART = 20
"""Throws of which paths are worked on together at least; set by hand."""

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

SIMULATIONS = 1000
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
    """

    def __init__(self, fit: JointFit, simulator: Simulator, generator: np.random.Generator) -> None:
        self._begun = fit
        self._prior, self._space, self._threads = fit.prior, fit.model.space, simulator.threads
        self.unit, self.deviations = fit.unit.copy(), fit.deviations.copy()
        self.level, self.steps = FIRST_LEVEL, 0
        begun = fit.state_draws(generator, MOTIONS)[:, :, 0]
        shares = np.array_split(np.arange(len(begun)), max(1, len(begun) // THROWS_OF_A_PART))
        self._parts = [
            SegmentedPaths(SegmentedThrows(fit, simulator, members), begun[members], own)
            for members, own in zip(shares, generator.spawn(len(shares)), strict=True)
        ]
        self._given_weights = self._weights = fit.model.task.weights
        self._units: list[NDArray[np.float64]] = []
        self._said: list[LocalLikelihood] = []

    @property
    def explained(self) -> NDArray[np.int64]:
        """Segments (A,) of each throw that are explained."""
        return np.concatenate([part.explained for part in self._parts])

    @property
    def simulations(self) -> float:
        """Simulations of whole throws so far."""
        return sum(part.throws.simulations for part in self._parts)

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

    def observation_fits(self) -> list[ObservationFit | None]:
        """Return how each throw began, and up to when one motion from there explains it.

        None where it explains no segment.
        """
        begun = self._begun.observation_fits()
        fits: list[ObservationFit | None] = [None] * len(begun)
        starts = [part.known_starts(self.unit) for part in self._parts]
        states, deviations, until = (np.concatenate(each) for each in zip(*starts, strict=True))
        for block in self._begun.model.blocks:
            apart = change(states[block.members], block.initial_states.observed[:, 0])
            for k, member in enumerate(block.members.tolist()):
                if until[member] > 0.0:
                    free, before = block.initial_states.components[k], begun[member]
                    # What follows are shared errors, as they were taken out of the points.
                    shared = slice(free.size, None)
                    fits[member] = ObservationFit(
                        np.concatenate([apart[k, free], before.estimate[shared]]),
                        np.concatenate([deviations[member, free], before.deviations[shared]]),
                        float(until[member]),
                    )
        return fits

    def step(self) -> None:
        """Let throws go on, and take a step of θ_s and all states."""
        self.steps += 1
        go_on = methodcaller("go_on", self.unit, self.deviations, self.level)
        step = self._step_parameters(mapped_in_shares(go_on, self._parts, self._threads))
        take_steps = methodcaller("take_steps", self.unit, step)
        mapped_in_shares(take_steps, self._parts, self._threads)
        self._units.append(self.unit)

    def _step_parameters(self, eliminated: Sequence[Elimination]) -> NDArray[np.float64]:
        """Take a part of a Newton step of θ_s, and let links be more exact; return it (n,)."""
        agreement = agreement_weights(self._prior, self.unit, eliminated, self._weights)
        self._weights = self._given_weights * agreement
        information, scores = reduced_equations(self._prior, self.unit, eliminated, self._weights)
        self._said = [
            LocalLikelihood(parameters, self.unit, each, score, 0.0)
            for part in eliminated
            for parameters, each, score in zip(
                part.parameters, part.information, part.scores, strict=True
            )
        ]
        whole = bounded_step(self.unit, information, scores, 0.0)
        step = STEP_PART * np.clip(whole, -LARGEST_MOVE, LARGEST_MOVE)
        self.unit = self.unit + step
        self.deviations = np.sqrt(np.diag(np.linalg.inv(information)))
        if whole @ information @ whole < SETTLED_DECREMENT * whole.size:
            self.level *= ANNEALING
        return step
