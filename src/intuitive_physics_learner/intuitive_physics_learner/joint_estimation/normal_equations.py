"""Normal equations of θ_s and initial states, with the initial states eliminated.

With the whitened residuals r of one observation (each multiplied by L⁻¹, where C = L Lᵀ is the
covariance of the noise of its point), their slopes A = [A_s A_p] along its nuisance parameters s,
mostly its initial states, and its parameters p, weights W against outliers, and the prior precision
P_s of s:

    H = Aᵀ W A + diag(P_s, 0),    g = Aᵀ W r + (P_s s, 0).

Eliminating s (Schur's complement) leaves H_pp - H_ps H_ss⁻¹ H_sp and g_p - H_ps H_ss⁻¹ g_s, which
add up over the observations. The inverse of their sum, with the prior precision of θ_s on its
diagonal, is the covariance of the Gaussian posterior of θ_s.

Parameters are given on the unit cube of the search; their lengths are in widths, parts of the unit
interval.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_learner.joint_estimation.linearisation import Linearisation
from intuitive_physics_learner.joint_estimation.observation_blocks import ObservationBlock

OUTLIER_LENGTH = 3.0
"""Length of a residual from which on Huber's loss grows linearly, σ; set by hand."""

AGREEMENT_FREEDOM = 4.0
"""Degrees of freedom of Student's distribution by which observations that contradict all others
count less; the value that is usual for robust regression (Lange, Little and Taylor 1989)."""


def robust_loss(lengths: NDArray[np.float64], outlier_length: float) -> NDArray[np.float64]:
    """Return Huber's loss (...,), without a unit, of residuals.

    `lengths` (...,) of residuals, in standard deviations of the noise.
    """
    linear = outlier_length * (lengths - 0.5 * outlier_length)
    return np.where(lengths < outlier_length, 0.5 * lengths**2, linear)


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Normal equations of the W observations of a block.

    Each has d components of initial states and q parameters.

    Parameters
    ----------
    parameters : (W, q) indices of each observation's parameters
    state_size : d
    hessian : (W, d + q, d + q) H, in inverse units of the unknowns
    gradient : (W, d + q) g, likewise
    weights : (W,) above 0, with which each observation counts in what it says of the parameters
    """

    parameters: NDArray[np.int64]
    state_size: int
    hessian: NDArray[np.float64]
    gradient: NDArray[np.float64]
    weights: NDArray[np.float64]

    @staticmethod
    def of(
        block: ObservationBlock,
        estimate: NDArray[np.float64],
        linear: Linearisation,
        until: NDArray[np.float64],
        weights: NDArray[np.float64] | None = None,
    ) -> NormalEquations:
        """Set them up with the points up to a time.

        `estimate` (W, d) deviations from the observed initial states, in SI units; `until` (W,) s,
        the last time that counts; `weights` (W,) of the observations; None: 1.
        """
        outlier = OUTLIER_LENGTH
        counted = linear.valid & (block.times <= until[:, None])
        residuals = block.whitened(np.where(counted[..., None], linear.residuals, 0.0))
        lengths = np.linalg.norm(residuals, axis=2)
        rooted = np.sqrt(np.minimum(1.0, outlier / np.maximum(lengths, outlier))) * counted
        count, k = linear.slopes.shape[:2]
        slopes = np.einsum("wpij,wkpj->wkpi", block.whitening, linear.slopes)
        weighted = slopes * rooted[:, None, :, None]
        weighted = weighted.reshape(count, k, 3 * lengths.shape[1])
        # Not by BLAS: on matrices so small its threads wait for one another, the longer the busier
        # the machine is.
        hessian = np.einsum("wip,wjp->wij", weighted, weighted)
        target = (residuals * rooted[..., None]).reshape(count, -1)
        gradient = np.einsum("wip,wp->wi", weighted, target)
        d = estimate.shape[1]
        precision = block.prior_deviations**-2
        diagonal = np.arange(d)
        hessian[:, diagonal, diagonal] += precision
        gradient[:, :d] += precision * estimate
        weights = np.ones(count) if weights is None else weights
        return NormalEquations(block.parameters, d, hessian, gradient, weights)

    def with_common(self, index: NDArray[np.int64], first: int) -> NormalEquations:
        """Return the equations with shared errors as parameters that observations have in common.

        Their prior is left out: it holds once for all observations.

        `index` (W, b) index of each observation's shared errors, the last nuisance parameters.
        """
        count = index.shape[1]
        d = self.state_size - count
        hessian = self.hessian.copy()
        diagonal = np.arange(d, self.state_size)
        hessian[:, diagonal, diagonal] -= 1.0
        parameters = np.hstack([first + index, self.parameters])
        return NormalEquations(parameters, d, hessian, self.gradient, self.weights)

    def eliminated(self, damping: float = 0.0) -> Elimination:
        """Solve for the initial states, their diagonal enlarged by the part `damping`."""
        d = self.state_size
        inner = self.hessian[:, :d, :d].copy()
        diagonal = np.arange(d)
        inner[:, diagonal, diagonal] *= 1.0 + damping
        right = np.concatenate([self.hessian[:, :d, d:], self.gradient[:, :d, None]], axis=2)
        solved = np.linalg.solve(inner, right)
        gains, offsets = solved[..., :-1], solved[..., -1]
        across = self.hessian[:, d:, :d]
        return Elimination(
            self.parameters,
            gains,
            offsets,
            (self.hessian[:, d:, d:] - across @ gains) * self.weights[:, None, None],
            (self.gradient[:, d:] - (across @ offsets[..., None])[..., 0]) * self.weights[:, None],
        )


@dataclass(frozen=True, eq=False)
class Elimination:
    """Initial states as a function of the parameters, and the reduced equations of these.

    Parameters
    ----------
    parameters : (W, q) indices of each observation's parameters
    gains : (W, d, q) H_ss⁻¹ H_sp, SI units per width
    offsets : (W, d) H_ss⁻¹ g_s, in SI units
    information : (W, q, q) H_pp - H_ps H_ss⁻¹ H_sp, per width², times the observation's weight
    scores : (W, q) g_p - H_ps H_ss⁻¹ g_s, per width, likewise
    """

    parameters: NDArray[np.int64]
    gains: NDArray[np.float64]
    offsets: NDArray[np.float64]
    information: NDArray[np.float64]
    scores: NDArray[np.float64]

    def add_to(self, information: NDArray[np.float64], scores: NDArray[np.float64]) -> None:
        """Add the equations of these observations to those of all n parameters.

        `information` (n, n) per width², changed in place; `scores` (n,) per width, changed in
        place.
        """
        rows, columns = self.parameters[:, :, None], self.parameters[:, None, :]
        np.add.at(information, (rows, columns), self.information)
        np.add.at(scores, self.parameters, self.scores)

    def state_steps(self, parameter_steps: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the steps (W, d) of the initial states, in SI units, that go with parameter steps.

        `parameter_steps` (n,) widths, of all parameters.
        """
        steps = parameter_steps[self.parameters][..., None]
        return -self.offsets - (self.gains @ steps)[..., 0]


NEGLIGIBLE = 1e-7
"""Part of the largest eigenvalue of a covariance below which one counts as rounding."""


def agreement_weights(
    eliminations: Sequence[Elimination],
    weights: Sequence[NDArray[np.float64]],
    posterior: Posterior,
    step: NDArray[np.float64],
    freedom: float,
) -> list[NDArray[np.float64]]:
    """Weigh observations by how well each agrees with all others.

    A fit that has taken a wrong turn at some contact holds the parameters with all the information
    of what follows, so that a few such observations can outweigh hundreds. Without observation i
    the parameters would be u + δ, with the covariance C₋ᵢ = (C⁻¹ - w_i Λ_i)⁻¹ (C of all), where
    δ = C₋ᵢ (C⁻¹ Δ + w_i g_i) and Δ is the Newton step of all. There its own score

        g_i + Λ_i δ  has the covariance  V = Λ_i + Λ_i C₋ᵢ Λ_i,

    so its square T by V⁻¹ has the distribution χ² with r = rank V degrees of freedom where all is
    right. The weight is that of Student's distribution with ν degrees of freedom (Lange, Little and
    Taylor 1989), (ν + r) / (ν + T / t), at most 1, where t is the median of T / r, at least 1:
    what all observations disagree about is no fault of one.

    `weights` (W,) of each block, those weights; `step` (n,) widths, Newton step of all. Returns
    (W,) weights of each block.
    """
    squares, ranks = [], []
    for part, weight in zip(eliminations, weights, strict=True):
        rows, columns = part.parameters[:, :, None], part.parameters[:, None, :]
        covariance = posterior.covariance[rows, columns]
        left = np.linalg.inv(np.eye(covariance.shape[1]) - covariance @ part.information)
        without = left @ covariance
        moved = left @ step[part.parameters][..., None] + without @ part.scores[..., None]
        information = part.information / weight[:, None, None]
        scores = part.scores / weight[:, None] + (information @ moved)[..., 0]
        spread = information + information @ without @ information
        values, vectors = np.linalg.eigh(0.5 * (spread + spread.transpose(0, 2, 1)))
        along = np.einsum("wij,wi->wj", vectors, scores)
        counted = values > np.maximum(NEGLIGIBLE * values[:, -1:], np.finfo(float).tiny)
        parts = np.where(counted, along**2 / np.where(counted, values, 1.0), 0.0)
        squares.append(parts.sum(axis=1))
        ranks.append(counted.sum(axis=1))
    ratios = np.concatenate(squares) / np.maximum(np.concatenate(ranks), 1)
    typical = max(float(np.median(ratios)), 1.0)
    return [
        np.minimum((freedom + rank) / (freedom + square / typical), 1.0)
        for square, rank in zip(squares, ranks, strict=True)
    ]


def bounded_step(
    unit: NDArray[np.float64],
    information: NDArray[np.float64],
    scores: NDArray[np.float64],
    damping: float,
) -> NDArray[np.float64]:
    """Damped Newton step (n,), in widths, within the unit cube; what would leave it does not move.

    `unit` (n,) the point of the cube to step from; `information` (n, n) per width²; `scores` (n,)
    per width, the gradient of the loss.
    """
    damped = information + damping * np.diag(np.diag(information))
    free = np.ones(unit.size, dtype=bool)
    step = np.zeros(unit.size)
    while free.any():
        step[:] = 0.0
        step[free] = -np.linalg.solve(damped[np.ix_(free, free)], scores[free])
        leaving = free & (((unit <= 0.0) & (step < 0.0)) | ((unit >= 1.0) & (step > 0.0)))
        if not leaving.any():
            break
        free &= ~leaving
    return np.clip(unit + step, 0.0, 1.0) - unit


@dataclass(frozen=True, eq=False)
class Posterior:
    """Gaussian posterior of n parameters and of the initial states of all observations.

    Parameters
    ----------
    covariance : (n, n) of the parameters, on the unit cube
    """

    covariance: NDArray[np.float64]

    @staticmethod
    def of(eliminations: Sequence[Elimination], prior: NDArray[np.float64]) -> Posterior:
        """Add up the information of all observations and of the prior.

        `prior` (n, n) precision of the n parameters before the observations, per width².
        """
        information = prior.copy()
        for part in eliminations:
            part.add_to(information, np.zeros(len(prior)))
        return Posterior(np.asarray(np.linalg.inv(information), dtype=np.float64))

    @property
    def deviations(self) -> NDArray[np.float64]:
        """Standard deviation (n,) of each parameter, in widths."""
        return np.sqrt(np.diag(self.covariance))

    def state_covariances(
        self, equations: NormalEquations, eliminated: Elimination
    ) -> NDArray[np.float64]:
        """Covariance (W, d, d) of a block's initial states, in SI units, whatever θ_s is."""
        covariance = self._parameter_covariance(eliminated)
        by_parameters = eliminated.gains @ covariance @ eliminated.gains.swapaxes(1, 2)
        return _state_covariance(equations) + by_parameters

    def spreads(
        self, linear: Linearisation, equations: NormalEquations, eliminated: Elimination
    ) -> NDArray[np.float64]:
        """Standard deviation (W, P) in m of the predicted position of each point of a block."""
        count, k, points, _ = linear.slopes.shape
        d = equations.state_size
        slopes = linear.slopes.reshape(count, k, points * 3)
        by_state = slopes[:, :d]
        by_parameter = slopes[:, d:] - eliminated.gains.transpose(0, 2, 1) @ by_state
        variances = ((_state_covariance(equations) @ by_state) * by_state).sum(axis=1)
        covariance = self._parameter_covariance(eliminated)
        variances += ((covariance @ by_parameter) * by_parameter).sum(axis=1)
        return np.sqrt(variances.reshape(count, points, 3).sum(axis=2))

    def _parameter_covariance(self, eliminated: Elimination) -> NDArray[np.float64]:
        rows, columns = eliminated.parameters[:, :, None], eliminated.parameters[:, None, :]
        return self.covariance[rows, columns]


def _state_covariance(equations: NormalEquations) -> NDArray[np.float64]:
    """Covariance (W, d, d) of the initial states, in SI units, given the parameters."""
    d = equations.state_size
    return np.asarray(np.linalg.inv(equations.hessian[:, :d, :d]), dtype=np.float64)
