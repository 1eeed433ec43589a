"""Which parameters a joint fit determines, and whether its stated uncertainties are true.

Slopes at an estimate say how well the data hold it there, not whether it settled beside a better
one, as fits to chaotic motion may. What fits from other starts that explain the observations as
well differ by is added (`order_of_fits`). But all fits to the same observations have errors in
common, so half of the observations is fitted as well, from where the best fit began, and
uncertainties are widened by how far it is from the estimate (`half_agreement`).

Nor does a slope say what lies beyond a kink (`profiles`). Within an interval that is one-sided the
half cannot disagree, nor need it be bound by slopes.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.parameter_posterior import LARGEST_DEVIATION, UNIFORM_PRECISION
from intuitive_physics.parameter_space import parameter_vector
from intuitive_physics_learner.joint_estimation.half_agreement import agreed_deviations
from intuitive_physics_learner.joint_estimation.order_of_fits import StagedFit
from intuitive_physics_learner.joint_estimation.profiles import (
    curvature_posterior,
    is_one_sided,
    one_sided_moves,
)
from intuitive_physics_learner.search.identifiability import (
    Identifiability,
    widened_information,
)
from intuitive_physics_learner.search.learning_task import LearningTask
from intuitive_physics_learner.search.one_sided_intervals import UNIFORM
from intuitive_physics_learner.search.parameter_axes import ParameterAxes
from intuitive_physics_learner.search.search_space import ActiveSpace

FEWEST_OBSERVATIONS = 4
"""Observations from which on the fit to half of them is compared: two in each half."""

SLOPE_STEP = 1e-5
"""Width of the differences that find how θ_s changes along an axis of the unit cube."""


def joint_identifiability(
    staged: StagedFit,
    task: LearningTask,
    seconds_left: Callable[[], float] = lambda: np.inf,
) -> Identifiability:
    """State what is identified and how well, after a fit has converged."""
    fit, searched, active = staged.joint, task.searched, task.active
    parameters = searched.to_parameters(fit.unit)
    began = seconds_left()
    posterior = curvature_posterior(fit)
    # That of the half takes no longer than this one.
    reserved = began - seconds_left() if np.isfinite(began) else 0.0
    free, ends = one_sided_moves(fit, posterior.deviations)
    agreed = _agreed(staged, ends, free, task, lambda: seconds_left() < reserved)
    agreed = np.sqrt(agreed**2 + staged.jointly.spread)
    one_sided = is_one_sided(free, agreed)
    agreed = np.minimum(agreed, fit.prior.deviations)
    factors = agreed / posterior.deviations
    slopes = _slopes(searched, fit.unit)
    covariance = slopes @ (posterior.covariance * np.outer(factors, factors)) @ slopes.T
    deviations = np.sqrt(np.diag(covariance))
    axes = ParameterAxes(task.space, parameters)
    responsive = active.copy()
    responsive[active] = fit.responsive
    with np.errstate(divide="ignore", invalid="ignore"):
        informed = deviations / axes.slopes < LARGEST_DEVIATION
    identified = responsive & informed & (axes.slopes > 0.0)
    moves = np.maximum(free, UNIFORM * agreed[:, None])
    intervals = _intervals(searched, fit.unit, moves, one_sided, active)
    intervals[~identified] = np.nan
    # Without the bounds, which the posterior of θ_s has by itself. What a user gave is as certain
    # as he says, whether the half agrees or not.
    likelihood = posterior.precision - fit.prior.precision
    given = fit.prior.precision - UNIFORM_PRECISION * np.eye(factors.size)
    information = np.zeros((identified.size, identified.size))
    information[np.ix_(active, active)] = widened_information(likelihood, factors, agreed) + given
    return Identifiability(
        responsive, identified, np.where(identified, deviations, np.nan), intervals, information
    )


def balanced_half(influence: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Choose half of the observations, with about half of those that depend on each parameter.

    `influence` (n_observations, n) bool, which observation can depend on which parameter. Returns
    (n_members,) indices of observations.
    """
    weights = 1.0 / np.maximum(influence.sum(axis=0), 1)
    surplus = np.zeros(influence.shape[1])
    chosen: list[int] = []
    for observation, row in enumerate(influence):
        taken = (surplus * weights)[row].sum() <= 0.0
        surplus[row] += 1.0 if taken else -1.0
        if taken:
            chosen.append(observation)
    return np.array(chosen, dtype=np.int64)


def _agreed(
    staged: StagedFit,
    deviations: NDArray[np.float64],
    free: NDArray[np.float64],
    task: LearningTask,
    out_of_time: Callable[[], bool],
) -> NDArray[np.float64]:
    """Fit half of the observations, and return the deviations (n,) with which it agrees."""
    if len(task.influence) < FEWEST_OBSERVATIONS:
        return deviations
    members = balanced_half(task.fit_task.influence)
    half = StagedFit(task.fit_task.of(members), staged.jointly.starts[:1])
    while half.steps < staged.steps and not half.settled:
        if half.steps and out_of_time():
            break
        half.step()
    said = curvature_posterior(half.joint)
    families = _families(task.searched.names)
    return agreed_deviations(staged.joint.unit, deviations, said, families, free)


def _families(names: list[str]) -> list[NDArray[np.int64]]:
    """Parameters of one pair belong together, and the densities."""
    of_pair = [name.partition("[")[2] if "," in name else "density" for name in names]
    return [
        np.flatnonzero([pair == family for pair in of_pair]) for family in dict.fromkeys(of_pair)
    ]


def _intervals(
    searched: ActiveSpace,
    unit: NDArray[np.float64],
    moves: NDArray[np.float64],
    one_sided: NDArray[np.bool_],
    active: NDArray[np.bool_],
) -> NDArray[np.float64]:
    """Intervals (|θ_s|, 2) in SI units, NaN for parameters that are not bound to one side only."""
    intervals = np.full((active.size, 2), np.nan)
    for axis in np.flatnonzero(one_sided):
        parameter = np.flatnonzero(active)[axis]
        for side, sign in enumerate((-1.0, 1.0)):
            moved = unit.copy()
            moved[axis] = np.clip(unit[axis] + sign * moves[axis, side], 0.0, 1.0)
            intervals[parameter, side] = _vector(searched, moved)[parameter]
    return intervals


def _slopes(searched: ActiveSpace, unit: NDArray[np.float64]) -> NDArray[np.float64]:
    """Change (|θ_s|, n) of all parameters, in SI units per width, along each searched axis."""
    columns = []
    for axis in range(unit.size):
        up, down = unit.copy(), unit.copy()
        up[axis] = min(unit[axis] + SLOPE_STEP, 1.0)
        down[axis] = max(unit[axis] - SLOPE_STEP, 0.0)
        change = _vector(searched, up) - _vector(searched, down)
        columns.append(change / (up[axis] - down[axis]))
    return np.array(columns).T


def _vector(searched: ActiveSpace, unit: NDArray[np.float64]) -> NDArray[np.float64]:
    return parameter_vector(searched.to_parameters(unit))
