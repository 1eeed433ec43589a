"""Damped steps from an estimate, tried with several initial states for each θ_s.

The method of Levenberg and Marquardt takes the damping that lowers the loss most. A θ_s is
simulated from the initial states that its step leads to and from the present ones, and late in a
fit from those that another step of the initial states alone leads to (`state_steps`). Of each
observation the best of them counts.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_learner.joint_estimation.linearisation import Linearisation, residuals_at
from intuitive_physics_learner.joint_estimation.normal_equations import (
    NormalEquations,
    bounded_step,
    reduced_equations,
)
from intuitive_physics_learner.joint_estimation.state_steps import StateSteps
from intuitive_physics_learner.joint_estimation.trajectory_model import Estimate, TrajectoryModel

LARGEST_MOVE = 0.2
"""Largest move of a parameter in one step, widths; set by hand."""


@dataclass(frozen=True, eq=False)
class _Tried:
    """What was tried for a block's W observations.

    Parameters
    ----------
    index : (c,) of the θ_s of each trial
    states : (c, W, d) nuisance parameters, as `ObservationBlock`
    residuals : (c, W, P, 3) m
    losses : (c, W)
    """

    index: NDArray[np.int64]
    states: NDArray[np.float64]
    residuals: NDArray[np.float64]
    losses: NDArray[np.float64]

    def joined(self, other: _Tried) -> _Tried:
        """Return these trials and those of another one."""
        return _Tried(
            np.concatenate([self.index, other.index]),
            np.concatenate([self.states, other.states]),
            np.concatenate([self.residuals, other.residuals]),
            np.concatenate([self.losses, other.losses]),
        )


class DampedSteps:
    """Tries steps from one estimate.

    `linear` and `equations` of each block at the estimate; `weights` (n_observations,);
    `restepped`: whether initial states take another step from where a damped one ended.

    Attributes
    ----------
    units : (c, n) points of the unit cube that were tried, first the estimate
    """

    def __init__(
        self,
        model: TrajectoryModel,
        estimate: Estimate,
        linear: Sequence[Linearisation],
        equations: Sequence[NormalEquations],
        weights: NDArray[np.float64],
        *,
        restepped: bool,
    ) -> None:
        self.units = estimate.unit[None]
        self._model, self._weights, self._equations = model, weights, equations
        self._parts = list(model.parts(estimate))
        self._steps: list[StateSteps | None] = [None] * len(self._parts)
        if restepped:
            self._steps = [
                StateSteps.of(*part, slopes, equation)
                for part, slopes, equation in zip(self._parts, linear, equations, strict=True)
            ]
        self._tried = model.of_blocks(lambda k: self._present(k, linear[k]))

    @property
    def losses(self) -> NDArray[np.float64]:
        """Loss (c,) of each θ_s that was tried, with the best of the initial states."""
        losses = self._model.prior.losses(self.units)
        for (block, _), tried in zip(self._parts, self._tried, strict=True):
            weights = self._weights[block.members]
            for k in range(len(losses)):
                losses[k] += (weights * tried.losses[tried.index == k].min(axis=0)).sum()
        return np.asarray(losses)

    def best_states(self, chosen: int) -> Iterator[tuple[NDArray[np.float64], NDArray[np.float64]]]:
        """Yield for each block the best states (W, d) of a θ_s, and their residuals (W, P, 3) m."""
        for tried in self._tried:
            options = np.flatnonzero(tried.index == chosen)
            pick = options[np.argmin(tried.losses[options], axis=0)]
            every = np.arange(pick.size)
            yield tried.states[pick, every], tried.residuals[pick, every]

    def try_steps(self, dampings: NDArray[np.float64]) -> None:
        """Simulate the steps with dampings (c,)."""
        units, states = self._proposed(dampings)
        first, self.units = len(self.units), np.concatenate([self.units, units])
        tried = self._model.of_blocks(lambda k: self._simulated(k, first, states[k]))
        self._tried = [old.joined(new) for old, new in zip(self._tried, tried, strict=True)]

    def _proposed(
        self, dampings: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], list[NDArray[np.float64]]]:
        """Return θ_s (c, n), and the initial states (c, W, d) of each block that go with them."""
        unit = self.units[0]
        units = []
        states: list[list[NDArray[np.float64]]] = [[] for _ in self._parts]
        for damping in dampings.tolist():
            eliminated = [each.eliminated(damping) for each in self._equations]
            reduced = reduced_equations(self._model.prior, unit, eliminated, self._weights)
            step = np.clip(bounded_step(unit, *reduced, damping), -LARGEST_MOVE, LARGEST_MOVE)
            units.append(unit + step)
            for found, (_, part), each in zip(states, self._parts, eliminated, strict=True):
                found.append(part.estimate + each.state_steps(step))
        return np.array(units), [np.array(found) for found in states]

    def _present(self, k: int, linear: Linearisation) -> _Tried:
        """Return what is simulated already of block `k`, and another step of its states."""
        _, part = self._parts[k]
        here = np.zeros(1, dtype=np.int64)
        return self._judged(k, here, part.estimate[None], linear.residuals[None], here)

    def _simulated(self, k: int, first: int, states: NDArray[np.float64]) -> _Tried:
        """Simulate block `k` with each θ_s from `first` on, from `states` (c, W, d) and present."""
        _, part = self._parts[k]
        each = first + np.arange(len(states))
        states = np.concatenate([states, np.tile(part.estimate, (each.size, 1, 1))])
        index = np.concatenate([each, each])
        return self._judged(k, index, states, self._residuals(k, index, states), each)

    def _judged(
        self,
        k: int,
        index: NDArray[np.int64],
        states: NDArray[np.float64],
        residuals: NDArray[np.float64],
        stepped: NDArray[np.int64],
    ) -> _Tried:
        """Return trials of block `k` with their losses, the first of them stepped once more.

        `stepped` (b,) indices of the θ_s of these.
        """
        (block, part), steps = self._parts[k], self._steps[k]
        if steps is not None:
            others = steps.stepped(states[: stepped.size], residuals[: stepped.size])
            index, states = np.concatenate([index, stepped]), np.concatenate([states, others])
            residuals = np.concatenate([residuals, self._residuals(k, stepped, others)])
        return _Tried(index, states, residuals, part.losses(block, states, residuals))

    def _residuals(
        self, k: int, index: NDArray[np.int64], states: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Simulate block `k` with θ_s by `index` (c,) from `states` (c, W, d), to its horizons."""
        block, part = self._parts[k]
        model, until = self._model, part.horizons
        candidates = [model.space.to_parameters(unit) for unit in self.units]
        model.count(block, until, index.size)
        return residuals_at(model.cost, block, states, candidates, index[:, None], until)
