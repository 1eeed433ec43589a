"""Which parameters a joint fit determines, and whether its stated uncertainties are true.

Slopes at an estimate say how well the data hold it there, not whether it settled beside a better
one, as fits to chaotic motion may. What fits from other starts that explain the observations as
well differ by is added (`order_of_fits`). But all fits to the same observations have errors in
common, so half of the observations is fitted as well, from where the best fit began. Were all
slopes right and the other half as informative, the estimate u would be the mean of the estimates a
and b of both halves, which share no observation, and a - u = (a - b) / 2 have the variance
σ_a² / 2, that of u. By how much

    r² = (a - u)² / (σ_a² / 2)

is more than one, uncertainties are widened. Nor can all data be more informative than two such
halves: where the curvature at u alone is high, u is a peculiar place.

Nor does a slope say what lies beyond a kink: a parameter that only has to be large enough, or small
enough, is known to one side only. So the profile of the loss along each parameter is followed as
far as it hardly rises. Where that is farther than slopes say, the deviation is that of its ends;
where it is so to one side only, there is an interval. Within it the half cannot disagree, nor need
it be bound by slopes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.parameter_posterior import LARGEST_DEVIATION, UNIFORM_PRECISION
from intuitive_physics.parameter_space import parameter_vector
from intuitive_physics_learner.joint_estimation.joint_fit import JointFit
from intuitive_physics_learner.joint_estimation.normal_equations import reduced_equations
from intuitive_physics_learner.joint_estimation.order_of_fits import StagedFit
from intuitive_physics_learner.joint_estimation.scans import scanned
from intuitive_physics_learner.search.gaussian import Gaussian
from intuitive_physics_learner.search.identifiability import (
    ONE_SIDED_DEVIATIONS,
    Identifiability,
    widened_information,
)
from intuitive_physics_learner.search.learning_task import LearningTask
from intuitive_physics_learner.search.one_sided_intervals import MOVE_GROWTH, UNIFORM
from intuitive_physics_learner.search.parameter_axes import ParameterAxes
from intuitive_physics_learner.search.search_space import ActiveSpace

CURVATURE_WIDENING = 3.0
"""Factor on the steps of the finite differences from which the posterior is computed; set by
hand."""

MOVE_ROUNDS = 8
"""Rounds of moving a parameter outwards from the estimate, and of bisecting the end, at most; set
by hand."""

MOVE_TOLERANCE = 0.02
"""Part of a move by which its end may be farther than it was followed; set by hand."""

USUAL_ROUNDS = 2
"""Rounds that are usually made: most often no parameter is bound to one side only."""

LARGEST_MOVE_RISE = 4.5
"""Rise of the loss up to which a move is plausible, that of three standard deviations: a fit may
gain more than that of two by making a ball slip that does not; below the 6 of a parabola at 2 √3
standard deviations."""

FEWEST_OBSERVATIONS = 4
"""Observations from which on the fit to half of them is compared: two in each half."""

FAMILY_WEIGHT = 3.0
"""Number of parameters as which the typical disagreement of the half counts against that of a
parameter's own family; set by hand."""

LARGEST_CHANCE_RATIO = 2.0
"""Ratio of the half's distance from the estimate to its expectation beyond which that distance is
itself the uncertainty; set by hand."""


NORMAL_MEDIAN = 0.6745
"""Median of |x| for x of the standard normal distribution."""

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
    least = ONE_SIDED_DEVIATIONS * UNIFORM
    agreed = np.sqrt(agreed**2 + staged.jointly.spread)
    one_sided = (free.max(axis=1) > least * agreed) & (agreed < LARGEST_DEVIATION)
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


def curvature_posterior(fit: JointFit) -> Gaussian:
    """Return the posterior about an estimate, by slopes over wider steps than those of a fit.

    Errors that all observations share are the same in all of them here. Each observation is fitted
    with shared errors of its own, which does no harm; but were they independent, many observations
    would average them out.
    """
    model, estimate = fit.model, fit.estimate
    equations = model.equations(estimate, model.linearised(estimate, CURVATURE_WIDENING))
    n = estimate.unit.size
    common = [
        each.with_common(block.shared_index, n)
        for each, block in zip(equations, model.blocks, strict=True)
    ]
    size = 1 + max((int(part.parameters.max(initial=n - 1)) for part in common), default=n - 1)
    precision = np.eye(size)
    precision[:n, :n] = fit.prior.precision
    centre = np.concatenate([estimate.unit, np.zeros(size - n)])
    information, _ = reduced_equations(
        Gaussian.about(centre, precision),
        centre,
        [part.eliminated() for part in common],
        fit.weights,
    )
    return Gaussian.about(centre, information).marginal(np.arange(n))


def plausible_moves(fit: JointFit, first: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how far each parameter can be moved without an implausible rise of the loss.

    Each is moved outwards from the estimate, with initial states fitted to each place, and the end
    is bisected. A rise that its bounds alone bring does not count.

    `first` (n,) widths, the first move to each side; a parameter that can be moved by it to no
    side, or that its bounds leave no room for it, is not looked at further. Returns (n, 2) widths
    down and up, short of the ends by `MOVE_TOLERANCE` of the move at most, or by that part of the
    first move where an end is as near; 0 for parameters that are not looked at further.
    """
    model, estimate, unit = fit.model, fit.estimate, fit.unit
    linear = model.linearised(estimate, CURVATURE_WIDENING)
    room = np.stack([unit, 1.0 - unit], axis=1)
    inner, outer = np.zeros_like(room), np.full_like(room, np.inf)
    moves = np.minimum(first[:, None], room)
    asked = first < room.max(axis=1)
    going_on = asked.copy()
    for _ in range(MOVE_ROUNDS):
        if not going_on.any():
            break
        away = moves * (-1.0, 1.0)
        rises, _ = scanned(model, estimate, linear, unit[:, None] + away, fit.weights, going_on)
        from_mean = (unit - fit.prior.mean)[:, None]
        rises -= UNIFORM_PRECISION * (from_mean * away + 0.5 * away**2)
        plausible = rises < LARGEST_MOVE_RISE
        inner = np.where(going_on[:, None] & plausible, moves, inner)
        outer = np.where(going_on[:, None] & ~plausible, moves, outer)
        asked &= (inner > 0.0).any(axis=1)
        near = np.maximum((1.0 + MOVE_TOLERANCE) * inner, MOVE_TOLERANCE * first[:, None])
        going_on = asked & ~((outer <= near) | (inner >= room)).all(axis=1)
        outwards = np.minimum(MOVE_GROWTH * moves, room)
        moves = np.where(np.isinf(outer), outwards, 0.5 * (inner + outer))
    return np.where(asked[:, None], inner, 0.0)


def curvature_simulations(fit: JointFit) -> float:
    """Simulations of single observations that `curvature_posterior` takes."""
    return fit.model.simulations_of(fit.estimate, 2)


def move_simulations(fit: JointFit) -> float:
    """Simulations of single observations that `plausible_moves` usually takes."""
    return fit.model.simulations_of(fit.estimate, 2 + 4 * USUAL_ROUNDS)


def one_sided_moves(
    fit: JointFit, deviations: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Find the parameters that the observations bind to one side only.

    `deviations` (n,) widths, standard deviation of each parameter by slopes. Returns `free` (n, 2)
    widths, how far they can be moved down and up; 0 for the other parameters; `ends` (n,) widths,
    standard deviation of each, where a move to both sides is plausible that of its ends.
    """
    least = ONE_SIDED_DEVIATIONS * UNIFORM
    moves = plausible_moves(fit, least * deviations)
    ends = np.maximum(deviations, moves.min(axis=1) / UNIFORM)
    one_sided = (moves.max(axis=1) > least * ends) & (ends < LARGEST_DEVIATION)
    return np.where(one_sided[:, None], moves, 0.0), ends


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


def agreed_deviations(
    unit: NDArray[np.float64],
    deviations: NDArray[np.float64],
    half: Gaussian,
    families: Sequence[NDArray[np.int64]],
    free: NDArray[np.float64] | None = None,
) -> NDArray[np.float64]:
    """Standard deviations (n,), in widths, with which half of the observations agrees.

    `unit` (n,) the estimate from all observations, on the unit cube; `deviations` (n,) widths,
    standard deviation of each parameter by slopes; `half` what half of them says by slopes;
    `families` (n_members,) each, indices of parameters that are likely to err alike, each parameter
    in one; `free` (n, 2) widths, how far parameters that are bound to one side only can be moved
    down and up, 0 for others; None: all are bound to both.
    """
    free = np.zeros((unit.size, 2)) if free is None else free
    apart = np.abs(half.mean - np.clip(half.mean, unit - free[:, 0], unit + free[:, 1]))
    # Half of the observations cannot know more than all do: slopes that say so are peculiar.
    expected = np.maximum(half.deviations, deviations) / np.sqrt(2.0)
    ratios = np.where(half.deviations < LARGEST_DEVIATION, apart / expected, np.nan)
    # Slopes of a half that lies where the loss is flat say nothing of the end.
    least = np.where(free.any(axis=1), 0.0, expected)
    agreed = np.maximum(deviations * _family_factors(ratios, families), least)
    beyond_chance = ratios > LARGEST_CHANCE_RATIO
    return np.where(beyond_chance, np.maximum(agreed, apart), agreed)


def _family_factors(
    ratios: NDArray[np.float64], families: Sequence[NDArray[np.int64]]
) -> NDArray[np.float64]:
    """Factors (n,) of at least one from ratios (n,), NaN where the half is not informative."""
    finite = np.isfinite(ratios)
    factors = np.ones(ratios.size)
    if not finite.any():
        return factors
    typical = max(float(np.median(ratios[finite])) / NORMAL_MEDIAN, 1.0)
    for family in families:
        family_ratios = ratios[family][finite[family]]
        total = np.sum(family_ratios**2) + FAMILY_WEIGHT * typical**2
        factors[family] = max(np.sqrt(total / (family_ratios.size + FAMILY_WEIGHT)), 1.0)
    return factors


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
