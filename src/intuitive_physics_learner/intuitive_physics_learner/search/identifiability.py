"""Which parameters the observations determine, and how well, asked of J at the optimum of a search.

Does J respond to a parameter at all? How large is the curvature at the optimum? How far can the
parameter be moved without a significant rise of J (`one_sided_intervals`)? "What is identified" in
`docs/method/learning.md` has the equations. All three take a handful of simulations for each
parameter of each observation that can depend on it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.materials import StaticParameters
from intuitive_physics.parameter_posterior import LARGEST_DEVIATION, UNIFORM_PRECISION
from intuitive_physics.parameter_space import ParameterSpace
from intuitive_physics_learner.cost.cost_function import FAILED_DISTANCE, Cost
from intuitive_physics_learner.cost.parameter_influence import parameter_influence
from intuitive_physics_learner.cost.point_noise import SMALLEST_NOISE
from intuitive_physics_learner.cost.trials import Trials
from intuitive_physics_learner.cost.wrapped_costs import CachedCost
from intuitive_physics_learner.search.one_sided_intervals import (
    MOVE_ROUNDS,
    SMALLEST_RESPONSE,
    UNIFORM,
    acceptable_moves,
)
from intuitive_physics_learner.search.parameter_axes import ParameterAxes

SCAN_LEVELS = (0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0)
"""Places on its interval at which J is asked whether it responds to a parameter; set by hand."""

JACOBIAN_STEP = 0.01
"""Width of the differences of the residuals to each side: large against the kinks of single
contacts; set by hand."""

RESPONSE_THRESHOLD = 2.0
"""Standard errors of J by which it must rise to respond to a parameter."""

ONE_SIDED_DEVIATIONS = 2.0
"""Distance, in those of a uniform distribution with the parameter's standard deviation, beyond
which an acceptable or plausible move gives a one-sided interval; set by hand."""


@dataclass(frozen=True, eq=False)
class Identifiability:
    """Which parameters the observations determine, in the order of `parameter_names`.

    Parameters
    ----------
    responsive : (|θ_s|,) bool, whether J depends on the parameter at all, within its bounds
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


def widened_information(
    information: NDArray[np.float64], factors: NDArray[np.float64], least: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return information that is less certain, along the same combinations of parameters.

    Each eigenvector's deviation is multiplied by the root mean square of the factors of its
    parameters, weighted as it consists of them: so combinations that are not known at all stay
    unknown, and well known ones, such as a ratio, are not mixed with them. Then what the marginals
    of identified parameters lack to their deviations is added, as an independent error of each.

    `information` (n, n) per width², without that of the bounds; `factors` (n,) on the standard
    deviation of each parameter; `least` (n,) widths, smallest standard deviation of each parameter.
    Returns (n, n) per width².
    """
    values, vectors = np.linalg.eigh(0.5 * (information + information.T))
    squares = (vectors**2).T @ factors**2
    wider = (vectors * (np.maximum(values, 0.0) / squares)) @ vectors.T
    bounds = UNIFORM_PRECISION * np.eye(least.size)
    covariance = np.linalg.inv(wider + bounds)
    lacking = np.where(least < LARGEST_DEVIATION, least**2 - np.diag(covariance), 0.0)
    # Information that is lost by an additional error, without inverting what is almost exact.
    lacking = np.maximum(lacking, 0.0)
    if not lacking.any():
        return wider
    return np.asarray(np.linalg.inv(covariance + np.diag(lacking)) - bounds)


def identification_trials(influence: NDArray[np.bool_]) -> int:
    """Simulations of single observations that `identify` takes at most.

    `influence` (n_observations, |θ_s|) bool, of the parameters that are asked about.
    """
    each = len(SCAN_LEVELS) + 2 + 2 * MOVE_ROUNDS
    return 2 * len(influence) + each * int(influence.sum())


def identify(
    cost: Cost,
    space: ParameterSpace,
    parameters: StaticParameters,
    active: NDArray[np.bool_] | None = None,
) -> Identifiability:
    """Find out which parameters the observations determine, around an optimum.

    Parameters
    ----------
    cost : J over the observations
    space : bounds of the search
    parameters : θ_s that the search found
    active : (|θ_s|,) bool, which parameters to ask about; the others are taken to have no influence
        (`active_parameters`); None asks about all
    """
    axes = ParameterAxes(space, parameters)
    influence = parameter_influence(cost.observations, cost.materials)
    residuals = cost.residuals([parameters])[0]
    noise = _Noise(residuals, cost.point_trajectory)
    asked = np.arange(axes.size) if active is None else np.flatnonzero(active)
    changes = np.zeros((axes.size, len(SCAN_LEVELS)))
    # Most parameters are of few observations, and only these are simulated again.
    saving = CachedCost(cost)
    changes[asked] = _cost_changes(saving, axes, asked, parameters)
    threshold = max(SMALLEST_RESPONSE, RESPONSE_THRESHOLD * noise.cost_standard_error)
    rising = np.flatnonzero(changes.max(axis=1) > threshold)
    deviations = np.full(axes.size, np.inf)
    information = np.zeros((0, 0))
    if rising.size:
        squares = _squares_of_slopes(cost, axes, rising, influence[:, rising])
        information = squares / noise.effective_variance(rising.size)
        covariance = np.linalg.inv(information + UNIFORM_PRECISION * np.eye(rising.size))
        deviations[rising] = np.sqrt(np.diag(covariance))
    moved = acceptable_moves(saving, axes, parameters, influence, deviations)
    deviations = np.maximum(deviations, moved.min(axis=1) / UNIFORM)
    along_axes = np.zeros((axes.size, axes.size))
    along_axes[np.ix_(rising, rising)] = widened_information(
        information, np.ones(rising.size), deviations[rising]
    )
    identified = deviations < LARGEST_DEVIATION
    deviations[~identified] = np.nan
    return Identifiability(
        np.abs(changes).max(axis=1) > SMALLEST_RESPONSE,
        identified,
        deviations * axes.slopes,
        _one_sided_intervals(axes, moved, deviations),
        _on_cube(along_axes, axes, space, parameters),
    )


def _on_cube(
    information: NDArray[np.float64],
    axes: ParameterAxes,
    space: ParameterSpace,
    parameters: StaticParameters,
) -> NDArray[np.float64]:
    """Information on the unit cube (|θ_s|, |θ_s|), of that along axes of one parameter each."""
    slopes = space.slopes(space.to_unit(parameters))
    steps = np.divide(
        slopes, axes.slopes[:, None], out=np.zeros_like(slopes), where=axes.slopes[:, None] > 0.0
    )
    return np.asarray(steps.T @ information @ steps)


def _one_sided_intervals(
    axes: ParameterAxes, moved: NDArray[np.float64], deviations: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Intervals (|θ_s|, 2) in SI units; NaN where no move is far enough."""
    intervals = np.full((axes.size, 2), np.nan)
    for axis in np.flatnonzero(moved.max(axis=1) > ONE_SIDED_DEVIATIONS * UNIFORM * deviations):
        distances = np.maximum(moved[axis], UNIFORM * deviations[axis])
        low, high = np.clip(axes.origin[axis] + distances * (-1.0, 1.0), 0.0, 1.0)
        intervals[axis] = axes.value(int(axis), low), axes.value(int(axis), high)
    return intervals


class _Noise:
    """The noise that the residuals at the optimum, (n_points, 3) m, imply."""

    def __init__(self, residuals: NDArray[np.float64], point_trajectory: NDArray[np.int64]) -> None:
        good = np.isfinite(residuals).all(axis=1)
        starts = np.flatnonzero(np.diff(point_trajectory[good])) + 1
        self._parts = [part for part in np.split(residuals[good], starts) if len(part)]
        self._count = sum(len(part) for part in self._parts)
        self._autocorrelation_time = _autocorrelation_time(self._parts)

    @property
    def cost_standard_error(self) -> float:
        """Standard error of J in m, from how the distances scatter within each trajectory."""
        if not self._parts:
            return np.inf
        lengths = [np.linalg.norm(part, axis=1) for part in self._parts]
        share = [min(1.0, self._autocorrelation_time / len(part)) for part in self._parts]
        variances = [part.var() * s for part, s in zip(lengths, share, strict=True)]
        return float(np.sqrt(np.sum(variances)) / len(self._parts))

    def effective_variance(self, fitted: int) -> float:
        """σ² τ in m², corrected for the number of parameters that were fitted."""
        squares = sum(float(np.square(part).sum()) for part in self._parts)
        independent = 3 * self._count / self._autocorrelation_time
        variance = squares / (3 * self._count) * independent / max(independent - fitted, 1.0)
        return max(variance, SMALLEST_NOISE**2) * self._autocorrelation_time


def _autocorrelation_time(parts: list[NDArray[np.float64]]) -> float:
    """Integrated autocorrelation time τ ≥ 1 in points, pooled over trajectories."""
    power = sum(float(np.square(part).sum()) for part in parts)
    if power == 0.0:
        return 1.0
    time = 1.0
    for lag in range(1, max(len(part) for part in parts)):
        product = sum(float((part[lag:] * part[:-lag]).sum()) for part in parts)
        if product <= 0.0:
            break
        time += 2.0 * product / power
    return time


def _cost_changes(
    cost: Cost, axes: ParameterAxes, chosen: NDArray[np.int64], parameters: StaticParameters
) -> NDArray[np.float64]:
    """Change (n_chosen, n_levels) of J in m at each scan level."""
    at_optimum = cost.distances([parameters])[0]
    lower, upper = axes.lower[chosen, None], axes.upper[chosen, None]
    places = lower + np.array(SCAN_LEVELS) * (upper - lower)
    moves = [axes.moved(axis, z) for axis, row in zip(chosen, places, strict=True) for z in row]
    distances = cost.distances(moves)
    # A world that the engine cannot finish says nothing about identifiability.
    distances = np.where(distances < FAILED_DISTANCE, distances, at_optimum)
    return np.asarray((distances - at_optimum).mean(axis=1).reshape(places.shape))


def _squares_of_slopes(
    cost: Cost, axes: ParameterAxes, chosen: NDArray[np.int64], influence: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """Aᵀ A (n_chosen, n_chosen) in m², A being the slopes of all residuals along the chosen axes.

    `influence` (n_observations, n_chosen) bool.
    """
    below = np.maximum(axes.origin - JACOBIAN_STEP, axes.lower)[chosen]
    above = np.minimum(axes.origin + JACOBIAN_STEP, axes.upper)[chosen]
    width = above - below
    moves = [
        axes.moved(axis, z)
        for places in (below, above)
        for axis, z in zip(chosen, places, strict=True)
    ]
    squares = np.zeros((chosen.size, chosen.size))
    for observation, row in enumerate(influence):
        columns = np.flatnonzero(row & (width > 0.0))
        if columns.size == 0:
            continue
        index = np.concatenate([columns, columns + chosen.size])
        trials = Trials(moves, index, np.full(index.size, observation))
        residuals = cost.trial_residuals(trials).reshape(2, columns.size, -1)
        # Points that are not there, or that the simulator did not reach, carry no information.
        steps = np.nan_to_num(residuals[1] - residuals[0], posinf=0.0, neginf=0.0)
        slopes = steps / width[columns, None]
        squares[np.ix_(columns, columns)] += slopes @ slopes.T
    return squares
