"""How far a parameter can be moved from an optimum, either way, without a significant rise of J.

The slopes of the residuals at an optimum overstate what is known where the simulation lacks an
effect, or where J has a kink: a ball that does not slip at one dynamic friction slips at no larger
one either, and J stays the same up to the bound. So each parameter is moved outwards until J rises
by more than its observations disagree about, which is the standard error of the mean of their
changes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.materials import StaticParameters
from intuitive_physics_learner.cost.cost_function import FAILED_DISTANCE, Cost
from intuitive_physics_learner.search.parameter_axes import ParameterAxes

LARGEST_RISE = 1.2
"""Standard errors by which J may rise where a parameter is still acceptable: with one observation
that gets worse among others that do not respond it rises by exactly one."""

LARGEST_RISE_SHARE = 0.1
"""Part of itself by which J may rise at most there: a number that is fitted to an observation with
a handful of independent errors gains as much by chance."""

MOVE_ROUNDS = 5
"""Rounds of moving a parameter outwards from the optimum; set by hand."""

MOVE_GROWTH = 3.0
"""Factor on the distance from one round outwards to the next; set by hand."""

SMALLEST_RESPONSE = 1e-9
"""m; a change of J below this is rounding."""

UNIFORM = np.sqrt(3.0)
"""Distance from the mean to the ends of a uniform distribution, in its standard deviations."""


def acceptable_moves(
    cost: Cost,
    axes: ParameterAxes,
    parameters: StaticParameters,
    influence: NDArray[np.bool_],
    deviations: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return how far each parameter can be moved down and up, (|θ_s|, 2) in widths of its axis.

    From √3 standard deviations on; 0 where J rises too much there already.

    `influence` (n_observations, |θ_s|) bool, which observation can depend on which parameter;
    `deviations` (|θ_s|,) widths, by slopes; infinite for parameters that are not asked about.
    """
    at_optimum = cost.observation_costs([parameters])[0]
    asked = np.flatnonzero(np.isfinite(deviations))
    chosen = np.repeat(asked, 2)
    moves = np.tile([-UNIFORM, UNIFORM], asked.size) * deviations[chosen]
    limits = np.zeros((axes.size, 2))
    for _ in range(MOVE_ROUNDS):
        places = np.clip(axes.origin[chosen] + moves, 0.0, 1.0)
        going = places != axes.origin[chosen]
        chosen, moves, places = chosen[going], moves[going], places[going]
        if chosen.size == 0:
            break
        moved = [axes.dragged(int(axis), z) for axis, z in zip(chosen, places, strict=True)]
        rises = cost.observation_costs(moved) - at_optimum
        accepted = np.array(
            [
                is_acceptable(rise[influence[:, k]], at_optimum[influence[:, k]])
                for rise, k in zip(rises, chosen, strict=True)
            ]
        )
        chosen, moves, places = chosen[accepted], moves[accepted], places[accepted]
        limits[chosen, (moves > 0.0).astype(int)] = np.abs(places - axes.origin[chosen])
        inside = (places > 0.0) & (places < 1.0)
        chosen, moves = chosen[inside], MOVE_GROWTH * moves[inside]
    return limits


def is_acceptable(rises: NDArray[np.float64], costs: NDArray[np.float64]) -> bool:
    """Whether a rise of J is no larger than its observations disagree about.

    A world that the engine cannot finish is not acceptable.

    `rises` (n_observations,) m, by which the cost of each observation rises; `costs`
    (n_observations,) m, of each at the optimum.
    """
    if (rises > 0.5 * FAILED_DISTANCE).any():
        return False
    error = rises.std(ddof=1) / np.sqrt(rises.size) if rises.size > 1 else 0.0
    allowed = min(LARGEST_RISE * error, LARGEST_RISE_SHARE * costs.mean())
    return bool(rises.mean() <= max(SMALLEST_RESPONSE, allowed))
