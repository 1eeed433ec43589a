"""Steps of Levenberg and Marquardt in θ_s and all initial states, at several dampings at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_learner.joint_estimation.normal_equations import (
    NormalEquations,
    bounded_step,
)
from intuitive_physics_learner.search.identifiability import PRIOR_PRECISION

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
