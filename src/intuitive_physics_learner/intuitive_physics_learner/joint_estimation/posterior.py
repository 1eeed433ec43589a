"""What is believed of θ_s and initial states near an estimate, and of what they foretell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_learner.joint_estimation.linearisation import Linearisation
from intuitive_physics_learner.joint_estimation.normal_equations import (
    Elimination,
    NormalEquations,
)


@dataclass(frozen=True, eq=False)
class Posterior:
    """Normal distribution of n parameters and of the initial states of all observations.

    Parameters
    ----------
    covariance : (n, n) of the parameters, on the unit cube
    """

    covariance: NDArray[np.float64]

    @staticmethod
    def of(eliminations: Sequence[Elimination], size: int, prior_precision: float) -> Posterior:
        """Put together what all observations tell."""
        information = prior_precision * np.eye(size)
        for part in eliminations:
            part.add_to(information, np.zeros(size))
        return Posterior(np.asarray(np.linalg.inv(information), dtype=np.float64))

    @property
    def deviations(self) -> NDArray[np.float64]:
        """Standard deviation (n,) of each parameter on the unit cube."""
        return np.sqrt(np.diag(self.covariance))

    def state_deviations(
        self, equations: NormalEquations, eliminated: Elimination
    ) -> NDArray[np.float64]:
        """Standard deviation (W, d) of each component of the initial states of a block."""
        own = self._own_covariance(eliminated)
        variances = np.einsum("wdd->wd", _state_covariance(equations)).copy()
        variances += ((eliminated.gains @ own) * eliminated.gains).sum(axis=2)
        return np.sqrt(variances)

    def spreads(
        self, linear: Linearisation, equations: NormalEquations, eliminated: Elimination
    ) -> NDArray[np.float64]:
        """Standard deviation (W, P) in m of where the estimate foretells each point of a block."""
        count, k, points, _ = linear.slopes.shape
        d = equations.state_size
        slopes = linear.slopes.reshape(count, k, points * 3)
        by_state = slopes[:, :d]
        by_parameter = slopes[:, d:] - eliminated.gains.transpose(0, 2, 1) @ by_state
        variances = ((_state_covariance(equations) @ by_state) * by_state).sum(axis=1)
        own = self._own_covariance(eliminated)
        variances += ((own @ by_parameter) * by_parameter).sum(axis=1)
        return np.sqrt(variances.reshape(count, points, 3).sum(axis=2))

    def _own_covariance(self, eliminated: Elimination) -> NDArray[np.float64]:
        rows, columns = eliminated.parameters[:, :, None], eliminated.parameters[:, None, :]
        return self.covariance[rows, columns]


def _state_covariance(equations: NormalEquations) -> NDArray[np.float64]:
    """Covariance (W, d, d) of the initial states, the parameters given."""
    d = equations.state_size
    return np.asarray(np.linalg.inv(equations.hessian[:, :d, :d]), dtype=np.float64)
