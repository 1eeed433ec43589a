"""How far a parameter can be moved away from an optimum, either way, with J as good as there.

The slopes of the residuals at an optimum tell too much where the simulation lacks an effect, or
where J has a kink: a ball that does not slip at one dynamic friction slips at no larger one either,
and J stays the same up to the bound. So each parameter is moved outwards until J rises by more than
its observations disagree about, which is the standard error of the mean of their changes.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.materials import StaticParameters
from intuitive_physics_learner.cost.cancellation import batches
from intuitive_physics_learner.cost.cost_function import FAILED_DISTANCE, Cost
from intuitive_physics_learner.search.parameter_axes import ParameterAxes

AS_GOOD = 1.2
"""Standard errors by which J may rise. With one observation that is worse among others that do not
care it rises by exactly one …"""

GAINED = 0.1
"""… and that may tell much, so it may rise by this share of itself at most: a number that is fitted
to an observation whose errors are a handful of independent ones gains as much by chance."""

SMALLEST_RESPONSE = 1e-9
"""m; a change of J below this is rounding."""

UNIFORM = np.sqrt(3.0)
"""Standard deviations that a number reaches which is equally likely all the way to its ends."""

ROUNDS = 5
"""Of moving outwards …"""

GROWTH = 3.0
"""… so many times as far as in the round before."""


def reaches(
    cost: Cost,
    axes: ParameterAxes,
    parameters: StaticParameters,
    influence: NDArray[np.bool_],
    deviations: NDArray[np.float64],
    cancelled: Callable[[], bool] | None,
) -> NDArray[np.float64]:
    """Return how far each parameter can be moved down and up, (|θ_s|, 2) on the axes.

    From √3 standard deviations on; 0 where J is worse there already.

    Parameters
    ----------
    cost : J over the observations
    axes : through the optimum
    parameters : θ_s of the optimum
    influence : (n_observations, |θ_s|) bool
    deviations : (|θ_s|,) on the axes, those that slopes tell; infinite for what is not looked at
    cancelled : looked at between batches

    Raises
    ------
    LearningCancelledError
        When `cancelled` returned True.
    """
    at_optimum = cost.observation_costs([parameters])[0]
    looked = np.flatnonzero(np.isfinite(deviations))
    chosen = np.repeat(looked, 2)
    ways = np.tile([-UNIFORM, UNIFORM], looked.size) * deviations[chosen]
    found = np.zeros((axes.size, 2))
    for _ in range(ROUNDS):
        places = np.clip(axes.origin[chosen] + ways, 0.0, 1.0)
        going = places != axes.origin[chosen]
        chosen, ways, places = chosen[going], ways[going], places[going]
        if chosen.size == 0:
            break
        moves = [axes.dragged(int(axis), z) for axis, z in zip(chosen, places, strict=True)]
        costs = [cost.observation_costs(batch) for batch in batches(moves, cancelled)]
        rises = np.concatenate(costs) - at_optimum
        good = np.array(
            [
                is_as_good(rise[influence[:, k]], at_optimum[influence[:, k]])
                for rise, k in zip(rises, chosen, strict=True)
            ]
        )
        chosen, ways, places = chosen[good], ways[good], places[good]
        found[chosen, (ways > 0.0).astype(int)] = np.abs(places - axes.origin[chosen])
        inside = (places > 0.0) & (places < 1.0)
        chosen, ways = chosen[inside], GROWTH * ways[inside]
    return found


def is_as_good(rises: NDArray[np.float64], costs: NDArray[np.float64]) -> bool:
    """Whether J is as good where the costs of observations, in m, rise so.

    A world that the engine cannot finish is not as good.
    """
    if (rises > 0.5 * FAILED_DISTANCE).any():
        return False
    error = rises.std(ddof=1) / np.sqrt(rises.size) if rises.size > 1 else 0.0
    allowed = min(AS_GOOD * error, GAINED * costs.mean())
    return bool(rises.mean() <= max(SMALLEST_RESPONSE, allowed))
