"""Gaussian knowledge of parameters, to which observations and bounds are added.

With the mean m and the precision Y = P⁻¹ (P: covariance), the negative logarithm of the density is
½ (u - m)ᵀ Y (u - m) but for a constant. It is kept in information form, as Y and the pull y = Y m:
so independent knowledge adds up, and knowing nothing is Y = 0. An observation whose negative log
likelihood near û is gᵀ (u - û) + ½ (u - û)ᵀ Λ_i (u - û) adds Λ_i to Y and Λ_i û - g to y.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.parameter_posterior import UNIFORM_PRECISION, ParameterPosterior
from intuitive_physics.prior_knowledge.spin_evidence import SpinLikelihood


@dataclass(frozen=True, eq=False)
class LocalLikelihood:
    """Likelihood of one observation near an estimate û of its q parameters, by itself.

    With its initial states integrated out by Laplace's approximation, its negative logarithm is

        l(u) = l(û) + gᵀ (u - û) + ½ (u - û)ᵀ Λ (u - û),

    where l(û) is the loss at the estimate plus ½ ln det(P_s^-½ H_ss P_s^-½), by which the data
    narrow its initial states. The weight with which a fit counts it is left out.

    Parameters
    ----------
    parameters : (q,) indices among all parameters
    estimate : (q,) û, on the unit cube
    information : (q, q) Λ, per width²
    scores : (q,) g, per width
    loss : l(û), without a unit
    spins : what the observation says of each initial spin that was a guess, θ_s and all else
        integrated out
    """

    parameters: NDArray[np.int64]
    estimate: NDArray[np.float64]
    information: NDArray[np.float64]
    scores: NDArray[np.float64]
    loss: float
    spins: tuple[SpinLikelihood, ...] = ()


@dataclass(frozen=True, eq=False)
class Gaussian:
    """Gaussian knowledge of n parameters on the unit cube of their search.

    Parameters
    ----------
    precision : (n, n) Y, per width²; singular where nothing is known
    pull : (n,) y, per width
    stated_mean : (n,) m where it was given, which Y⁻¹ y is but for rounding; None: it was not
    """

    precision: NDArray[np.float64]
    pull: NDArray[np.float64]
    stated_mean: NDArray[np.float64] | None = None

    @staticmethod
    def nothing(size: int) -> Gaussian:
        """Nothing is known of `size` parameters."""
        return Gaussian(np.zeros((size, size)), np.zeros(size))

    @staticmethod
    def about(mean: NDArray[np.float64], precision: NDArray[np.float64]) -> Gaussian:
        """Return a Gaussian by its mean (n,) and its precision (n, n), per width²."""
        return Gaussian(precision, precision @ mean, mean)

    @staticmethod
    def within_bounds(mean: NDArray[np.float64]) -> Gaussian:
        """Only the bounds are known; `mean` (n,) is where a search begins."""
        return Gaussian.about(mean.copy(), UNIFORM_PRECISION * np.eye(mean.size))

    @staticmethod
    def of(
        posterior: ParameterPosterior,
        held: NDArray[np.bool_] | None = None,
        *,
        bounded: bool = False,
    ) -> Gaussian:
        """Return the Gaussian that stands for a posterior.

        A one-sided interval of length l counts by its middle and the variance l² / 12 of what is
        uniform in it, beside that of its ends.

        `held` (n,) which parameters have fixed values, those of the posterior's mean: what is known
        of the others is that given these; None: none has. `bounded`: whether the bounds count too.
        """
        factor = posterior.factor if held is None else np.where(held, 0.0, posterior.factor)
        ends = posterior.intervals
        mean = np.where(np.isnan(ends[:, 0]), posterior.mean, ends.mean(axis=1))
        known = Gaussian.about(mean, factor.T @ factor)
        if bounded:
            known = known.bounded(mean)
        lengths = np.nan_to_num(ends[:, 1] - ends[:, 0])
        return known.widened(lengths / np.sqrt(UNIFORM_PRECISION))

    @cached_property
    def mean(self) -> NDArray[np.float64]:
        """m (n,), which may lie outside the cube; if none was given, Y must have an inverse."""
        if self.stated_mean is not None:
            return self.stated_mean
        return np.asarray(np.linalg.solve(self.precision, self.pull))

    @cached_property
    def covariance(self) -> NDArray[np.float64]:
        """P (n, n), in widths²."""
        return np.asarray(np.linalg.inv(self.precision), dtype=np.float64)

    @property
    def deviations(self) -> NDArray[np.float64]:
        """Standard deviation (n,) of each parameter, in widths."""
        return np.sqrt(np.diag(self.covariance))

    def losses(self, units: NDArray[np.float64]) -> NDArray[np.float64]:
        """Negative logarithm (c,) of the density at `units` (c, n), but for a constant."""
        off = units - self.mean
        return 0.5 * np.einsum("ci,ij,cj->c", off, self.precision, off)

    def scores(self, unit: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the gradient (n,) of the loss at `unit` (n,), per width."""
        if self.stated_mean is not None:
            return self.precision @ (unit - self.stated_mean)
        return self.precision @ unit - self.pull

    def rises(self, unit: NDArray[np.float64], away: NDArray[np.float64]) -> NDArray[np.float64]:
        """Rises (n, k) of the loss where single parameters move, all others staying.

        `unit` (n,) point of the unit cube; `away` (n, k) widths, k moves of each parameter.
        """
        rises = self.scores(unit)[:, None] * away
        rises += 0.5 * np.diag(self.precision)[:, None] * away**2
        return rises

    def plus(
        self, likelihoods: Sequence[LocalLikelihood], weights: Iterable[float] | None = None
    ) -> Gaussian:
        """Add what observations say, each times its weight, in the order of `likelihoods`; None: 1.

        A negative weight takes away again what was added.
        """
        precision, pull = self.precision.copy(), self.pull.copy()
        weights = np.ones(len(likelihoods)) if weights is None else weights
        for likelihood, weight in zip(likelihoods, weights, strict=True):
            parameters = likelihood.parameters
            precision[np.ix_(parameters, parameters)] += weight * likelihood.information
            pulls = likelihood.information @ likelihood.estimate - likelihood.scores
            pull[parameters] += weight * pulls
        return Gaussian(precision, pull)

    def joined(self, other: Gaussian, weight: float = 1.0) -> Gaussian:
        """Add independent knowledge of the same parameters, times a weight."""
        return Gaussian(self.precision + weight * other.precision, self.pull + weight * other.pull)

    def bounded(self, centre: NDArray[np.float64]) -> Gaussian:
        """Add that parameters lie within bounds; `centre` (n,) mean where nothing is known."""
        precision = self.precision + UNIFORM_PRECISION * np.eye(centre.size)
        pull = self.pull - self.precision @ centre
        return Gaussian.about(centre + np.linalg.solve(precision, pull), precision)

    def widened(self, deviations: NDArray[np.float64]) -> Gaussian:
        """Add independent errors to the parameters, of standard deviations (n,), in widths.

        With D diagonal of their squares, (Y⁻¹ + D)⁻¹ is Y - Y D^½ (1 + D^½ Y D^½)⁻¹ D^½ Y, which
        needs no inverse of Y. The mean must have been given.
        """
        across = self.precision * deviations
        inner = np.eye(deviations.size) + deviations[:, None] * across
        return Gaussian.about(self.mean, self.precision - across @ np.linalg.solve(inner, across.T))

    def held_at(self, parameter: int, place: float, precision: float) -> Gaussian:
        """Add that one parameter is at a place, with a precision, per width²."""
        total, pull = self.precision.copy(), self.pull.copy()
        total[parameter, parameter] += precision
        pull[parameter] += precision * place
        return Gaussian(total, pull)

    def scaled(self, factor: float) -> Gaussian:
        """Keep that part of what is known."""
        return Gaussian(factor * self.precision, factor * self.pull)

    def marginal(self, chosen: NDArray[np.int64]) -> Gaussian:
        """Return what is known of some parameters alone, `chosen` (k,) by their indices."""
        covariance = self.covariance[np.ix_(chosen, chosen)]
        return Gaussian.about(self.mean[chosen], np.asarray(np.linalg.inv(covariance)))

    def without(self, parameters: NDArray[np.int64]) -> Gaussian:
        """Let nothing be known of some parameters, `parameters` (k,) by their indices.

        What is known of the others is their marginal distribution. Directions of the parameters of
        which nothing is known have no information to give, so the inverse leaves them out.
        """
        rest = np.setdiff1d(np.arange(self.pull.size), parameters)
        across = self.precision[np.ix_(rest, parameters)]
        inner = self.precision[np.ix_(parameters, parameters)]
        gains = across @ np.linalg.pinv(inner, hermitian=True)
        matrix = self.precision[np.ix_(rest, rest)] - gains @ across.T
        left = Gaussian(0.5 * (matrix + matrix.T), self.pull[rest] - gains @ self.pull[parameters])
        return left.among(rest, self.pull.size)

    def part(self, parameters: NDArray[np.int64]) -> Gaussian:
        """Return what is known of `parameters` (k,) whatever others are, and nothing of these."""
        return self.without(np.setdiff1d(np.arange(self.pull.size), parameters))

    def among(self, places: NDArray[np.int64], size: int) -> Gaussian:
        """Return the same among `size` parameters, at `places` (n,); of others nothing is known."""
        wider = Gaussian.nothing(size)
        wider.precision[np.ix_(places, places)] = self.precision
        wider.pull[places] = self.pull
        return wider

    def equals(self, other: Gaussian) -> bool:
        """Whether both say the same, to the last digit."""
        return np.array_equal(self.precision, other.precision) and np.array_equal(
            self.pull, other.pull
        )
