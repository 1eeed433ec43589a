"""Differences of a path in which smooth motion vanishes and the noise of the points is left.

At any m + 1 times t_k the weights

    w_k ∝ 1 / ∏_{j≠k} (t_k - t_j),    Σ w_k² = 1

(those of the m-th divided difference) annul polynomials of degree below m, so Σ w_k x_k of points
with equal and independent noise has the variance of that noise. Third differences annul free flight
and uniform motion.
"""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray


def difference_weights(times: NDArray[np.float64], order: int) -> NDArray[np.float64]:
    """Return the weights (n - order, order + 1) of each difference of the order.

    `times` (n,) s, increasing; none where there are at most `order` of them.
    """
    if times.size <= order:
        return np.empty((0, order + 1))
    windows = sliding_window_view(times, order + 1)
    gaps = windows[:, :, None] - windows[:, None, :]
    # In units of the window's length, so that products neither overflow nor vanish
    gaps = gaps / (windows[:, -1] - windows[:, 0])[:, None, None]
    weights = 1.0 / np.where(np.eye(order + 1, dtype=bool), 1.0, gaps).prod(axis=2)
    return np.asarray(weights / np.linalg.norm(weights, axis=1, keepdims=True))


def path_differences(
    positions: NDArray[np.float64], weights: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the differences (n - order, 3) in m of positions (n, 3) in m.

    `weights` (n - order, order + 1) as of `difference_weights`.
    """
    if not len(weights):
        return np.empty((0, positions.shape[1]))
    windows = sliding_window_view(positions, weights.shape[1], axis=0)
    return np.asarray(np.einsum("nk,nik->ni", weights, windows))
