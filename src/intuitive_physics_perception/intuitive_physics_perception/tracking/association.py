"""Which of what is seen now is which of what was followed: a cheapest assignment with a gate."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

COLOR_DEVIATION = 0.1
"""Of the mean colour of one thing from frame to frame, as light and shade change, 0 to 1."""

MOST_FOR_COLOR = 25.0
"""A shadow must not cost more than to be five deviations off in position."""


def cheapest_pairs(costs: NDArray[np.float64]) -> list[tuple[int, int]]:
    """Return pairs (row, column): as many as can be, and of these the cheapest together.

    Parameters
    ----------
    costs : (n, m), not negative; inf where a pair is impossible
    """
    from scipy.optimize import linear_sum_assignment

    possible = np.isfinite(costs)
    if not possible.any():
        return []
    # One impossible pair costs more than all possible ones, so none is chosen without need.
    dear = 1.0 + 2.0 * min(costs.shape) * float(costs[possible].max())
    rows, columns = linear_sum_assignment(np.where(possible, costs, dear))
    return [(int(r), int(c)) for r, c in zip(rows, columns, strict=True) if possible[r, c]]


def color_cost(first: NDArray[np.float64] | None, second: NDArray[np.float64] | None) -> float:
    """Return the squared distance of two colours (3,) in variances, at most `MOST_FOR_COLOR`.

    0 where one is not told: then position alone decides.
    """
    if first is None or second is None:
        return 0.0
    distance2 = float(np.sum(np.square((first - second) / COLOR_DEVIATION)))
    return min(distance2, MOST_FOR_COLOR)
