"""What the observations tell of each parameter, by the joint estimate of θ_s and initial states."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.parameter_space import ParameterSpace, parameter_vector
from intuitive_physics_learner.cost.cost_function import Cost
from intuitive_physics_learner.joint_estimation.agreement import Half, agreed_deviations
from intuitive_physics_learner.joint_estimation.halves import PartialCost, halves
from intuitive_physics_learner.joint_estimation.joint_fit import JointFit
from intuitive_physics_learner.search.active_parameters import ActiveSpace
from intuitive_physics_learner.search.identifiability import LARGEST_DEVIATION, Identifiability
from intuitive_physics_learner.search.parameter_axes import ParameterAxes

FEWEST_OBSERVATIONS = 4
"""To part into halves."""

SLOPE_STEP = 1e-5
"""Of the unit interval, to find how θ_s changes along an axis of the cube."""


def judge(
    fit: JointFit,
    cost: Cost,
    space: ParameterSpace,
    searched: ActiveSpace,
    influence: NDArray[np.bool_],
    seconds_left: Callable[[], float] = lambda: np.inf,
) -> Identifiability:
    """State what is identified and how well, after a fit has settled.

    Parameters
    ----------
    fit : over the space `searched`
    space : of all parameters
    influence : (n_observations, |θ_s|) bool
    seconds_left : looked at before each step of the fits to halves of the observations; stopped
        early, they agree less and the uncertainties get wider
    """
    active = np.asarray(influence.any(axis=0))
    parameters = searched.to_parameters(fit.unit)
    began = seconds_left()
    posterior, sided = fit.posterior()
    # Those of both halves take about as long as this one.
    reserved = began - seconds_left() if np.isfinite(began) else 0.0
    covariance = posterior.covariance
    slopes = _slopes(searched, fit.unit)
    agreed = _agreed(
        fit, sided, cost, searched, influence[:, active], lambda: seconds_left() < reserved
    )
    factors = agreed / posterior.deviations
    covariance = slopes @ (covariance * np.outer(factors, factors)) @ slopes.T
    deviations = np.sqrt(np.diag(covariance))
    axes = ParameterAxes(space, parameters)
    responsive = active.copy()
    responsive[active] = fit.responsive
    with np.errstate(divide="ignore", invalid="ignore"):
        sharp = deviations / axes.slopes < LARGEST_DEVIATION
    identified = responsive & sharp & (axes.slopes > 0.0)
    return Identifiability(
        responsive,
        identified,
        np.where(identified, deviations, np.nan),
        np.full((identified.size, 2), np.nan),
    )


def _slopes(searched: ActiveSpace, unit: NDArray[np.float64]) -> NDArray[np.float64]:
    """Change (|θ_s|, n) of all parameters in SI units along each axis that was searched."""
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


def _agreed(
    fit: JointFit,
    deviations: NDArray[np.float64],
    cost: Cost,
    searched: ActiveSpace,
    influence: NDArray[np.bool_],
    out_of_time: Callable[[], bool],
) -> NDArray[np.float64]:
    """Fit halves of the observations, and return the deviations (n,) with which they agree."""
    if len(influence) < FEWEST_OBSERVATIONS:
        return deviations
    fits = [
        JointFit(PartialCost(cost, members), searched, influence[members], fit.start)
        for members in halves(influence)
    ]
    # Side by side, so that neither is ahead where time runs out.
    for _ in range(fit.steps):
        for part in fits:
            if not part.settled and not (part.steps and out_of_time()):
                part.step()
    first, second = (Half(part.unit, part.posterior()[1]) for part in fits)
    return agreed_deviations(fit.unit, deviations, (first, second), _families(searched.names))


def _families(names: list[str]) -> list[NDArray[np.int64]]:
    """Parameters of one pair belong together, and the densities."""
    of_pair = [name.partition("[")[2] if "," in name else "density" for name in names]
    return [np.flatnonzero([own == family for own in of_pair]) for family in dict.fromkeys(of_pair)]
