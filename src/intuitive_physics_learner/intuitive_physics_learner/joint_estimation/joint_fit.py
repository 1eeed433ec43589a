"""The estimate of θ_s and first states, and the steps by which it gets better."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics_learner.cost import Cost
from intuitive_physics_learner.joint_estimation import horizons
from intuitive_physics_learner.joint_estimation.coordinate_scan import (
    LEVELS,
    ScanCandidates,
    compatible_moves,
    scanned_states,
)
from intuitive_physics_learner.joint_estimation.damped_steps import (
    PRIOR_PRECISION,
    next_damping,
    prior_losses,
    proposals,
)
from intuitive_physics_learner.joint_estimation.linearisation import (
    Linearisation,
    ParameterSteps,
    linearise,
    residuals_at,
)
from intuitive_physics_learner.joint_estimation.noise import position_noise
from intuitive_physics_learner.joint_estimation.normal_equations import (
    Elimination,
    NormalEquations,
)
from intuitive_physics_learner.joint_estimation.observation_blocks import (
    ObservationBlock,
    observation_blocks,
)
from intuitive_physics_learner.joint_estimation.parameter_groups import separate_groups
from intuitive_physics_learner.joint_estimation.posterior import Posterior
from intuitive_physics_learner.joint_estimation.trajectory_fits import TrajectoryFits
from intuitive_physics_learner.search import SearchSpace

FIRST_DAMPING = 1e-2
SCANS = (2, 5, 9, 14)
"""After how many steps each parameter is tried over its whole range."""

LEAST_SCAN_GAIN = 3.0
"""Loss that such a trial must take off to be followed: so much is hardly chance."""

PLAUSIBLE_RISE = 2.0
"""Loss that two standard deviations cost: half of two squared."""

JUDGED_LEVELS = LEVELS[::2]
"""Of each parameter that are tried to find how far on its range it can go without a loss."""

JUDGED_WIDENING = 3.0
"""By what steps are wider to find slopes that say how sharp an estimate is."""

SMALLEST_RESPONSE = 1e-9
"""m by unit of a parameter; less is rounding."""

SETTLED = 0.02
"""Standard deviations; a step in which no parameter moves further has arrived."""

SETTLED_STEPS = 2
"""Such steps after which the search ends."""


class JointFit:
    """Fits all trajectories, each from a first state of its own, as far as they can be foretold.

    Parameters
    ----------
    cost : simulates the observations
    space : maps the unit cube of the parameters to θ_s
    influence : (n_observations, n) bool, which observation can depend on which parameter
    start : (n,) point of the unit cube to begin from

    Attributes
    ----------
    start : as given
    unit : (n,) the estimate
    steps : that were taken
    simulations : of single observations, so far
    misfits : share of the observations that did not fit in the last step
    responsive : (n,) bool, which parameters any of the fitted points depends on
    """

    def __init__(
        self, cost: Cost, space: SearchSpace, influence: NDArray[np.bool_], start: ArrayLike
    ) -> None:
        self._cost = cost
        self._space = space
        self.start = np.array(start, dtype=np.float64)
        self.unit = self.start.copy()
        self.responsive = np.zeros(self.unit.size, dtype=bool)
        self._influence = influence
        self._groups = separate_groups(influence)
        self._noise = position_noise(cost.observations)
        self._blocks = observation_blocks(cost.observations, influence)
        self._fits = [TrajectoryFits.beginning(block) for block in self._blocks]
        self._deviations = np.full(space.size, PRIOR_PRECISION**-0.5)
        self._damping = FIRST_DAMPING
        self._settled = 0
        self.simulations = 0
        self.misfits = 0.0
        self.steps = 0

    @property
    def settled(self) -> bool:
        """Whether more steps would change nothing."""
        return self._settled >= SETTLED_STEPS

    @property
    def posterior_simulations(self) -> int:
        """Simulations of single observations that `posterior` takes."""
        return sum(
            block.members.size
            * (
                1
                + 2 * block.prior_deviations.shape[1]
                + 2 * (1 + len(JUDGED_LEVELS)) * block.parameters.shape[1]
            )
            for block in self._blocks
        )

    def posterior(self) -> tuple[Posterior, NDArray[np.float64]]:
        """What is believed of the parameters at the estimate, on the unit cube.

        Returns
        -------
        posterior : from slopes to both sides
        deviations : (n,) largest standard deviation of each parameter by slopes to one side, or
            both, and by how far on its range it can go without a loss. Where friction suffices,
            more would change nothing: the data hold it on one side only.
        """
        linear = self._linearised(widening=JUDGED_WIDENING)
        posterior = self._posterior(self._equations(linear))[0]
        deviations = [posterior.deviations]
        for side in range(2):
            sided = [replace(each, slopes=each.one_sided[side]) for each in linear]
            deviations.append(self._posterior(self._equations(sided))[0].deviations)
        rises, _ = self._scanned(linear, JUDGED_LEVELS)
        away = np.abs(np.array(JUDGED_LEVELS) - self.unit[:, None])
        deviations.append(np.where(rises < PLAUSIBLE_RISE, 0.5 * away, 0.0).max(axis=1))
        return posterior, np.max(deviations, axis=0)

    def step(self) -> None:
        """Take a step of Gauss and Newton, damped, in all unknowns."""
        linear = self._linearised()
        if self.steps in SCANS and self._scan(linear):
            linear = self._linearised()
        self.steps += 1
        equations = self._equations(linear)
        self._note_responses(linear)
        ahead = self._foreseen_horizons(linear, equations)
        self._move(equations, ahead)

    def state(self) -> dict[str, Any]:
        """Plain data from which a fit to the same observations continues exactly."""
        return {
            "unit": self.unit.tolist(),
            "deviations": self._deviations.tolist(),
            "damping": self._damping,
            "settled": self._settled,
            "simulations": self.simulations,
            "misfits": self.misfits,
            "steps": self.steps,
            "responsive": self.responsive.tolist(),
            "fits": [part.state() for part in self._fits],
        }

    def load_state(self, state: Mapping[str, Any]) -> None:
        """Continue from what `state` returned."""
        self.unit = np.array(state["unit"])
        self._deviations = np.array(state["deviations"])
        self._damping = state["damping"]
        self._settled = state["settled"]
        self.simulations = state["simulations"]
        self.misfits = state["misfits"]
        self.steps = state["steps"]
        self.responsive = np.array(state["responsive"])
        for part, saved in zip(self._fits, state["fits"], strict=True):
            part.load_state(saved)

    def _linearised(self, widening: float = 1.0) -> list[Linearisation]:
        """Slopes over `widening` times the usual steps."""
        deviations = widening * self._deviations
        steps = ParameterSteps(self.unit, deviations, self._groups, self._space.to_parameters)
        found = []
        for block, part in self._parts():
            until = np.minimum(part.horizons + horizons.LARGEST_ADVANCE, block.durations)
            unknowns = part.estimate.shape[1] + block.parameters.shape[1]
            self.simulations += block.members.size * (1 + 2 * unknowns)
            found.append(
                linearise(
                    self._cost,
                    block,
                    part.estimate,
                    widening * part.deviations,
                    deviations,
                    steps,
                    until,
                )
            )
        return found

    def _note_responses(self, linear: list[Linearisation]) -> None:
        for block, slopes in zip(self._blocks, linear, strict=True):
            d = block.prior_deviations.shape[1]
            moving = (np.abs(slopes.slopes[:, d:]) > SMALLEST_RESPONSE).any(axis=(2, 3))
            self.responsive[block.parameters[moving]] = True

    def _equations(self, linear: list[Linearisation]) -> list[NormalEquations]:
        return [
            NormalEquations.of(block, part.estimate, each, part.horizons, self._noise)
            for (block, part), each in zip(self._parts(), linear, strict=True)
        ]

    def _posterior(self, equations: list[NormalEquations]) -> tuple[Posterior, list[Elimination]]:
        eliminated = [each.eliminated() for each in equations]
        return Posterior.of(eliminated, self._space.size, PRIOR_PRECISION), eliminated

    def _foreseen_horizons(
        self, linear: list[Linearisation], equations: list[NormalEquations]
    ) -> list[NDArray[np.float64]]:
        """Where the horizons of each block may go; takes over what is believed on the way."""
        posterior, eliminated = self._posterior(equations)
        self._deviations = posterior.deviations
        ahead = []
        for (block, part), slopes, own, left in zip(
            self._parts(), linear, equations, eliminated, strict=True
        ):
            part.deviations = posterior.state_deviations(own, left)
            spreads = posterior.spreads(slopes, own, left)
            limits = np.minimum(part.horizons + horizons.LARGEST_ADVANCE, block.durations)
            ahead.append(
                horizons.advanced_horizons(
                    block, slopes, spreads, part.horizons, limits, self._noise
                )
            )
        return ahead

    def _move(self, equations: list[NormalEquations], ahead: list[NDArray[np.float64]]) -> None:
        """Take the best of some damped steps, each first state's own or none, and new horizons."""
        estimates = [part.estimate for _, part in self._parts()]
        units, states = proposals(self.unit, self.start, estimates, equations, self._damping)
        candidates = [self._space.to_parameters(unit) for unit in units]
        # Each θ_s with the first states that go with it, and with those there are.
        index = np.concatenate([np.arange(len(units)), np.arange(1, len(units))])
        losses = prior_losses(units, self.start)
        chosen = []
        for k, (block, part) in enumerate(self._parts()):
            trying = np.concatenate([states[k], np.tile(part.estimate, (len(units) - 1, 1, 1))])
            residuals = residuals_at(
                self._cost, block, trying, candidates, index[:, None], part.horizons
            )
            self.simulations += len(index) * block.members.size
            own = part.losses(block, trying, residuals, self._noise)
            for u in range(len(units)):
                losses[u] += own[index == u].min(axis=0).sum()
            chosen.append((trying, residuals, own))
        best = int(np.argmin(losses))
        moved = np.abs(units[best] - self.unit) / self._deviations
        self.unit = units[best]
        self._damping = next_damping(self._damping, best)
        advanced, misfits = False, 0
        for (block, part), (trying, residuals, own), goal in zip(
            self._parts(), chosen, ahead, strict=True
        ):
            options = np.flatnonzero(index == best)
            pick = options[np.argmin(own[options], axis=0)]
            every = np.arange(block.members.size)
            part.estimate = trying[pick, every]
            moving, failing = part.advance(block, residuals[pick, every], goal, self._noise)
            advanced |= moving
            misfits += failing
        self.misfits = misfits / len(self._cost.observations)
        settled = moved.max() < SETTLED and not advanced
        self._settled = self._settled + 1 if settled else 0

    def _scan(self, linear: list[Linearisation]) -> bool:
        """Move parameters to where on their range they fit better; return whether any moved."""
        rises, found = self._scanned(linear, LEVELS)
        levels = np.argmin(rises, axis=1)
        moves = compatible_moves(-rises.min(axis=1), self._influence, LEAST_SCAN_GAIN)
        for (block, part), estimates in zip(self._parts(), found, strict=True):
            for parameter in moves:
                rows, columns = np.nonzero(block.parameters == parameter)
                part.estimate[rows] = estimates[columns, levels[parameter], rows]
        for parameter in moves:
            self.unit[parameter] = LEVELS[levels[parameter]]
        return bool(moves)

    def _scanned(
        self, linear: list[Linearisation], levels: Sequence[float]
    ) -> tuple[NDArray[np.float64], list[NDArray[np.float64]]]:
        """Try each parameter at each level.

        Returns
        -------
        rises : (n, n_levels) of the loss of the observations that each parameter influences
        found : of each block, first states (q, n_levels, W, d) that suit them
        """
        each = np.tile(levels, (self.unit.size, 1))
        candidates = ScanCandidates(self.unit, self._groups, self._space, each)
        rises = np.zeros(candidates.index.shape)
        found = []
        for (block, part), slopes in zip(self._parts(), linear, strict=True):
            estimates, residuals = scanned_states(
                self._cost, block, part.estimate, slopes, candidates, part.horizons, self._noise
            )
            self.simulations += 2 * len(estimates) * block.members.size
            parameters = block.parameters.shape[1]
            here = part.losses(block, part.estimate[None], slopes.residuals[None], self._noise)
            there = part.losses(block, estimates, residuals, self._noise) - here
            by_level = there.T.reshape(*block.parameters.shape, len(levels))
            np.add.at(rises, block.parameters, by_level)
            found.append(estimates.reshape(parameters, len(levels), *part.estimate.shape))
        return rises, found

    def _parts(self) -> Iterator[tuple[ObservationBlock, TrajectoryFits]]:
        """Yield blocks, with the points that are in sight, and their fits."""
        for block, fit in zip(self._blocks, self._fits, strict=True):
            yield block.shortened(fit.horizons + horizons.LARGEST_ADVANCE), fit
