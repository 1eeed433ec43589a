"""Simulations near an estimate of θ_s and initial states, and the posterior that follows."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.prior_knowledge.initial_spins import InitialSpins
from intuitive_physics.prior_knowledge.spin_evidence import SpinLikelihood, unknown_spins
from intuitive_physics.simulation.shares import mapped_in_shares
from intuitive_physics_learner.joint_estimation.fit_horizons import (
    TrajectoryFits,
    farthest_horizons,
)
from intuitive_physics_learner.joint_estimation.linearisation import (
    Linearisation,
    ParameterSteps,
    linearise,
    separate_groups,
)
from intuitive_physics_learner.joint_estimation.normal_equations import (
    Elimination,
    NormalEquations,
    joint_posterior,
)
from intuitive_physics_learner.joint_estimation.observation_blocks import (
    ObservationBlock,
    observation_blocks,
)
from intuitive_physics_learner.search.gaussian import Gaussian, LocalLikelihood
from intuitive_physics_learner.search.learning_task import FitTask

Result = TypeVar("Result")


@dataclass(eq=False)
class Estimate:
    """θ_s and initial states with their uncertainty.

    Parameters
    ----------
    unit : (n,) θ_s on the unit cube
    deviations : (n,) standard deviation of each parameter there
    fits : of each block
    """

    unit: NDArray[np.float64]
    deviations: NDArray[np.float64]
    fits: list[TrajectoryFits]


class TrajectoryModel:
    """Simulates observations near an estimate.

    `largest_advance` in s, by which a fit horizon advances at most in one step; `blocks` the stated
    ones of a model of the same observations; None: they are made.

    Attributes
    ----------
    stated_blocks : the observations, with the initial spins as they were stated
    blocks : the same, with wider priors of the initial spins that were guesses
    groups : (n_members,) each, indices of parameters, as `separate_groups`
    unknown_spins : by observation, initial spins that were guesses
    spins : spreads of initial spins by which the priors of those that were guesses are widened
    simulations : of single observations, so far; one up to half of the last point counts half
    """

    def __init__(
        self, task: FitTask, largest_advance: float, blocks: list[ObservationBlock] | None = None
    ) -> None:
        self.task = task
        self.cost = task.cost
        self.space = task.space
        self.prior = task.prior
        self.simulations = 0.0
        if blocks is None:
            blocks = observation_blocks(task.cost.observations, task.influence)
        self.blocks = self.stated_blocks = blocks
        self.largest_advance = largest_advance
        self.spins = InitialSpins()
        self.unknown_spins = {
            int(member): unknown_spins(task.cost.observations[member], components)
            for block in self.blocks
            for member, components in zip(
                block.members, block.initial_states.components, strict=True
            )
        }
        self.groups = separate_groups(task.influence)

    def initial_estimate(self) -> Estimate:
        """Return the estimate before any step: the prior, and the observed initial states."""
        fits = [TrajectoryFits.initial(block) for block in self.blocks]
        return Estimate(np.clip(self.prior.mean, 0.0, 1.0), self.prior.deviations, fits)

    def parts(self, estimate: Estimate) -> Iterator[tuple[ObservationBlock, TrajectoryFits]]:
        """Yield blocks, with the points that horizons can reach in one step, and their fits."""
        for block, fit in zip(self.blocks, estimate.fits, strict=True):
            yield block.shortened(fit.horizons + self.largest_advance), fit

    def of_blocks(self, work: Callable[[int], Result]) -> list[Result]:
        """Return what `work` returns for the index of each block, in the threads of the cost."""
        return mapped_in_shares(work, range(len(self.blocks)), self.cost.threads)

    def count(self, block: ObservationBlock, until: NDArray[np.float64], each: int) -> None:
        """Count simulations of each observation of a block, up to `until` (W,) s."""
        self.simulations += each * _whole_simulations(block, until)

    def widen_spins(self, spins: InitialSpins) -> None:
        """Widen the prior of each initial spin that was a guess to the spread of its material.

        The guess stays where it is wider: of throws unlike the others nothing is forbidden.
        """
        if not spins and not self.spins:
            return
        self.spins, self.blocks = spins, []
        for block in self.stated_blocks:
            deviations = block.prior_deviations.copy()
            for state_deviations, member in zip(deviations, block.members, strict=True):
                for spin in self.unknown_spins[int(member)]:
                    spread = spins.by_material.get(spin.material)
                    if spread is not None:
                        state_deviations[spin.places] = max(spin.stated, spread.deviation)
            self.blocks.append(replace(block, prior_deviations=deviations))

    def spin_likelihoods(
        self, block: ObservationBlock, means: NDArray[np.float64], covariances: NDArray[np.float64]
    ) -> list[tuple[SpinLikelihood, ...]]:
        """Return what each of a block's W observations says of its initial spins.

        `means` (W, d) and `covariances` (W, d, d) of the nuisance parameters, whatever θ_s is.
        """
        return [
            tuple(
                SpinLikelihood.of(
                    spin,
                    means[row, spin.places],
                    covariances[row][np.ix_(spin.places, spin.places)],
                    float(block.prior_deviations[row, spin.places[0]]),
                )
                for spin in self.unknown_spins[int(member)]
            )
            for row, member in enumerate(block.members)
        ]

    def linearised(self, estimate: Estimate, widening: float = 1.0) -> list[Linearisation]:
        """Take slopes over `widening` times the usual steps."""
        deviations = widening * estimate.deviations
        steps = ParameterSteps(estimate.unit, deviations, self.groups, self.space.to_parameters)
        parts = list(self.parts(estimate))
        horizons = [farthest_horizons(b, part.horizons, self.largest_advance) for b, part in parts]
        for (block, _), until in zip(parts, horizons, strict=True):
            unknowns = block.initial_states.components.shape[1] + block.parameters.shape[1]
            self.count(block, until, 1 + 2 * unknowns)

        def linearised_block(index: int) -> Linearisation:
            (block, part), until = parts[index], horizons[index]
            state_deviations = widening * part.deviations
            return linearise(self.cost, block, part.estimate, state_deviations, steps, until)

        return self.of_blocks(linearised_block)

    def equations(
        self, estimate: Estimate, linear: Sequence[Linearisation]
    ) -> list[NormalEquations]:
        """Set up the equations of each block with the points up to the fit horizons."""
        parts = list(self.parts(estimate))

        def equations_of_block(index: int) -> NormalEquations:
            block, part = parts[index]
            return NormalEquations.of(block, part.estimate, linear[index], part.horizons)

        return self.of_blocks(equations_of_block)

    def posterior(
        self, estimate: Estimate, equations: Sequence[NormalEquations], weights: NDArray[np.float64]
    ) -> tuple[Gaussian, list[Elimination]]:
        """Return the posterior of the parameters, and the initial states as functions of them.

        `weights` (n_observations,) of the observations.
        """
        eliminated = [each.eliminated() for each in equations]
        return joint_posterior(self.prior, estimate.unit, eliminated, weights), eliminated

    def likelihoods(
        self, estimate: Estimate, weights: NDArray[np.float64]
    ) -> list[LocalLikelihood]:
        """Return what each observation says of θ_s near an estimate, in their order.

        `weights` (n_observations,) with which all together say what θ_s is, for initial spins.
        """
        likelihoods: dict[int, LocalLikelihood] = {}
        linear = self.linearised(estimate)
        equations = self.equations(estimate, linear)
        posterior, eliminated = self.posterior(estimate, equations, weights)
        for (block, part), slopes, equation, left in zip(
            self.parts(estimate), linear, equations, eliminated, strict=True
        ):
            covariances = equation.state_covariances(left, posterior)
            means = left.state_means(part.estimate, estimate.unit, posterior)
            spins = self.spin_likelihoods(block, means, covariances)
            present = part.estimate[None], slopes.residuals[None]
            d, scale = equation.state_size, block.prior_deviations
            inner = equation.hessian[:, :d, :d] * scale[:, :, None] * scale[:, None, :]
            losses = part.losses(block, *present)[0] + 0.5 * np.linalg.slogdet(inner)[1]
            for row, member in enumerate(block.members):
                likelihoods[int(member)] = LocalLikelihood(
                    block.parameters[row],
                    estimate.unit[block.parameters[row]],
                    left.information[row],
                    left.scores[row],
                    float(losses[row]),
                    spins[row],
                )
        return [likelihoods[member] for member in range(len(likelihoods))]

    def simulations_of(self, estimate: Estimate, each: int) -> float:
        """Simulations of a linearisation with `each` of them for each parameter."""
        return sum(
            (1 + 2 * block.initial_states.components.shape[1] + each * block.parameters.shape[1])
            * _whole_simulations(
                block, farthest_horizons(block, part.horizons, self.largest_advance)
            )
            for block, part in self.parts(estimate)
        )


def _whole_simulations(block: ObservationBlock, until: NDArray[np.float64]) -> float:
    """Return how many simulations to the end take as long as one of each up to (W,) s."""
    return float((until / block.durations).sum())
