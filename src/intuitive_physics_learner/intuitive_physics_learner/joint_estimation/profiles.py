"""How well a fit determines each parameter: by its curvature, and by the profile of the loss.

Slopes at an estimate do not say what lies beyond a kink: a parameter that only has to be large
enough, or small enough, is known to one side only, and slopes hold one just where noise imitates
the beginning of a slip. So the profile of the loss along each parameter is followed as far as it
hardly rises. Where that is farther than slopes say, the deviation is that of its ends; where it is
so to one side only, there is an interval.

A profile has a plateau where motion no longer depends on the parameter: no ball slips at a larger
friction either. The slopes at the estimate, where one does, do not lead initial states there.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.parameter_posterior import LARGEST_DEVIATION
from intuitive_physics.parameter_space import parameter_vector
from intuitive_physics_learner.joint_estimation.joint_fit import JointFit
from intuitive_physics_learner.joint_estimation.linearisation import Linearisation
from intuitive_physics_learner.joint_estimation.normal_equations import reduced_equations
from intuitive_physics_learner.joint_estimation.scans import scanned
from intuitive_physics_learner.search.gaussian import Gaussian
from intuitive_physics_learner.search.search_space import SearchSpace

CURVATURE_WIDENING = 3.0
"""Factor on the steps of the finite differences from which the posterior is computed; set by
hand."""

MOVE_ROUNDS = 8
"""Rounds of moving a parameter outwards from the estimate, and of bisecting the end, at most; set
by hand."""

MOVE_GROWTH = 3.0
"""Factor on the distance from one round outwards to the next; set by hand."""

MOVE_TOLERANCE = 0.02
"""Part of a move by which its end may be farther than it was followed; set by hand."""

USUAL_ROUNDS = 2
"""Rounds that are usually made: most often no parameter is bound to one side only."""

LARGEST_MOVE_RISE = 4.5
"""Rise of the loss up to which a move is plausible, that of three standard deviations: a fit may
gain more than that of two by making a ball slip that does not; below the 6 of a parabola at 2 √3
standard deviations."""

UNIFORM = np.sqrt(3.0)
"""Distance from the mean to the ends of a uniform distribution, in its standard deviations."""

ONE_SIDED_DEVIATIONS = 2.0
"""Distance, in those of a uniform distribution with the parameter's standard deviation, beyond
which a plausible move gives a one-sided interval; set by hand."""

LARGEST_PLATEAU_RISE = 0.5
"""Change of the loss between two places up to which motion is taken to be the same at both: noise
of its minimisation; set by hand."""

LARGEST_PLATEAU_SHARE = 0.1
"""The same as a share of how far the loss is above that of the estimate, where initial states have
taken a single step: 25.7 and 27.9 where both fall to 17 below it once all is fitted to them; set by
hand."""

LARGEST_FITTED_RISE = 100.0
"""Rise of the loss after that step up to which fitting all else may make a place plausible; set by
hand."""


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
    bounds = Gaussian.within_bounds(fit.prior.mean)
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
        rises, _ = scanned(
            model, estimate, linear, unit[:, None] + away, fit.weights, going_on, present_too=True
        )
        plausible = rises - bounds.rises(unit, away) < LARGEST_MOVE_RISE
        inner = np.where(going_on[:, None] & plausible, moves, inner)
        outer = np.where(going_on[:, None] & ~plausible, moves, outer)
        asked &= (inner > 0.0).any(axis=1)
        near = np.maximum((1.0 + MOVE_TOLERANCE) * inner, MOVE_TOLERANCE * first[:, None])
        going_on = asked & ~((outer <= near) | (inner >= room)).all(axis=1)
        outwards = np.minimum(MOVE_GROWTH * moves, room)
        moves = np.where(np.isinf(outer), outwards, 0.5 * (inner + outer))
    inner = np.where(asked[:, None], inner, 0.0)
    return np.where(_plausible_plateaus(fit, linear, inner, first), room, inner)


def _plausible_plateaus(
    fit: JointFit,
    linear: Sequence[Linearisation],
    inner: NDArray[np.float64],
    first: NDArray[np.float64],
) -> NDArray[np.bool_]:
    """Sides (n, 2) that end in a plateau with a plausible loss, all else fitted to it there.

    On a plateau motion is the same at the bound as half-way there, which only observations that
    count can show. `inner` (n, 2) widths, the largest moves that were plausible; `first` (n,) as
    `plausible_moves`.
    """
    unit, sides, task = fit.unit, np.array([-1.0, 1.0]), fit.model.task
    room = np.stack([unit, 1.0 - unit], axis=1)
    depended_on = np.asarray(task.influence[task.counted].any(axis=0))
    left = (first[:, None] < room) & (inner < room) & depended_on[:, None]
    asked = np.asarray(left.any(axis=1))
    if not asked.any():
        return left
    away = np.hstack([sides * room, sides * 0.5 * (inner + room)])
    places = unit[:, None] + away
    changes, _ = scanned(
        fit.model, fit.estimate, linear, places, fit.weights, asked, present_too=True
    )
    changes -= fit.prior.rises(unit, away)
    at_bound = changes[:, :2]
    slack = np.maximum(LARGEST_PLATEAU_RISE, LARGEST_PLATEAU_SHARE * at_bound)
    alike = np.abs(at_bound - changes[:, 2:]) < slack
    found = np.argwhere(left & alike & (at_bound < LARGEST_FITTED_RISE))
    rises = np.full(room.shape, np.inf)
    if len(found):
        rises[tuple(found.T)] = fit.rises_at([(int(k), float(places[k, s])) for k, s in found])
    rises -= Gaussian.within_bounds(fit.prior.mean).rises(unit, away[:, :2])
    return np.asarray(rises < LARGEST_MOVE_RISE)


def curvature_simulations(fit: JointFit) -> float:
    """Simulations of single observations that `curvature_posterior` takes."""
    return fit.model.simulations_of(fit.estimate, 2)


def move_simulations(fit: JointFit) -> float:
    """Simulations of single observations that `plausible_moves` usually takes."""
    # Looking for plateaus, at two places to each side, takes as many as two rounds.
    return fit.model.simulations_of(fit.estimate, 2 + 4 * (USUAL_ROUNDS + 2))


def is_one_sided(moves: NDArray[np.float64], deviations: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether parameters (n,) are bound to one side only.

    `moves` (n, 2) widths, how far they can be moved down and up; `deviations` (n,) widths.
    """
    far = moves.max(axis=1) > ONE_SIDED_DEVIATIONS * UNIFORM * deviations
    return np.asarray(far & (deviations < LARGEST_DEVIATION))


def one_sided_moves(
    fit: JointFit, deviations: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Find the parameters that the observations bind to one side only, if identified.

    `deviations` (n,) widths, standard deviation of each parameter by slopes. Returns `free` (n, 2)
    widths, how far they can be moved down and up; 0 for the other parameters; `ends` (n,) widths,
    standard deviation of each, where a move to both sides is plausible that of its ends.
    """
    least = ONE_SIDED_DEVIATIONS * UNIFORM
    identified = deviations < LARGEST_DEVIATION
    moves = plausible_moves(fit, np.where(identified, least * deviations, np.inf))
    ends = np.maximum(deviations, moves.min(axis=1) / UNIFORM)
    return np.where(is_one_sided(moves, ends)[:, None], moves, 0.0), ends


def mean_square_moves(free: NDArray[np.float64], ends: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the mean square (n,) of the distance of each parameter from the estimate, widths².

    As `one_sided_moves` returns them, `free` (n, 2) and `ends` (n,). Where what is between two ends
    is equally likely, a below the upper one and b above the lower one, it is (a² - a b + b²) / 3.
    """
    down, up = np.maximum(free, UNIFORM * ends[:, None]).T
    return np.where(free.any(axis=1), (down**2 - down * up + up**2) / 3.0, ends**2)


def interval_ends(
    unit: NDArray[np.float64],
    free: NDArray[np.float64],
    widths: NDArray[np.float64],
    one_sided: NDArray[np.bool_],
) -> NDArray[np.float64]:
    """Ends (n, 2) on the unit cube of one-sided intervals; NaN for parameters without one.

    `unit` (n,) the estimate; `free` (n, 2) widths, how far it can be moved down and up; `widths`
    (n,) standard deviations; `one_sided` (n,) bool.
    """
    moves = np.maximum(free, UNIFORM * widths[:, None]) * (-1.0, 1.0)
    return np.where(one_sided[:, None], np.clip(unit[:, None] + moves, 0.0, 1.0), np.nan)


def ends_in_si_units(
    space: SearchSpace,
    unit: NDArray[np.float64],
    ends: NDArray[np.float64],
    places: NDArray[np.int64],
) -> NDArray[np.float64]:
    """Return `ends` (n, 2) at `unit` (n,) in SI units; `places` (n,) of each parameter in θ_s."""
    intervals = np.full_like(ends, np.nan)
    for axis, side in np.argwhere(~np.isnan(ends)):
        moved = unit.copy()
        moved[axis] = ends[axis, side]
        intervals[axis, side] = parameter_vector(space.to_parameters(moved))[places[axis]]
    return intervals
