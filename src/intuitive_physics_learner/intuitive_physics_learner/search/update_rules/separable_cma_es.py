"""CMA-ES with a diagonal covariance, for hundreds of parameters, by the package pycma."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_learner.search.update_rules.cma_es import CmaEs


class SeparableCmaEs(CmaEs):
    """CMA-ES that fits a spread of each parameter and no correlations.

    Of n parameters it has n numbers to learn instead of n² / 2, and learns them n / 3 times as
    fast: Ros and Hansen (2008), *A simple modification in CMA-ES achieving linear time and space
    complexity*. Settings are those of `CmaEs`.
    """

    name = "separable_cma_es"

    def _new_strategy(self, mean: NDArray[np.float64], population: int, **options: Any) -> Any:
        return super()._new_strategy(mean, population, CMA_diagonal=True, **options)
