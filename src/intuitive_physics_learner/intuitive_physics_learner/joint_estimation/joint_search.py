"""The search that estimates θ_s and first states jointly, by Levenberg and Marquardt's method."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.materials import StaticParameters
from intuitive_physics_learner.cost import Cost
from intuitive_physics_learner.joint_estimation import horizons
from intuitive_physics_learner.joint_estimation.coordinate_scan import (
    LEVELS,
    ScanCandidates,
    compatible_moves,
    scanned_states,
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
    bounded_step,
    robust_loss,
)
from intuitive_physics_learner.joint_estimation.observation_blocks import (
    ObservationBlock,
    observation_blocks,
)
from intuitive_physics_learner.joint_estimation.parameter_groups import separate_groups
from intuitive_physics_learner.joint_estimation.posterior import Posterior
from intuitive_physics_learner.search import Search, SearchSpace

PRIOR_PRECISION = 12.0
"""One over the variance of a number known only to lie within the unit interval."""

DAMPINGS = (0.1, 1.0, 10.0, 100.0)
"""Of the last damping: those that are tried at once."""

FIRST_DAMPING = 1e-2
SMALLEST_DAMPING, LARGEST_DAMPING = 1e-6, 1e4

LARGEST_MOVE = 0.2
"""Of the unit interval, that a parameter moves at most in one step."""

FAILED_LENGTH = 1e4
"""Standard deviations of noise that a point counts as which the simulator did not reach."""

SCANS = (2, 4, 6, 9, 12, 16)
"""After how many steps each parameter is tried over its whole range."""

LEAST_SCAN_GAIN = 3.0
"""Loss that such a trial must take off to be followed: so much is hardly chance."""

PLAUSIBLE_RISE = 2.0
"""Loss that two standard deviations cost: half of two squared."""

JUDGED_WIDENING = 3.0
"""By what steps are wider to find slopes that say how sharp an estimate is."""

SMALLEST_RESPONSE = 1e-9
"""m by unit of a parameter; less is rounding."""

SETTLED = 0.02
"""Standard deviations; a step in which no parameter moves further has arrived."""

SETTLED_STEPS = 2
"""Such steps after which the search ends."""

LARGEST_STATE_DEVIATION = 0.3
"""m, m/s, rad, rad/s at most over which a first state is moved to find slopes, to begin with."""


@dataclass(eq=False)
class _Progress:
    """How far the estimate of a block's W observations is.

    Parameters
    ----------
    estimate : (W, d) of the first states' deviations
    deviations : (W, d) standard deviation of each
    horizons : (W,) s up to which each is fitted
    misfits : (W,) for how many steps each has not fitted
    """

    estimate: NDArray[np.float64]
    deviations: NDArray[np.float64]
    horizons: NDArray[np.float64]
    misfits: NDArray[np.int64]


class JointSearch(Search):
    """Fits all trajectories, each from a first state of its own, as far as they can be foretold.

    A step is one of Gauss and Newton, damped, in all unknowns; it takes as many simulations as some
    dozen evaluations of J and is not divided, so it may exceed the limit it is given. Each is
    counted as the evaluations of J it could have been.

    Parameters
    ----------
    cost : J
    space : maps the unit cube of the parameters to θ_s
    influence : (n_observations, n) bool, which observation can depend on which parameter
    start : (n,) point of the unit cube to begin from

    Attributes
    ----------
    start : as given
    unit : (n,) the estimate
    steps : that were taken
    responsive : (n,) bool, which parameters any of the fitted points depends on
    """

    def __init__(
        self, cost: Cost, space: SearchSpace, influence: NDArray[np.bool_], start: ArrayLike
    ) -> None:
        super().__init__()
        self._cost = cost
        self._space = space
        self.start = np.array(start, dtype=np.float64)
        self.unit = self.start.copy()
        self.responsive = np.zeros(self.unit.size, dtype=bool)
        self._influence = influence
        self._groups = separate_groups(influence)
        self._noise = position_noise(cost.observations)
        self._blocks = observation_blocks(cost.observations, influence)
        self._progress = [
            _Progress(
                np.zeros_like(block.prior_deviations),
                np.minimum(block.prior_deviations, LARGEST_STATE_DEVIATION),
                horizons.first_horizons(block),
                np.zeros(block.members.size, dtype=np.int64),
            )
            for block in self._blocks
        ]
        self._deviations = np.full(space.size, PRIOR_PRECISION**-0.5)
        self._damping = FIRST_DAMPING
        self._settled = 0
        self._simulations = 0
        self.steps = 0

    @property
    def best_parameters(self) -> StaticParameters:
        return self._space.to_parameters(self.unit)

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
        rises, _ = self._scanned(linear)
        away = np.abs(np.array(LEVELS) - self.unit[:, None])
        deviations.append(np.where(rises < PLAUSIBLE_RISE, 0.5 * away, 0.0).max(axis=1))
        return posterior, np.max(deviations, axis=0)

    def step(self, limit: int, relative_gain: float = 0.0) -> int:
        if self._settled >= SETTLED_STEPS:
            return 0
        before = self.iterations
        linear = self._linearised()
        if self.steps in SCANS and self._scan(linear):
            linear = self._linearised()
        self.steps += 1
        equations = self._equations(linear)
        self._note_responses(linear)
        ahead = self._foreseen_horizons(linear, equations)
        self._move(equations, ahead)
        self._count(relative_gain)
        return self.iterations - before

    def own_state(self) -> dict[str, Any]:
        return {
            "unit": self.unit.tolist(),
            "deviations": self._deviations.tolist(),
            "damping": self._damping,
            "settled": self._settled,
            "simulations": self._simulations,
            "steps": self.steps,
            "responsive": self.responsive.tolist(),
            "blocks": [
                {name: array.tolist() for name, array in vars(part).items()}
                for part in self._progress
            ],
        }

    def load_own_state(self, state: Mapping[str, Any]) -> None:
        self.unit = np.array(state["unit"])
        self._deviations = np.array(state["deviations"])
        self._damping = state["damping"]
        self._settled = state["settled"]
        self._simulations = state["simulations"]
        self.steps = state["steps"]
        self.responsive = np.array(state["responsive"])
        for part, saved in zip(self._progress, state["blocks"], strict=True):
            for name, values in saved.items():
                own = getattr(part, name)
                setattr(part, name, np.array(values, dtype=own.dtype).reshape(own.shape))

    def _linearised(self, widening: float = 1.0) -> list[Linearisation]:
        """Slopes over `widening` times the usual steps."""
        deviations = widening * self._deviations
        steps = ParameterSteps(self.unit, deviations, self._groups, self._space.to_parameters)
        found = []
        for block, part in self._parts():
            until = np.minimum(part.horizons + horizons.LARGEST_ADVANCE, block.durations)
            unknowns = part.estimate.shape[1] + block.parameters.shape[1]
            self._simulations += block.members.size * (1 + 2 * unknowns)
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
        units, states = self._proposals(equations)
        candidates = [self._space.to_parameters(unit) for unit in units]
        # Each θ_s with the first states that go with it, and with those there are.
        index = np.concatenate([np.arange(len(units)), np.arange(1, len(units))])
        losses = PRIOR_PRECISION * 0.5 * ((units - self.start) ** 2).sum(axis=1)
        chosen = []
        for k, (block, part) in enumerate(self._parts()):
            trying = np.concatenate([states[k], np.tile(part.estimate, (len(units) - 1, 1, 1))])
            residuals = residuals_at(
                self._cost, block, trying, candidates, index[:, None], part.horizons
            )
            self._simulations += len(index) * block.members.size
            own = self._losses(block, part, trying, residuals)
            for u in range(len(units)):
                losses[u] += own[index == u].min(axis=0).sum()
            chosen.append((trying, residuals, own))
        best = int(np.argmin(losses))
        moved = np.abs(units[best] - self.unit) / self._deviations
        self.unit = units[best]
        factor = DAMPINGS[best - 1] if best > 0 else DAMPINGS[-1]
        self._damping = float(np.clip(self._damping * factor, SMALLEST_DAMPING, LARGEST_DAMPING))
        advanced = False
        for (block, part), (trying, residuals, own), goal in zip(
            self._parts(), chosen, ahead, strict=True
        ):
            options = np.flatnonzero(index == best)
            pick = options[np.argmin(own[options], axis=0)]
            every = np.arange(block.members.size)
            part.estimate = trying[pick, every]
            advanced |= self._advance(block, part, residuals[pick, every], goal)
        settled = moved.max() < SETTLED and not advanced
        self._settled = self._settled + 1 if settled else 0

    def _scan(self, linear: list[Linearisation]) -> bool:
        """Move parameters to where on their range they fit better; return whether any moved."""
        rises, found = self._scanned(linear)
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
        self, linear: list[Linearisation]
    ) -> tuple[NDArray[np.float64], list[NDArray[np.float64]]]:
        """Try each parameter at each level.

        Returns
        -------
        rises : (n, n_levels) of the loss of the observations that each parameter influences
        found : of each block, first states (q, n_levels, W, d) that suit them
        """
        candidates = ScanCandidates(self.unit, self._groups, self._space)
        rises = np.zeros(candidates.index.shape)
        found = []
        for (block, part), slopes in zip(self._parts(), linear, strict=True):
            estimates, residuals = scanned_states(
                self._cost, block, part.estimate, slopes, candidates, part.horizons, self._noise
            )
            self._simulations += 2 * len(estimates) * block.members.size
            parameters = block.parameters.shape[1]
            here = self._losses(block, part, part.estimate[None], slopes.residuals[None])
            there = self._losses(block, part, estimates, residuals) - here
            by_level = there.T.reshape(*block.parameters.shape, len(LEVELS))
            np.add.at(rises, block.parameters, by_level)
            found.append(estimates.reshape(parameters, len(LEVELS), *part.estimate.shape))
        return rises, found

    def _proposals(
        self, equations: list[NormalEquations]
    ) -> tuple[NDArray[np.float64], list[NDArray[np.float64]]]:
        """Points of the cube (c, n), the present one first, and first states (c, W, d) of each."""
        units = [self.unit]
        states = [[part.estimate] for _, part in self._parts()]
        for factor in DAMPINGS:
            damping = float(np.clip(self._damping * factor, SMALLEST_DAMPING, LARGEST_DAMPING))
            information = PRIOR_PRECISION * np.eye(self._space.size)
            scores = PRIOR_PRECISION * (self.unit - self.start)
            eliminated = [each.eliminated(damping) for each in equations]
            for each in eliminated:
                each.add_to(information, scores)
            step = bounded_step(self.unit, information, scores, damping)
            step = np.clip(step, -LARGEST_MOVE, LARGEST_MOVE)
            units.append(self.unit + step)
            for (_, part), own, each in zip(self._parts(), states, eliminated, strict=True):
                own.append(part.estimate + each.state_steps(step))
        return np.array(units), [np.array(own) for own in states]

    def _losses(
        self,
        block: ObservationBlock,
        part: _Progress,
        trying: NDArray[np.float64],
        residuals: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """Loss (c, W) of first states (c, W, d) that leave residuals (c, W, P, 3)."""
        lengths = np.linalg.norm(residuals, axis=3) / self._noise
        lengths = np.nan_to_num(lengths, nan=FAILED_LENGTH, posinf=FAILED_LENGTH)
        counted = block.times <= part.horizons[:, None]
        fit = (robust_loss(lengths) * counted).sum(axis=2)
        return fit + 0.5 * ((trying / block.prior_deviations) ** 2).sum(axis=2)

    def _advance(
        self,
        block: ObservationBlock,
        part: _Progress,
        residuals: NDArray[np.float64],
        goal: NDArray[np.float64],
    ) -> bool:
        """Move horizons on where all fits, and back where it has not for too long."""
        starts = horizons.misfit_starts(block, residuals, part.horizons, self._noise)
        misfit = np.isfinite(starts)
        part.misfits = np.where(misfit, part.misfits + 1, 0)
        back = part.misfits >= horizons.PATIENCE
        part.misfits[back] = 0
        before = part.horizons
        part.horizons = np.where(misfit, before, goal)
        retreat = np.maximum(starts - horizons.RETREAT, horizons.first_horizons(block))
        part.horizons = np.where(back, np.minimum(retreat, before), part.horizons)
        return bool((part.horizons != before).any())

    def _count(self, relative_gain: float) -> None:
        """Count what was simulated in evaluations of J, of which the last is one."""
        (cost,) = self._cost.costs([self.best_parameters]).tolist()
        observations = len(self._cost.observations)
        self._simulations += observations
        while self.iterations * observations < self._simulations:
            self._record(cost, relative_gain)

    def _parts(self) -> Iterator[tuple[ObservationBlock, _Progress]]:
        yield from zip(self._blocks, self._progress, strict=True)
