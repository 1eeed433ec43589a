"""Which parameters the observations determine, and whether stated uncertainties are true.

To what slopes at an estimate say is added by what fits from other starts differ that explain the
observations as well (`several_starts`). But all fits to the same observations have errors in
common, so where motions are not explained to their ends, half of the observations is fitted as
well, from where the best fit began (`agreed_deviations`). What lies beyond a kink is found by the
profile of the loss (`profiles`); within an interval that is one-sided the half cannot disagree, nor
need it be bound by slopes.

A search that lowers J takes initial states as they were seen, and ends elsewhere than a fit, the
farther the worse these are and the more of the motion the simulation lacks. So after one a fit
begins where it ended, and how far that goes is added: where the posterior has the mean m and the
variance σ², the mean square of the distance from a point u is σ² + (m - u)². Where the simulation
lacks an effect, observations disagree by more than their noise, so that σ is at least that of the
jackknife (`jackknife_variances`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.materials import StaticParameters
from intuitive_physics.parameter_posterior import LARGEST_DEVIATION, UNIFORM_PRECISION
from intuitive_physics.parameter_space import parameter_vector
from intuitive_physics_learner.cost.wrapped_costs import CachedCost
from intuitive_physics_learner.joint_estimation.joint_fit import JointEstimationSettings, JointFit
from intuitive_physics_learner.joint_estimation.profiles import (
    curvature_posterior,
    curvature_simulations,
    ends_in_si_units,
    interval_ends,
    is_one_sided,
    move_simulations,
    one_sided_moves,
)
from intuitive_physics_learner.joint_estimation.widened_uncertainty import (
    agreed_deviations,
    information_about,
    jackknife_variances,
    off_the_middle,
    widened_information,
)
from intuitive_physics_learner.joint_search.staged_fit import StagedFit
from intuitive_physics_learner.search.gaussian import Gaussian
from intuitive_physics_learner.search.learning_task import LearningTask
from intuitive_physics_learner.search.search_space import ActiveSpace

FEWEST_OBSERVATIONS = 4
"""Observations from which on the fit to half of them is compared: two in each half."""

SLOPE_STEP = 1e-5
"""Width of the differences that find how θ_s changes along an axis of the unit cube."""

MOST_STEPS = 20
"""Steps at most of the fit after a search that lowers J; set by hand."""

FAR_AT_ONCE = JointEstimationSettings(largest_advance=1.0, scan_steps=())
"""Those of that fit. It begins at a θ_s that explains much, and the search has tried others: on 48
sets of eight throws uncertainties were as true as with advances of 0.2 s, in two thirds of the
time."""

SMALLEST_CHANGE = 1e-9
"""m; a change of J below this is rounding."""


@dataclass(frozen=True, eq=False)
class Identifiability:
    """Which parameters the observations determine, in the order of `parameter_names`.

    Parameters
    ----------
    responsive : (|θ_s|,) bool, which parameters the motions depend on at all
    identified : (|θ_s|,) bool
    standard_deviations : (|θ_s|,) in each parameter's SI unit, NaN where not identified
    intervals : (|θ_s|, 2) one-sided intervals in each parameter's SI unit, NaN where there is none,
        as `LearnedParameters.intervals`
    information : (|θ_s|, |θ_s|) of the observations and of priors that the user gave, on the unit
        cube of all parameters, per width²
    """

    responsive: NDArray[np.bool_]
    identified: NDArray[np.bool_]
    standard_deviations: NDArray[np.float64]
    intervals: NDArray[np.float64]
    information: NDArray[np.float64]


def identifiability_by_fit(
    staged: StagedFit, task: LearningTask, seconds_left: Callable[[], float] = lambda: np.inf
) -> Identifiability:
    """State what is identified and how well, after a fit has converged."""
    fit = staged.joint
    began = seconds_left()
    posterior = curvature_posterior(fit)
    # That of the half takes no longer than this one.
    reserved = began - seconds_left() if np.isfinite(began) else 0.0
    free, ends = one_sided_moves(fit, posterior.deviations)
    agreed = _agreed(staged, ends, free, task, lambda: seconds_left() < reserved)
    agreed = np.sqrt(agreed**2 + staged.jointly.spread)
    return _stated(task, fit, fit.unit, posterior, free, agreed)


def identifiability_of_optimum(
    task: LearningTask,
    parameters: StaticParameters,
    seconds_left: Callable[[], float] = lambda: np.inf,
) -> Identifiability:
    """State what is identified and how well, at a θ_s that was found by lowering J.

    The fit begins there, with nothing known but the bounds, and ends early where the time is needed
    for what comes after it.
    """
    unit = task.searched.to_unit(parameters)
    fit = JointFit(replace(task, knowledge=Gaussian.within_bounds(unit)).fit_task, FAR_AT_ONCE)
    began = seconds_left()
    while fit.steps < MOST_STEPS and not fit.settled:
        fit.step()
        left = seconds_left()
        later = 2.0 * curvature_simulations(fit) + move_simulations(fit)
        if left < (began - left) * later / fit.model.simulations:
            break
    posterior = curvature_posterior(fit)
    free, ends = one_sided_moves(fit, posterior.deviations)
    likelihoods = fit.likelihoods()
    observed = Gaussian.nothing(unit.size).plus(likelihoods, fit.weights)
    left_out = jackknife_variances(observed, fit.prior.mean, likelihoods, fit.weights)
    deviations = np.sqrt(np.maximum(ends**2, left_out))
    stated = _stated(task, fit, unit, posterior, free, deviations)
    responsive = stated.responsive.copy()
    responsive[task.active] |= _changes_cost(task, unit)
    return replace(stated, responsive=responsive)


def _stated(
    task: LearningTask,
    fit: JointFit,
    unit: NDArray[np.float64],
    posterior: Gaussian,
    free: NDArray[np.float64],
    deviations: NDArray[np.float64],
) -> Identifiability:
    """State what is known at a point of the unit cube, `unit` (n,), by what is known about a fit.

    `free` (n, 2) widths, how far parameters that are bound to one side can be moved from it;
    `deviations` (n,) widths, standard deviation of each about it.
    """
    searched, active = task.searched, task.active
    apart = unit - fit.unit
    beyond = apart - np.clip(apart, -free[:, 0], free[:, 1])
    moves = free + apart[:, None] * (1.0, -1.0)
    away = np.hypot(deviations, beyond)
    one_sided = is_one_sided(moves, away)
    deviations = np.minimum(deviations, fit.prior.deviations)
    factors = deviations / posterior.deviations
    covariance = posterior.covariance * np.outer(factors, factors)
    off = off_the_middle(covariance, fit.prior.mean)
    covariance += np.outer(off, off) + np.outer(beyond, beyond)
    slopes = _slopes(searched, unit)
    in_si_units = np.sqrt(np.diag(slopes @ covariance @ slopes.T))
    responsive = active.copy()
    responsive[active] = fit.responsive
    own_slopes = task.space.own_slopes(_vector(searched, unit))
    identified = responsive & (in_si_units < LARGEST_DEVIATION * own_slopes)
    widths = np.minimum(away, fit.prior.deviations)
    ends = interval_ends(unit, moves, widths, one_sided & identified[active])
    intervals = np.full((active.size, 2), np.nan)
    intervals[active] = ends_in_si_units(searched, unit, ends, np.flatnonzero(active))
    # Without the bounds, which the posterior of θ_s has by itself. What a user gave is as certain
    # as he says, whatever else is widened.
    bounds = UNIFORM_PRECISION * np.eye(unit.size)
    likelihood = posterior.precision - fit.prior.precision
    wider = widened_information(likelihood, factors, deviations)
    information = np.zeros((identified.size, identified.size))
    information[np.ix_(active, active)] = information_about(
        wider + fit.prior.precision - bounds, beyond
    )
    return Identifiability(
        responsive, identified, np.where(identified, in_si_units, np.nan), intervals, information
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
    """Fit half of the observations, and return the deviations (n,) with which it agrees.

    Those of parameters that are not doubted stay. Of observations that are known beforehand the
    half knows as much.
    """
    counted, doubted = np.flatnonzero(staged.task.counted), staged.doubted
    if counted.size < FEWEST_OBSERVATIONS or not doubted.any():
        return deviations
    members = counted[balanced_half(staged.task.influence[counted])]
    half = StagedFit(staged.task.of(members), staged.jointly.starts[:1])
    while half.steps < staged.steps - staged.segment_steps and not half.settled:
        if half.steps and out_of_time():
            break
        half.step()
    said = curvature_posterior(half.joint)
    families = _families(task.searched.names)
    agreed = agreed_deviations(staged.joint.unit, deviations, said, families, free)
    return np.where(doubted, agreed, deviations)


def _changes_cost(task: LearningTask, unit: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether J is another one where a parameter of `unit` alone is back at its start, (n,)."""
    points = np.tile(unit, (unit.size + 1, 1))
    np.fill_diagonal(points, task.begin)
    # Most parameters are of few observations, and only these are simulated again.
    costs = CachedCost(task.cost).costs([task.searched.to_parameters(p) for p in points])
    return np.abs(costs[:-1] - costs[-1]) > SMALLEST_CHANGE


def _families(names: list[str]) -> list[NDArray[np.int64]]:
    """Parameters of one pair belong together, and the densities."""
    of_pair = [name.partition("[")[2] if "," in name else "density" for name in names]
    return [
        np.flatnonzero([pair == family for pair in of_pair]) for family in dict.fromkeys(of_pair)
    ]


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
