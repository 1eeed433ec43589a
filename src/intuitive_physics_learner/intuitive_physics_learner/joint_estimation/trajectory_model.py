"""Simulations near an estimate of θ_s and initial states, and the posterior that follows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.parameter_posterior import UNIFORM_PRECISION
from intuitive_physics.prior_knowledge.initial_spins import InitialSpins
from intuitive_physics_learner.joint_estimation.coordinate_scan import (
    ScanCandidates,
    scanned_states,
)
from intuitive_physics_learner.joint_estimation.fit_horizons import (
    TrajectoryFits,
    farthest_horizons,
)
from intuitive_physics_learner.joint_estimation.initial_spins.spin_evidence import (
    SpinLikelihood,
    unknown_spins,
)
from intuitive_physics_learner.joint_estimation.initial_spins.spin_search import search_spins
from intuitive_physics_learner.joint_estimation.linearisation import (
    Linearisation,
    ParameterSteps,
    linearise,
    separate_groups,
)
from intuitive_physics_learner.joint_estimation.normal_equations import (
    Elimination,
    LocalLikelihood,
    NormalEquations,
    joint_posterior,
    reduced_equations,
)
from intuitive_physics_learner.joint_estimation.observation_blocks import (
    ObservationBlock,
    observation_blocks,
)
from intuitive_physics_learner.joint_estimation.settings import JointEstimationSettings
from intuitive_physics_learner.search.gaussian import Gaussian
from intuitive_physics_learner.search.learning_task import FitTask
from intuitive_physics_learner.search.one_sided_intervals import MOVE_GROWTH

CURVATURE_WIDENING = 3.0
"""Factor on the steps of the finite differences from which the posterior is computed; set by
hand."""

MOVE_ROUNDS = 8
"""Rounds of moving a parameter outwards from the estimate, and of bisecting the end; set by
hand."""

LARGEST_MOVE_RISE = 4.5
"""Rise of the loss up to which a move is plausible, that of three standard deviations: a fit may
gain more than that of two by making a ball slip that does not; below the 6 of a parabola at 2 √3
standard deviations."""


@dataclass(eq=False)
class Estimate:
    """θ_s and initial states with their uncertainty.

    Parameters
    ----------
    unit : (n,) θ_s on the unit cube
    deviations : (n,) standard deviation of each parameter there
    fits : initial states and fit horizons, of each block
    """

    unit: NDArray[np.float64]
    deviations: NDArray[np.float64]
    fits: list[TrajectoryFits]


class TrajectoryModel:
    """Simulates observations near an estimate.

    Attributes
    ----------
    task : as given
    cost, space, prior : those of the task
    blocks : the observations
    spins : spreads of initial spins by which the priors of those that were guesses are widened
    simulations : of single observations, so far; one up to half of the last point counts half
    """

    def __init__(self, task: FitTask, settings: JointEstimationSettings) -> None:
        self.task = task
        self.cost = task.cost
        self.space = task.space
        self.prior = task.prior
        self.settings = settings
        self.simulations = 0.0
        self.blocks = self._stated = observation_blocks(task.cost.observations, task.influence)
        self.spins = InitialSpins()
        self._unknown_spins = {
            int(member): unknown_spins(task.cost.observations[member], components)
            for block in self.blocks
            for member, components in zip(
                block.members, block.initial_states.components, strict=True
            )
        }
        self._groups = separate_groups(task.influence)

    def initial_estimate(self) -> Estimate:
        """Return the estimate before any step: the prior, and the observed initial states."""
        fits = [TrajectoryFits.initial(block) for block in self.blocks]
        return Estimate(np.clip(self.prior.mean, 0.0, 1.0), self.prior.deviations, fits)

    def parts(self, estimate: Estimate) -> Iterator[tuple[ObservationBlock, TrajectoryFits]]:
        """Yield blocks, with the points that horizons can reach in one step, and their fits."""
        for block, fit in zip(self.blocks, estimate.fits, strict=True):
            yield block.shortened(fit.horizons + self.settings.largest_advance), fit

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
        for block in self._stated:
            deviations = block.prior_deviations.copy()
            for state_deviations, member in zip(deviations, block.members, strict=True):
                for spin in self._unknown_spins[int(member)]:
                    spread = spins.by_material.get(spin.material)
                    if spread is not None:
                        state_deviations[spin.places] = max(spin.stated, spread.deviation)
            self.blocks.append(replace(block, prior_deviations=deviations))

    def other_spins(self, estimate: Estimate) -> dict[int, tuple[NDArray[np.float64], float]]:
        """Find spins that explain more than those of an estimate, as `search_spins`.

        Returns
        -------
        By observation, where there are any, deviations (d,) from its observed initial states, and
        the time in s up to which they explain more.
        """
        parameters = self.space.to_parameters(estimate.unit)
        others = {}
        for block, fits in zip(self.blocks, estimate.fits, strict=True):
            unknown = [self._unknown_spins[int(member)] for member in block.members]
            estimates, ends, gained = search_spins(
                self.cost, block, fits, unknown, parameters, self.settings.largest_advance
            )
            for row in np.flatnonzero(gained).tolist():
                others[int(block.members[row])] = estimates[row], float(ends[row])
        return others

    def spin_likelihoods(
        self, block: ObservationBlock, fits: TrajectoryFits, covariances: NDArray[np.float64]
    ) -> list[tuple[SpinLikelihood, ...]]:
        """Return what each of a block's W observations says of its initial spins.

        `covariances` (W, d, d) of the nuisance parameters, whatever θ_s is.
        """
        return [
            tuple(
                SpinLikelihood.of(
                    spin,
                    fits.estimate[row, spin.places],
                    covariances[row][np.ix_(spin.places, spin.places)],
                    float(block.prior_deviations[row, spin.places[0]]),
                )
                for spin in self._unknown_spins[int(member)]
            )
            for row, member in enumerate(block.members)
        ]

    def linearised(self, estimate: Estimate, widening: float = 1.0) -> list[Linearisation]:
        """Take slopes over `widening` times the usual steps."""
        deviations = widening * estimate.deviations
        steps = ParameterSteps(estimate.unit, deviations, self._groups, self.space.to_parameters)
        linear = []
        for block, part in self.parts(estimate):
            until = farthest_horizons(block, part.horizons, self.settings.largest_advance)
            unknowns = block.initial_states.components.shape[1] + block.parameters.shape[1]
            self.count(block, until, 1 + 2 * unknowns)
            state_deviations = widening * part.deviations
            linear.append(
                linearise(self.cost, block, part.estimate, state_deviations, steps, until)
            )
        return linear

    def equations(
        self, estimate: Estimate, linear: Sequence[Linearisation]
    ) -> list[NormalEquations]:
        """Set up the equations of each block with the points up to the fit horizons."""
        return [
            NormalEquations.of(block, part.estimate, each, part.horizons)
            for (block, part), each in zip(self.parts(estimate), linear, strict=True)
        ]

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

        `weights` (n_observations,) with which all of them together say what θ_s is, where an
        observation is asked for its initial spins.
        """
        likelihoods: dict[int, LocalLikelihood] = {}
        linear = self.linearised(estimate)
        equations = self.equations(estimate, linear)
        posterior, eliminated = self.posterior(estimate, equations, weights)
        for (block, part), slopes, equation, left in zip(
            self.parts(estimate), linear, equations, eliminated, strict=True
        ):
            covariances = equation.state_covariances(left, posterior)
            spins = self.spin_likelihoods(block, part, covariances)
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

    def marginal_posterior(
        self, estimate: Estimate, equations: Sequence[NormalEquations], weights: NDArray[np.float64]
    ) -> Gaussian:
        """Return the posterior about an estimate, with errors that all observations share.

        Each observation is fitted with shared errors of its own, which does no harm. But were they
        independent, many observations would average them out: here they are the same in all.

        `weights` (n_observations,) of the observations.
        """
        n = len(self.prior.mean)
        common = [
            each.with_common(block.shared_index, n)
            for each, block in zip(equations, self.blocks, strict=True)
        ]
        shared = max((int(part.parameters.max(initial=n - 1)) for part in common), default=n - 1)
        size = shared + 1
        precision = np.eye(size)
        precision[:n, :n] = self.prior.precision
        centre = np.concatenate([estimate.unit, np.zeros(size - n)])
        information, _ = reduced_equations(
            Gaussian.about(centre, precision),
            centre,
            [part.eliminated() for part in common],
            weights,
        )
        whole = Gaussian.about(centre, information)
        return whole.marginal(np.arange(n))

    def scanned(
        self,
        estimate: Estimate,
        linear: Sequence[Linearisation],
        levels: ArrayLike,
        weights: NDArray[np.float64],
    ) -> tuple[NDArray[np.float64], list[NDArray[np.float64]]]:
        """Try each parameter at each level.

        `levels` (n_levels,) places on the unit interval, or (n, n_levels) of each parameter;
        `weights` (n_observations,) of the observations. Returns `rises` (n, n_levels) change of the
        loss, without a unit, of the prior and of the observations that each parameter influences;
        `fitted` (q, n_levels, W, d) of each block, deviations from the observed initial states, in
        SI units, fitted to the levels.
        """
        each = np.broadcast_to(levels, (estimate.unit.size, np.shape(levels)[-1]))
        candidates = ScanCandidates(estimate.unit, self._groups, self.space, each)
        away = each - estimate.unit[:, None]
        rises = self.prior.scores(estimate.unit)[:, None] * away
        rises += 0.5 * np.diag(self.prior.precision)[:, None] * away**2
        fitted = []
        for (block, part), slopes in zip(self.parts(estimate), linear, strict=True):
            states, residuals = scanned_states(self.cost, block, part, slopes, candidates)
            self.count(block, part.horizons, 2 * len(states))
            parameters = block.parameters.shape[1]
            present = part.estimate[None], slopes.residuals[None]
            here = part.losses(block, *present)
            there = weights[block.members] * (part.losses(block, states, residuals) - here)
            by_level = there.T.reshape(*block.parameters.shape, each.shape[1])
            np.add.at(rises, block.parameters, by_level)
            fitted.append(states.reshape(parameters, each.shape[1], *part.estimate.shape))
        return rises, fitted

    def curvature_posterior(self, estimate: Estimate, weights: NDArray[np.float64]) -> Gaussian:
        """Return the posterior at an estimate, by slopes over wider steps than those of a fit.

        `weights` (n_observations,) of the observations.
        """
        linear = self.linearised(estimate, CURVATURE_WIDENING)
        return self.marginal_posterior(estimate, self.equations(estimate, linear), weights)

    def plausible_moves(
        self, estimate: Estimate, weights: NDArray[np.float64], first: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return how far each parameter can be moved without an implausible rise of the loss.

        Each is moved outwards from the estimate, with initial states fitted to each place, and the
        end is bisected. A rise that its bounds alone bring does not count.

        `weights` (n_observations,) of the observations; `first` (n,) widths, the first move to each
        side; a parameter that can be moved by it to no side, or that its bounds leave no room for
        it, is not looked at further. Returns (n, 2) widths down and up, 0 for parameters that are
        not looked at further.
        """
        linear = self.linearised(estimate, CURVATURE_WIDENING)
        unit = estimate.unit
        room = np.stack([unit, 1.0 - unit], axis=1)
        inner, outer = np.zeros_like(room), np.full_like(room, np.inf)
        moves = np.minimum(first[:, None], room)
        asked = first < room.max(axis=1)
        for _ in range(MOVE_ROUNDS):
            away = moves * (-1.0, 1.0)
            rises, _ = self.scanned(estimate, linear, unit[:, None] + away, weights)
            from_mean = (unit - self.prior.mean)[:, None]
            rises -= UNIFORM_PRECISION * (from_mean * away + 0.5 * away**2)
            plausible = rises < LARGEST_MOVE_RISE
            inner = np.where(plausible, moves, inner)
            outer = np.where(plausible, outer, moves)
            asked &= (inner > 0.0).any(axis=1)
            if not asked.any():
                break
            outwards = np.minimum(MOVE_GROWTH * moves, room)
            moves = np.where(np.isinf(outer), outwards, 0.5 * (inner + outer))
        return np.where(asked[:, None], inner, 0.0)

    def move_simulations(self, estimate: Estimate) -> float:
        """Simulations of single observations that `plausible_moves` takes at most."""
        return self._simulations(estimate, 2 + 4 * MOVE_ROUNDS)

    def curvature_simulations(self, estimate: Estimate) -> float:
        """Simulations of single observations that `curvature_posterior` takes."""
        return self._simulations(estimate, 2)

    def _simulations(self, estimate: Estimate, each: int) -> float:
        """Simulations of a linearisation with `each` of them for each parameter."""
        return sum(
            (1 + 2 * block.initial_states.components.shape[1] + each * block.parameters.shape[1])
            * _whole_simulations(
                block, farthest_horizons(block, part.horizons, self.settings.largest_advance)
            )
            for block, part in self.parts(estimate)
        )


def _whole_simulations(block: ObservationBlock, until: NDArray[np.float64]) -> float:
    """Return how many simulations to the last point take as long as one of each up to a time.

    `until` (W,) s.
    """
    return float((until / block.durations).sum())
