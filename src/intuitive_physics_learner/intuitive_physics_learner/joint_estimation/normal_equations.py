"""Normal equations of θ_s and initial states, with the initial states eliminated.

With the whitened residuals r of one observation (each multiplied by L⁻¹, where C = L Lᵀ is the
covariance of the noise of its point), their slopes A = [A_s A_p] along its nuisance parameters s,
mostly its initial states, and its parameters p, weights W against outliers, and the prior precision
P_s of s:

    H = Aᵀ W A + diag(P_s, 0),    g = Aᵀ W r + (P_s s, 0).

Eliminating s (Schur's complement) leaves Λ = H_pp - H_ps H_ss⁻¹ H_sp and g_p - H_ps H_ss⁻¹ g_s,
which add up over the observations, each by its weight w. The inverse of their sum, with the prior
precision of θ_s, is the covariance of the Gaussian posterior of θ_s. The weight of an observation
multiplies all that it says of θ_s, its prior of s included; s itself is fitted as if it were alone.

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
from intuitive_physics_learner.search.gaussian import Gaussian

OUTLIER_LENGTH = 3.0
"""Length of a residual from which on Huber's loss grows linearly, σ; set by hand."""

AGREEMENT_FREEDOM = 4.0
"""Degrees of freedom of Student's distribution by which observations that contradict all others
count less; the value that is usual for robust regression (Lange, Little and Taylor 1989)."""

SINGLE_THREAD_PRODUCTS = 200_000
"""Products of a matrix product for which OpenBLAS takes a single thread: it takes more from
262,144 on."""

NEGLIGIBLE = 1e-7
"""Part of the largest eigenvalue of a covariance below which one counts as rounding."""


NOISE_LOSS = 1.5
"""Mean loss of a point of noise, half of χ² of three axes."""


def robust_loss(lengths: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return Huber's loss (...,) of residuals, `lengths` (...,) in σ of the noise."""
    linear = OUTLIER_LENGTH * (lengths - 0.5 * OUTLIER_LENGTH)
    return np.where(lengths < OUTLIER_LENGTH, 0.5 * lengths**2, linear)


def huber_weights(lengths: NDArray[np.float64]) -> NDArray[np.float64]:
    """Weights (...,) of the same slope in least squares, for `lengths` (...,) in σ of the noise."""
    return OUTLIER_LENGTH / np.maximum(lengths, OUTLIER_LENGTH)


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Normal equations of the W observations of a block.

    Each has d components of initial states and q parameters.

    Parameters
    ----------
    members : (W,) index of each among all observations
    parameters : (W, q) indices of each observation's parameters
    state_size : d
    hessian : (W, d + q, d + q) H, in inverse units of the unknowns
    gradient : (W, d + q) g, likewise
    """

    members: NDArray[np.int64]
    parameters: NDArray[np.int64]
    state_size: int
    hessian: NDArray[np.float64]
    gradient: NDArray[np.float64]

    @staticmethod
    def of(
        block: ObservationBlock,
        estimate: NDArray[np.float64],
        linear: Linearisation,
        until: NDArray[np.float64],
    ) -> NormalEquations:
        """Set them up at `estimate` (W, d), SI units, with the points up to `until` (W,) s."""
        counted = linear.valid & (block.times <= until[:, None])
        residuals = block.whitened(np.where(counted[..., None], linear.residuals, 0.0))
        lengths = np.linalg.norm(residuals, axis=2)
        rooted = np.sqrt(huber_weights(lengths)) * counted
        count, k = linear.slopes.shape[:2]
        weighting = (block.whitening * rooted[..., None, None])[:, None]
        weighted = (weighting @ linear.slopes[..., None]).reshape(count, k, 3 * lengths.shape[1])
        # In parts so small that BLAS takes one thread: on matrices of this size its threads wait
        # for one another, the longer the busier the machine is.
        parts = np.array_split(weighted, 1 + k * weighted[0].size // SINGLE_THREAD_PRODUCTS, axis=2)
        hessian = sum((part @ part.swapaxes(1, 2) for part in parts), np.zeros((count, k, k)))
        target = (residuals * rooted[..., None]).reshape(count, -1)
        gradient = (weighted @ target[..., None])[..., 0]
        d = estimate.shape[1]
        precision = block.prior_deviations**-2
        diagonal = np.arange(d)
        hessian[:, diagonal, diagonal] += precision
        gradient[:, :d] += precision * estimate
        return NormalEquations(block.members, block.parameters, d, hessian, gradient)

    def with_common(self, index: NDArray[np.int64], first: int) -> NormalEquations:
        """Return the equations with shared errors, whose prior is left out, as common parameters.

        `index` (W, b) index of each observation's shared errors, the last nuisance parameters.
        """
        count = index.shape[1]
        d = self.state_size - count
        hessian = self.hessian.copy()
        diagonal = np.arange(d, self.state_size)
        hessian[:, diagonal, diagonal] -= 1.0
        parameters = np.hstack([first + index, self.parameters])
        return NormalEquations(self.members, parameters, d, hessian, self.gradient)

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
            self.members,
            self.parameters,
            gains,
            offsets,
            self.hessian[:, d:, d:] - across @ gains,
            self.gradient[:, d:] - (across @ offsets[..., None])[..., 0],
        )

    def state_covariances(
        self, eliminated: Elimination, posterior: Gaussian
    ) -> NDArray[np.float64]:
        """Covariance (W, d, d) of the initial states, in SI units, whatever θ_s is."""
        gains = eliminated.gains
        covariance = eliminated.parameter_covariances(posterior)
        return self._given_parameters() + gains @ covariance @ gains.swapaxes(1, 2)

    def spreads(
        self, linear: Linearisation, eliminated: Elimination, posterior: Gaussian
    ) -> NDArray[np.float64]:
        """Standard deviation (W, P) in m of the predicted position of each point of a block."""
        count, k, points, _ = linear.slopes.shape
        d = self.state_size
        slopes = linear.slopes.reshape(count, k, points * 3)
        by_state = slopes[:, :d]
        by_parameter = slopes[:, d:] - eliminated.gains.transpose(0, 2, 1) @ by_state
        variances = ((self._given_parameters() @ by_state) * by_state).sum(axis=1)
        covariance = eliminated.parameter_covariances(posterior)
        variances += ((covariance @ by_parameter) * by_parameter).sum(axis=1)
        return np.sqrt(variances.reshape(count, points, 3).sum(axis=2))

    def _given_parameters(self) -> NDArray[np.float64]:
        """Covariance (W, d, d) of the initial states, in SI units, given the parameters."""
        d = self.state_size
        return np.asarray(np.linalg.inv(self.hessian[:, :d, :d]), dtype=np.float64)


@dataclass(frozen=True, eq=False)
class Elimination:
    """Initial states as a function of the parameters, and the reduced equations of these.

    Parameters
    ----------
    members : (W,) index of each among all observations
    parameters : (W, q) indices of each observation's parameters
    gains : (W, d, q) H_ss⁻¹ H_sp, SI units per width
    offsets : (W, d) H_ss⁻¹ g_s, in SI units
    information : (W, q, q) Λ, per width²
    scores : (W, q) g_p - H_ps H_ss⁻¹ g_s, per width
    """

    members: NDArray[np.int64]
    parameters: NDArray[np.int64]
    gains: NDArray[np.float64]
    offsets: NDArray[np.float64]
    information: NDArray[np.float64]
    scores: NDArray[np.float64]

    def parameter_covariances(self, posterior: Gaussian) -> NDArray[np.float64]:
        """Covariance (W, q, q) of the parameters of each observation, in widths²."""
        return posterior.covariance[self.parameters[:, :, None], self.parameters[:, None, :]]

    def state_steps(self, parameter_steps: NDArray[np.float64]) -> NDArray[np.float64]:
        """Steps (W, d) of states, SI units, by `parameter_steps` (n,) widths of all parameters."""
        steps = parameter_steps[self.parameters][..., None]
        return -self.offsets - (self.gains @ steps)[..., 0]

    def state_means(
        self, estimate: NDArray[np.float64], unit: NDArray[np.float64], posterior: Gaussian
    ) -> NDArray[np.float64]:
        """Means (W, d) of states, SI units, linearised at `estimate` (W, d) and `unit` (n,)."""
        return estimate + self.state_steps(np.clip(posterior.mean, 0.0, 1.0) - unit)


def reduced_equations(
    prior: Gaussian,
    unit: NDArray[np.float64],
    eliminations: Sequence[Elimination],
    weights: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Add up what the prior and all observations say of θ_s, at a point of the unit cube.

    `unit` (n,) that point; `weights` (n_observations,) of the observations. Returns `information`
    (n, n), per width²; `scores` (n,) per width, the gradient of the loss.
    """
    information, scores = prior.precision.copy(), prior.scores(unit)
    for part in eliminations:
        weight = weights[part.members]
        rows, columns = part.parameters[:, :, None], part.parameters[:, None, :]
        np.add.at(information, (rows, columns), weight[:, None, None] * part.information)
        np.add.at(scores, part.parameters, weight[:, None] * part.scores)
    return information, scores


def joint_posterior(
    prior: Gaussian,
    unit: NDArray[np.float64],
    eliminations: Sequence[Elimination],
    weights: NDArray[np.float64],
) -> Gaussian:
    """Return the posterior of θ_s by equations at `unit` (n,), with `weights` (n_observations,)."""
    information, scores = reduced_equations(prior, unit, eliminations, weights)
    return Gaussian(information, information @ unit - scores)


def agreement_weights(
    prior: Gaussian,
    unit: NDArray[np.float64],
    eliminations: Sequence[Elimination],
    weights: NDArray[np.float64],
) -> NDArray[np.float64]:
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

    `unit` (n,) u, a point of the unit cube; `weights` (n_observations,) w of the last step, above
    0. Returns (n_observations,) weights.
    """
    whole, gradient = reduced_equations(prior, unit, eliminations, weights)
    all_covariance = np.asarray(np.linalg.inv(whole))
    step = -all_covariance @ gradient
    squares, ranks = np.empty(weights.size), np.empty(weights.size)
    for part in eliminations:
        weight = weights[part.members][:, None]
        information, own = part.information, part.scores
        rows, columns = part.parameters[:, :, None], part.parameters[:, None, :]
        covariance = all_covariance[rows, columns]
        left = np.linalg.inv(
            np.eye(covariance.shape[1]) - covariance @ (weight[..., None] * information)
        )
        without = left @ covariance
        pulled = without @ (weight * own)[..., None]
        moved = left @ step[part.parameters][..., None] + pulled
        scores = own + (information @ moved)[..., 0]
        spread = information + information @ without @ information
        values, vectors = np.linalg.eigh(0.5 * (spread + spread.transpose(0, 2, 1)))
        along = np.einsum("wij,wi->wj", vectors, scores)
        counted = values > np.maximum(NEGLIGIBLE * values[:, -1:], np.finfo(float).tiny)
        parts = np.where(counted, along**2 / np.where(counted, values, 1.0), 0.0)
        squares[part.members], ranks[part.members] = parts.sum(axis=1), counted.sum(axis=1)
    typical = max(float(np.median(squares / np.maximum(ranks, 1))), 1.0)
    freedom = AGREEMENT_FREEDOM
    return np.minimum((freedom + ranks) / (freedom + squares / typical), 1.0)


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
