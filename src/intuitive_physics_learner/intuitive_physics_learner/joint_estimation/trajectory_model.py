"""What simulations near an estimate of θ_s and initial states tell."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.observation import Observation
from intuitive_physics_learner.cost.cost_function import Cost
from intuitive_physics_learner.joint_estimation.coordinate_scan import (
    LEVELS,
    ScanCandidates,
    scanned_states,
)
from intuitive_physics_learner.joint_estimation.fit_horizons import LARGEST_ADVANCE, TrajectoryFits
from intuitive_physics_learner.joint_estimation.linearisation import (
    Linearisation,
    ParameterSteps,
    linearise,
    separate_groups,
)
from intuitive_physics_learner.joint_estimation.normal_equations import (
    Elimination,
    NormalEquations,
    Posterior,
)
from intuitive_physics_learner.joint_estimation.observation_blocks import (
    ObservationBlock,
    observation_blocks,
)
from intuitive_physics_learner.search.identifiability import PRIOR_PRECISION
from intuitive_physics_learner.search.search_space import SearchSpace

SMALLEST_NOISE = 1e-4
"""m; no camera measures better, and what is divided by it stays well conditioned."""

NORMAL_MEDIAN = 0.6745
"""Median of |x| for x of the standard normal distribution."""


def position_noise(observations: Sequence[Observation]) -> float:
    """Standard deviation in m of a point on each axis.

    Third differences of free flight and of uniform motion vanish at equal time steps, so those of
    what was seen are noise, with twenty times its variance; a median passes over contacts. Steps
    that are not equal leave in some of the motion: then this is too large rather than too small.
    """
    differences = [
        np.diff(seen.trajectory.positions, 3, axis=0).ravel()
        for observation in observations
        for seen in observation.objects
    ]
    pooled = np.abs(np.concatenate(differences))
    if pooled.size == 0:
        return SMALLEST_NOISE
    return max(float(np.median(pooled)) / NORMAL_MEDIAN / np.sqrt(20.0), SMALLEST_NOISE)


@dataclass(eq=False)
class Estimate:
    """θ_s and initial states, and how sharply they are known.

    Parameters
    ----------
    unit : (n,) θ_s on the unit cube
    deviations : (n,) standard deviation of each parameter there
    fits : initial states, and how far each trajectory is fitted, of each block
    """

    unit: NDArray[np.float64]
    deviations: NDArray[np.float64]
    fits: list[TrajectoryFits]


class TrajectoryModel:
    """Simulates observations near an estimate.

    Parameters
    ----------
    cost : simulates the observations
    space : maps the unit cube of the parameters to θ_s
    influence : (n_observations, n) bool, which observation can depend on which parameter

    Attributes
    ----------
    noise : m, standard deviation of an observed position on each axis
    simulations : of single observations, so far
    """

    def __init__(self, cost: Cost, space: SearchSpace, influence: NDArray[np.bool_]) -> None:
        self.cost = cost
        self.space = space
        self.influence = influence
        self.noise = position_noise(cost.observations)
        self.simulations = 0
        self.blocks = observation_blocks(cost.observations, influence)
        self._groups = separate_groups(influence)

    def beginning(self, unit: NDArray[np.float64]) -> Estimate:
        """Return what is believed before any step."""
        deviations = np.full(unit.size, PRIOR_PRECISION**-0.5)
        return Estimate(unit, deviations, [TrajectoryFits.beginning(b) for b in self.blocks])

    def parts(self, estimate: Estimate) -> Iterator[tuple[ObservationBlock, TrajectoryFits]]:
        """Yield blocks, with the points that are in sight, and their fits."""
        for block, fit in zip(self.blocks, estimate.fits, strict=True):
            yield block.shortened(fit.horizons + LARGEST_ADVANCE), fit

    def linearised(self, estimate: Estimate, widening: float = 1.0) -> list[Linearisation]:
        """Slopes over `widening` times the usual steps."""
        deviations = widening * estimate.deviations
        steps = ParameterSteps(estimate.unit, deviations, self._groups, self.space.to_parameters)
        found = []
        for block, part in self.parts(estimate):
            until = np.minimum(part.horizons + LARGEST_ADVANCE, block.durations)
            unknowns = part.estimate.shape[1] + block.parameters.shape[1]
            self.simulations += block.members.size * (1 + 2 * unknowns)
            found.append(
                linearise(
                    self.cost,
                    block,
                    part.estimate,
                    widening * part.deviations,
                    deviations,
                    steps,
                    until,
                )
            )
        return found

    def equations(
        self, estimate: Estimate, linear: Sequence[Linearisation]
    ) -> list[NormalEquations]:
        """Set up the equations of each block with the points that are fitted."""
        return [
            NormalEquations.of(block, part.estimate, each, part.horizons, self.noise)
            for (block, part), each in zip(self.parts(estimate), linear, strict=True)
        ]

    def posterior(
        self, equations: Sequence[NormalEquations]
    ) -> tuple[Posterior, list[Elimination]]:
        """What is believed of the parameters, and how initial states go with them."""
        eliminated = [each.eliminated() for each in equations]
        return Posterior.of(eliminated, self.space.size, PRIOR_PRECISION), eliminated

    def scanned(
        self, estimate: Estimate, linear: Sequence[Linearisation], levels: Sequence[float]
    ) -> tuple[NDArray[np.float64], list[NDArray[np.float64]]]:
        """Try each parameter at each level.

        Returns
        -------
        rises : (n, n_levels) of the loss of the observations that each parameter influences
        found : of each block, initial states (q, n_levels, W, d) that suit them
        """
        each = np.tile(levels, (estimate.unit.size, 1))
        candidates = ScanCandidates(estimate.unit, self._groups, self.space, each)
        rises = np.zeros(candidates.index.shape)
        found = []
        for (block, part), slopes in zip(self.parts(estimate), linear, strict=True):
            states, residuals = scanned_states(
                self.cost, block, part.estimate, slopes, candidates, part.horizons, self.noise
            )
            self.simulations += 2 * len(states) * block.members.size
            parameters = block.parameters.shape[1]
            here = part.losses(block, part.estimate[None], slopes.residuals[None], self.noise)
            there = part.losses(block, states, residuals, self.noise) - here
            by_level = there.T.reshape(*block.parameters.shape, len(levels))
            np.add.at(rises, block.parameters, by_level)
            found.append(states.reshape(parameters, len(levels), *part.estimate.shape))
        return rises, found


PLAUSIBLE_RISE = 2.0
"""Loss that two standard deviations cost: half of two squared."""

SCANNED_LEVELS = LEVELS[::2]
"""Of each parameter that are tried to find how far on its range it can go without a loss."""

WIDENING = 3.0
"""By what steps are wider than those of the fit, to find slopes that say how sharp it is."""


def sharpness(model: TrajectoryModel, estimate: Estimate) -> tuple[Posterior, NDArray[np.float64]]:
    """What is believed of the parameters at the estimate, on the unit cube.

    Returns
    -------
    posterior : from slopes to both sides
    deviations : (n,) largest standard deviation of each parameter by slopes to one side, or
        both, and by how far on its range it can go without a loss. Where friction suffices,
        more would change nothing: the data hold it on one side only.
    """
    linear = model.linearised(estimate, WIDENING)
    posterior = model.posterior(model.equations(estimate, linear))[0]
    deviations = [posterior.deviations]
    for side in range(2):
        sided = [replace(each, slopes=each.one_sided[side]) for each in linear]
        deviations.append(model.posterior(model.equations(estimate, sided))[0].deviations)
    rises, _ = model.scanned(estimate, linear, SCANNED_LEVELS)
    away = np.abs(np.array(SCANNED_LEVELS) - estimate.unit[:, None])
    deviations.append(np.where(rises < PLAUSIBLE_RISE, 0.5 * away, 0.0).max(axis=1))
    return posterior, np.max(deviations, axis=0)


def sharpness_simulations(model: TrajectoryModel) -> int:
    """Simulations of single observations that `sharpness` takes."""
    return sum(
        block.members.size
        * (
            1
            + 2 * block.prior_deviations.shape[1]
            + 2 * (1 + len(SCANNED_LEVELS)) * block.parameters.shape[1]
        )
        for block in model.blocks
    )
