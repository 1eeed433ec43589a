"""Proper scores of sampled predictions: low when they are both sharp and true.

Gneiting, Raftery: Strictly proper scoring rules, prediction, and estimation. JASA 102 (2007).
"""

from __future__ import annotations

from types import ModuleType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.errors import InvalidInputError


def energy_scores(samples: ArrayLike, outcomes: ArrayLike) -> NDArray[np.float64]:
    """Energy score E‖X - y‖ - ½ E‖X - X'‖ in m, the distance when there is only one sample.

    The estimate is the fair one, whose mean does not depend on the number of samples (Ferro 2014).

    Parameters
    ----------
    samples : (n_samples, ..., 3) m, equally likely
    outcomes : (..., 3) m, what happened

    Returns
    -------
    (...)
    """
    x, y = _checked(samples, outcomes)
    if len(x) == 1:
        return np.asarray(np.linalg.norm(x[0] - y, axis=-1))
    answer = _scoringrules().es_ensemble(
        y, np.moveaxis(x, 0, -2), m_axis=-2, v_axis=-1, estimator="fair", backend="numba"
    )
    return np.asarray(answer)


def crps(samples: ArrayLike, outcomes: ArrayLike) -> NDArray[np.float64]:
    """Continuous ranked probability score of each axis in m, estimated fairly.

    Parameters
    ----------
    samples : (n_samples, ..., 3) m
    outcomes : (..., 3) m

    Returns
    -------
    (..., 3) m
    """
    x, y = _checked(samples, outcomes)
    if len(x) == 1:
        return np.abs(x[0] - y)
    answer = _scoringrules().crps_ensemble(
        y, np.moveaxis(x, 0, -1), m_axis=-1, estimator="fair", backend="numba"
    )
    return np.asarray(answer)


def _checked(
    samples: ArrayLike, outcomes: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    x, y = np.asarray(samples, dtype=np.float64), np.asarray(outcomes, dtype=np.float64)
    if x.ndim < 2 or len(x) == 0 or x.shape[1:] != y.shape or y.shape[-1] != 3:
        raise InvalidInputError(
            f"samples have shape {x.shape} and outcomes {y.shape}; expected (n_samples, ..., 3) "
            "and (..., 3)"
        )
    return x, y


def _scoringrules() -> ModuleType:
    # Imported late: it takes seconds, and what only predicts does not need it.
    import scoringrules

    return scoringrules
