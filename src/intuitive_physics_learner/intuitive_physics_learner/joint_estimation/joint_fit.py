"""The estimate of θ_s and initial states, and the steps by which it gets better."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics_learner.cost.cost_function import Cost
from intuitive_physics_learner.joint_estimation.coordinate_scan import LEVELS, compatible_moves
from intuitive_physics_learner.joint_estimation.fit_horizons import (
    LARGEST_ADVANCE,
    advanced_horizons,
)
from intuitive_physics_learner.joint_estimation.linearisation import Linearisation, residuals_at
from intuitive_physics_learner.joint_estimation.normal_equations import (
    NormalEquations,
    Posterior,
    bounded_step,
)
from intuitive_physics_learner.joint_estimation.trajectory_model import (
    TrajectoryModel,
    sharpness,
    sharpness_simulations,
)
from intuitive_physics_learner.search.identifiability import PRIOR_PRECISION
from intuitive_physics_learner.search.search_space import SearchSpace

DAMPINGS = (0.1, 1.0, 10.0, 100.0)
"""Of the last damping: those that are tried at once."""

SMALLEST_DAMPING, LARGEST_DAMPING = 1e-6, 1e4

LARGEST_MOVE = 0.2
"""Of the unit interval, that a parameter moves at most in one step."""


def prior_losses(units: NDArray[np.float64], start: NDArray[np.float64]) -> NDArray[np.float64]:
    """Loss (c,) of points (c, n) of the unit cube for being away from the start (n,)."""
    return 0.5 * PRIOR_PRECISION * np.asarray(((units - start) ** 2).sum(axis=1))


def next_damping(damping: float, chosen: int) -> float:
    """Return the damping of the next step after the proposal of that index was the best."""
    factor = DAMPINGS[chosen - 1] if chosen > 0 else DAMPINGS[-1]
    return float(np.clip(damping * factor, SMALLEST_DAMPING, LARGEST_DAMPING))


def proposals(
    unit: NDArray[np.float64],
    start: NDArray[np.float64],
    estimates: Sequence[NDArray[np.float64]],
    equations: Sequence[NormalEquations],
    damping: float,
) -> tuple[NDArray[np.float64], list[NDArray[np.float64]]]:
    """Propose θ_s and initial states.

    Parameters
    ----------
    unit : (n,) the present θ_s on the unit cube
    start : (n,) where it was believed to be before
    estimates : of each block, (W, d) of the initial states' deviations
    equations : of each block

    Returns
    -------
    units : (c, n) points of the cube, the present one first
    states : of each block, initial states (c, W, d) that go with them
    """
    units = [unit]
    states = [[estimate] for estimate in estimates]
    for factor in DAMPINGS:
        own_damping = float(np.clip(damping * factor, SMALLEST_DAMPING, LARGEST_DAMPING))
        information = PRIOR_PRECISION * np.eye(unit.size)
        scores = PRIOR_PRECISION * (unit - start)
        eliminated = [each.eliminated(own_damping) for each in equations]
        for each in eliminated:
            each.add_to(information, scores)
        step = bounded_step(unit, information, scores, own_damping)
        step = np.clip(step, -LARGEST_MOVE, LARGEST_MOVE)
        units.append(unit + step)
        for own, each in zip(states, eliminated, strict=True):
            own.append(own[0] + each.state_steps(step))
    return np.array(units), [np.array(own) for own in states]


FIRST_DAMPING = 1e-2
SCANS = (2, 5, 9, 14)
"""After how many steps each parameter is tried over its whole range."""

LEAST_SCAN_GAIN = 3.0
"""Loss that such a trial must take off to be followed: so much is hardly chance."""

SMALLEST_RESPONSE = 1e-9
"""m by unit of a parameter; less is rounding."""

SETTLED = 0.02
"""Standard deviations; a step in which no parameter moves further has arrived."""

SETTLED_STEPS = 2
"""Such steps after which the search ends."""


class JointFit:
    """Fits all trajectories, each from an initial state of its own, as far as they can be foretold.

    Parameters
    ----------
    cost : simulates the observations
    space : maps the unit cube of the parameters to θ_s
    influence : (n_observations, n) bool, which observation can depend on which parameter
    start : (n,) point of the unit cube to begin from

    Attributes
    ----------
    start : as given
    steps : that were taken
    misfits : share of the observations that did not fit in the last step
    responsive : (n,) bool, which parameters any of the fitted points depends on
    """

    def __init__(
        self, cost: Cost, space: SearchSpace, influence: NDArray[np.bool_], start: ArrayLike
    ) -> None:
        self._model = TrajectoryModel(cost, space, influence)
        self.start = np.array(start, dtype=np.float64)
        self._estimate = self._model.beginning(self.start.copy())
        self.responsive = np.zeros(self.start.size, dtype=bool)
        self._damping = FIRST_DAMPING
        self._settled = 0
        self.misfits = 0.0
        self.steps = 0

    @property
    def unit(self) -> NDArray[np.float64]:
        """The estimate of θ_s on the unit cube, (n,)."""
        return self._estimate.unit

    @property
    def simulations(self) -> int:
        """Simulations of single observations, so far."""
        return self._model.simulations

    @simulations.setter
    def simulations(self, count: int) -> None:
        self._model.simulations = count

    @property
    def settled(self) -> bool:
        """Whether more steps would change nothing."""
        return self._settled >= SETTLED_STEPS

    @property
    def posterior_simulations(self) -> int:
        """Simulations of single observations that `posterior` takes."""
        return sharpness_simulations(self._model)

    def posterior(self) -> tuple[Posterior, NDArray[np.float64]]:
        """What is believed of the parameters at the estimate, as `sharpness`."""
        return sharpness(self._model, self._estimate)

    def step(self) -> None:
        """Take a step of Gauss and Newton, damped, in all unknowns."""
        linear = self._model.linearised(self._estimate)
        if self.steps in SCANS and self._scan(linear):
            linear = self._model.linearised(self._estimate)
        self.steps += 1
        equations = self._model.equations(self._estimate, linear)
        self._note_responses(linear)
        ahead = self._foreseen_horizons(linear, equations)
        self._move(equations, ahead)

    def state(self) -> dict[str, Any]:
        """Plain data from which a fit to the same observations continues exactly."""
        return {
            "unit": self._estimate.unit.tolist(),
            "deviations": self._estimate.deviations.tolist(),
            "damping": self._damping,
            "settled": self._settled,
            "simulations": self.simulations,
            "misfits": self.misfits,
            "steps": self.steps,
            "responsive": self.responsive.tolist(),
            "fits": [part.state() for part in self._estimate.fits],
        }

    def load_state(self, state: Mapping[str, Any]) -> None:
        """Continue from what `state` returned."""
        self._estimate.unit = np.array(state["unit"])
        self._estimate.deviations = np.array(state["deviations"])
        self._damping = state["damping"]
        self._settled = state["settled"]
        self.simulations = state["simulations"]
        self.misfits = state["misfits"]
        self.steps = state["steps"]
        self.responsive = np.array(state["responsive"])
        for part, saved in zip(self._estimate.fits, state["fits"], strict=True):
            part.load_state(saved)

    def _note_responses(self, linear: Sequence[Linearisation]) -> None:
        for block, slopes in zip(self._model.blocks, linear, strict=True):
            d = block.prior_deviations.shape[1]
            moving = (np.abs(slopes.slopes[:, d:]) > SMALLEST_RESPONSE).any(axis=(2, 3))
            self.responsive[block.parameters[moving]] = True

    def _foreseen_horizons(
        self, linear: Sequence[Linearisation], equations: Sequence[NormalEquations]
    ) -> list[NDArray[np.float64]]:
        """Where the horizons of each block may go; takes over what is believed on the way."""
        posterior, eliminated = self._model.posterior(equations)
        self._estimate.deviations = posterior.deviations
        ahead = []
        for (block, part), slopes, own, left in zip(
            self._model.parts(self._estimate), linear, equations, eliminated, strict=True
        ):
            part.deviations = posterior.state_deviations(own, left)
            spreads = posterior.spreads(slopes, own, left)
            limits = np.minimum(part.horizons + LARGEST_ADVANCE, block.durations)
            ahead.append(
                advanced_horizons(block, slopes, spreads, part.horizons, limits, self._model.noise)
            )
        return ahead

    def _move(self, equations: Sequence[NormalEquations], ahead: list[NDArray[np.float64]]) -> None:
        """Take the best of some damped steps, each initial state its own, and new horizons."""
        estimates = [part.estimate for _, part in self._model.parts(self._estimate)]
        units, states = proposals(self.unit, self.start, estimates, equations, self._damping)
        candidates = [self._model.space.to_parameters(unit) for unit in units]
        # Each θ_s with the initial states that go with it, and with those there are.
        index = np.concatenate([np.arange(len(units)), np.arange(1, len(units))])
        losses = prior_losses(units, self.start)
        chosen = []
        for k, (block, part) in enumerate(self._model.parts(self._estimate)):
            trying = np.concatenate([states[k], np.tile(part.estimate, (len(units) - 1, 1, 1))])
            residuals = residuals_at(
                self._model.cost, block, trying, candidates, index[:, None], part.horizons
            )
            self._model.simulations += len(index) * block.members.size
            own = part.losses(block, trying, residuals, self._model.noise)
            for u in range(len(units)):
                losses[u] += own[index == u].min(axis=0).sum()
            chosen.append((trying, residuals, own))
        best = int(np.argmin(losses))
        moved = np.abs(units[best] - self.unit) / self._estimate.deviations
        self._estimate.unit = units[best]
        self._damping = next_damping(self._damping, best)
        advanced, misfits = False, 0
        for (block, part), (trying, residuals, own), goal in zip(
            self._model.parts(self._estimate), chosen, ahead, strict=True
        ):
            options = np.flatnonzero(index == best)
            pick = options[np.argmin(own[options], axis=0)]
            every = np.arange(block.members.size)
            part.estimate = trying[pick, every]
            moving, failing = part.advance(block, residuals[pick, every], goal, self._model.noise)
            advanced |= moving
            misfits += failing
        self.misfits = misfits / len(self._model.cost.observations)
        settled = moved.max() < SETTLED and not advanced
        self._settled = self._settled + 1 if settled else 0

    def _scan(self, linear: Sequence[Linearisation]) -> bool:
        """Move parameters to where on their range they fit better; return whether any moved."""
        rises, found = self._model.scanned(self._estimate, linear, LEVELS)
        levels = np.argmin(rises, axis=1)
        moves = compatible_moves(-rises.min(axis=1), self._model.influence, LEAST_SCAN_GAIN)
        for (block, part), estimates in zip(self._model.parts(self._estimate), found, strict=True):
            for parameter in moves:
                rows, columns = np.nonzero(block.parameters == parameter)
                part.estimate[rows] = estimates[columns, levels[parameter], rows]
        unit = self._estimate.unit.copy()
        unit[moves] = np.array(LEVELS)[levels[moves]]
        self._estimate.unit = unit
        return bool(moves)
