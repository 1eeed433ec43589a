"""Which of what is seen now is which of what was followed: a cheapest assignment with a gate."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


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
