"""Gaussian knowledge of θ_s in information form, to which observations are added.

A Gaussian about the mean m with the precision Y is kept as Y and y = Y m, so that independent
observations add up. One whose negative log likelihood near û is gᵀ (u - û) + ½ (u - û)ᵀ Λ (u - û)
adds Λ to Y and Λ û - g to y. Knowledge of nothing is Y = 0. Parameters are on the unit cube of
`ParameterSpace(materials)`.
"""

from __future__ import annotations

import base64
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.parameter_posterior import ParameterPosterior
from intuitive_physics_learner.joint_estimation.local_likelihood import LocalLikelihood
from intuitive_physics_learner.search.learning_task import UNIFORM_PRECISION, GaussianPrior

FASTEST = 1
"""Level of zlib: matrices are mostly zeros where materials are many, and that is all it finds."""


@dataclass(eq=False)
class Information:
    """Gaussian information about n parameters.

    Parameters
    ----------
    matrix : (n, n) Y, per width²
    vector : (n,) y, per width
    """

    matrix: NDArray[np.float64]
    vector: NDArray[np.float64]

    @staticmethod
    def none(size: int) -> Information:
        """Nothing is known of `size` parameters."""
        return Information(np.zeros((size, size)), np.zeros(size))

    @staticmethod
    def about(mean: NDArray[np.float64], matrix: NDArray[np.float64]) -> Information:
        """Return a Gaussian.

        `mean` (n,) on the unit cube; `matrix` (n, n) its precision, per width².
        """
        return Information(matrix.copy(), matrix @ mean)

    @staticmethod
    def of(posterior: ParameterPosterior, held: NDArray[np.bool_]) -> Information:
        """Return the Gaussian that stands for a posterior, given the values that are held.

        A one-sided interval of length l counts by its middle and the variance l² / 12 of what is
        uniform in it, beside that of its ends: with D diagonal of these, (Y⁻¹ + D)⁻¹ is
        Y - Y D^½ (1 + D^½ Y D^½)⁻¹ D^½ Y, which needs no inverse of Y.

        `held` (n,) which parameters have fixed values, those of the posterior's mean.
        """
        factor = np.where(held, 0.0, posterior.factor)
        matrix = factor.T @ factor
        ends = posterior.intervals
        spread = np.nan_to_num(ends[:, 1] - ends[:, 0]) / np.sqrt(UNIFORM_PRECISION)
        across = matrix * spread
        inner = np.eye(spread.size) + spread[:, None] * across
        narrower = across @ np.linalg.solve(inner, across.T)
        return Information.about(gaussian_mean(posterior), matrix - narrower)

    def copy(self) -> Information:
        """Return an independent copy."""
        return Information(self.matrix.copy(), self.vector.copy())

    def equals(self, other: Information) -> bool:
        """Whether both say the same, to the last digit."""
        return np.array_equal(self.matrix, other.matrix) and np.array_equal(
            self.vector, other.vector
        )

    def add(self, likelihood: LocalLikelihood, weight: float = 1.0) -> None:
        """Add what one observation says, times a weight."""
        parameters = likelihood.parameters
        self.matrix[np.ix_(parameters, parameters)] += weight * likelihood.information
        pulls = likelihood.information @ likelihood.estimate - likelihood.scores
        self.vector[parameters] += weight * pulls

    def discount(self, factor: float) -> None:
        """Keep that part of what is known."""
        self.matrix *= factor
        self.vector *= factor

    def join(self, other: Information, weight: float = 1.0) -> None:
        """Add independent knowledge of the same parameters, times a weight."""
        self.matrix += weight * other.matrix
        self.vector += weight * other.vector

    def part(self, parameters: NDArray[np.int64]) -> Information:
        """Return what is known of some parameters whatever the others are, and nothing of these.

        `parameters` (k,) their indices.
        """
        rest = np.setdiff1d(np.arange(self.vector.size), parameters)
        informed = self.copy()
        informed.forget(rest)
        return informed

    def forget(self, parameters: NDArray[np.int64]) -> None:
        """Let nothing be known of some parameters.

        What is known of the others is their marginal distribution. Directions of the parameters of
        which nothing is known have no information to give, so the inverse leaves them out.

        `parameters` (k,) their indices.
        """
        rest = np.setdiff1d(np.arange(self.vector.size), parameters)
        across = self.matrix[np.ix_(rest, parameters)]
        gains = across @ np.linalg.pinv(self.matrix[np.ix_(parameters, parameters)], hermitian=True)
        vector = self.vector[rest] - gains @ self.vector[parameters]
        matrix = self.matrix[np.ix_(rest, rest)] - gains @ across.T
        self.matrix[:], self.vector[:] = 0.0, 0.0
        self.matrix[np.ix_(rest, rest)] = 0.5 * (matrix + matrix.T)
        self.vector[rest] = vector

    def spread(self, places: NDArray[np.int64], size: int) -> Information:
        """Return the same among more parameters, of which nothing is known.

        `places` (n,) indices of these n parameters among all.
        """
        wider = Information.none(size)
        wider.matrix[np.ix_(places, places)] = self.matrix
        wider.vector[places] = self.vector
        return wider

    def prior(self, centre: NDArray[np.float64]) -> GaussianPrior:
        """Return this with the knowledge that parameters lie within their bounds.

        `centre` (n,) mean where nothing else is known.
        """
        precision = self.matrix + UNIFORM_PRECISION * np.eye(self.vector.size)
        pull = self.vector - self.matrix @ centre
        return GaussianPrior(centre + np.linalg.solve(precision, pull), precision)


def gaussian_mean(posterior: ParameterPosterior) -> NDArray[np.float64]:
    """Mean (n,) of the Gaussian that stands for a posterior: the middle of one-sided intervals."""
    ends = posterior.intervals
    return np.where(np.isnan(ends[:, 0]), posterior.mean, ends.mean(axis=1))


def jackknife_variances(
    information: Information,
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
    prior = information.prior(centre)
    covariance = np.asarray(np.linalg.inv(prior.precision), dtype=np.float64)
    squares, counts = np.zeros(centre.size), np.zeros(centre.size)
    for likelihood, weight in zip(likelihoods, weights, strict=True):
        parameters = likelihood.parameters
        precision = np.linalg.inv(covariance[np.ix_(parameters, parameters)])
        pulls = precision @ prior.mean[parameters]
        pulls -= weight * (likelihood.information @ likelihood.estimate - likelihood.scores)
        rest = precision - weight * likelihood.information
        values, vectors = np.linalg.eigh(0.5 * (rest + rest.T))
        # The bounds are always known.
        mean = (vectors / np.maximum(values, UNIFORM_PRECISION)) @ (vectors.T @ pulls)
        squares[parameters] += (mean - prior.mean[parameters]) ** 2
        counts[parameters] += 1.0
    return squares * np.maximum(counts - 1.0, 0.0) / np.maximum(counts, 1.0)


def encode_array(array: NDArray[np.float64]) -> dict[str, Any]:
    """Return an array as plain data, to its last digit.

    `array` (...,) of any shape.
    """
    packed = zlib.compress(np.ascontiguousarray(array, dtype="<f8").tobytes(), FASTEST)
    return {"shape": list(array.shape), "zlib": base64.b64encode(packed).decode("ascii")}


def decode_array(data: Mapping[str, Any]) -> NDArray[np.float64]:
    """Return the array (...,) that `encode_array` wrote."""
    raw = zlib.decompress(base64.b64decode(data["zlib"]))
    return np.frombuffer(raw, dtype="<f8").reshape(data["shape"]).astype(np.float64)
