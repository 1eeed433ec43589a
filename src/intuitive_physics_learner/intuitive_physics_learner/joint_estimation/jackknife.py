"""How far an estimate moves without each of the observations that it rests on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.parameter_posterior import UNIFORM_PRECISION
from intuitive_physics_learner.joint_estimation.normal_equations import LocalLikelihood
from intuitive_physics_learner.search.gaussian import Gaussian


def jackknife_variances(
    information: Gaussian,
    centre: NDArray[np.float64],
    likelihoods: Sequence[LocalLikelihood],
    weights: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Variances (n,), widths², of the mean by how it moves without each of some observations.

    With N observations of a parameter, (N - 1) / N Σ (m_without - m)². Where knowledge rests on one
    observation whose linearisation may be wrong, this is the uncertainty without it. 0 for
    parameters that fewer than two of them depend on.

    `centre` (n,) mean where nothing is known; `weights` (n_observations,) with which `information`
    has them.
    """
    prior = information.bounded(centre)
    squares, counts = np.zeros(centre.size), np.zeros(centre.size)
    for likelihood, weight in zip(likelihoods, weights, strict=True):
        parameters = likelihood.parameters
        precision = np.linalg.inv(prior.covariance[np.ix_(parameters, parameters)])
        pulls = precision @ prior.mean[parameters]
        pulls -= weight * (likelihood.information @ likelihood.estimate - likelihood.scores)
        rest = precision - weight * likelihood.information
        values, vectors = np.linalg.eigh(0.5 * (rest + rest.T))
        # The bounds are always known.
        mean = (vectors / np.maximum(values, UNIFORM_PRECISION)) @ (vectors.T @ pulls)
        squares[parameters] += (mean - prior.mean[parameters]) ** 2
        counts[parameters] += 1.0
    return squares * np.maximum(counts - 1.0, 0.0) / np.maximum(counts, 1.0)
