"""The information about θ_s that a throw is expected to give, before it is made.

A throw is simulated as the observation it would become, at θ_s drawn from the present posterior and
with the noise and rate of the camera, and linearised there in θ_s and in its initial state, as
`docs/method/next_throw.md` derives. Its detections are taken one by one in the order of time, as a
Kalman filter does. As in the estimation (`fit_horizons`), a detection counts only if its position
is predicted well enough and the slopes hold as far as the uncertainty reaches; from the first one
on that does not, motion is chaotic to the estimator, and the rest of the track gives no
information.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.parameter_posterior import ParameterPosterior
from intuitive_physics.simulation import Simulator
from intuitive_physics_learner.cost.cost_function import TrajectoryCost
from intuitive_physics_learner.cost.parameter_influence import parameter_influence
from intuitive_physics_learner.design.throws import Throw, ViewingConditions
from intuitive_physics_learner.joint_estimation.fit_horizons import (
    LARGEST_BEND,
    LARGEST_BEND_SHARE,
    LARGEST_SPREAD,
    first_horizons,
)
from intuitive_physics_learner.joint_estimation.linearisation import (
    Linearisation,
    ParameterSteps,
    linearise,
    separate_groups,
)
from intuitive_physics_learner.joint_estimation.observation_blocks import (
    ObservationBlock,
    observation_blocks,
)
from intuitive_physics_learner.search.gaussian import Gaussian

PARAMETER_STEP = 0.005
"""Width of the differences along parameters: small, as draws cover the posterior; set by hand."""

STATE_STEP = 0.002
"""Width of the differences along components of initial states (m, m/s, rad or rad/s); set by
hand."""


@dataclass(frozen=True, eq=False)
class Reduction:
    """Covariances of r functions of θ_s before throws, B, and expected after each, B - U D Uᵀ.

    U has as many columns as the throw has parameters, which are few, whatever r is. D is the mean
    over the draws of θ_s: the covariance that is expected decides, not its logarithm. A throw that
    determines a friction exactly at one draw, and not at all at the others, at which the ball does
    not slide, has a high mean logarithm and most often leaves the friction as unknown as it was.

    Parameters
    ----------
    before : (r, r) B, in squared units of the functions
    gains : (W, r, q) U, units of the functions per width of the throw's parameters
    lost : (W, q, q) D, widths²
    """

    before: NDArray[np.float64]
    gains: NDArray[np.float64]
    lost: NDArray[np.float64]

    @staticmethod
    def of(
        covariance: NDArray[np.float64],
        directions: NDArray[np.float64],
        parameters: NDArray[np.int64],
        after: NDArray[np.float64],
    ) -> Reduction:
        """Return what is left after throws of which each says something of q parameters.

        `covariance` (n, n) widths², of all parameters before the throw; `directions` (r, n) slopes
        of the functions per width of each; `parameters` (W, q) indices of those of each throw, and
        `after` (W, q, q) widths², their covariance after it.
        """
        crossed = covariance @ directions.T
        block = covariance[parameters[:, :, None], parameters[:, None, :]]
        gains = np.asarray(np.linalg.solve(block, crossed[parameters]), dtype=np.float64)
        return Reduction(directions @ crossed, gains.transpose(0, 2, 1), block - after)

    @property
    def variances(self) -> NDArray[np.float64]:
        """Diagonals (W, r) of the covariances after each throw, never negative."""
        fall = ((self.gains @ self.lost) * self.gains).sum(axis=2)
        return np.maximum(np.diag(self.before) - fall, 0.0)

    def determinant_fall(self, blur: float) -> NDArray[np.float64]:
        """Fall (W,) of ln det of the covariances, the square of `blur` added to each variance.

        By the matrix determinant lemma det(M - U D Uᵀ) = det M det(I - D Uᵀ M⁻¹ U).
        """
        blurred = self.before + blur**2 * np.eye(len(self.before))
        weighted = self.gains.transpose(0, 2, 1) @ np.linalg.solve(blurred, self.gains)
        left = np.eye(self.lost.shape[2]) - self.lost @ weighted
        return -np.asarray(np.linalg.slogdet(left)[1])


def expected_reductions(
    throws: Sequence[Throw],
    posterior: ParameterPosterior,
    directions: NDArray[np.float64],
    units: NDArray[np.float64],
    viewing: ViewingConditions,
    simulator: Simulator,
    execution_error: float,
    rng: np.random.Generator,
) -> Iterator[tuple[NDArray[np.int64], Reduction]]:
    """Judge throws, those together that have equally many unknowns.

    `directions` (r, n) slopes of what is asked, as of `Reduction.of`; `units` (n_draws, n) draws of
    θ_s from the posterior, points of the unit cube; `execution_error` standard deviation by which a
    throw misses what was meant, a part of the width of each range. Yields the index (W,) of each
    throw among all, and what is left after each.
    """
    observations = [viewing.observation(throw.scene) for throw in throws]
    cost = TrajectoryCost(observations, simulator, posterior.materials)
    influence = parameter_influence(observations, posterior.materials)
    blocks = observation_blocks(observations, influence)
    groups = separate_groups(influence)
    space, covariance = posterior.space, Gaussian.of(posterior, bounded=True).covariance
    misses = [
        execution_error * _execution_errors(throws, block, len(units), rng) for block in blocks
    ]
    steps = np.full(posterior.mean.size, 2.0 * PARAMETER_STEP)
    for block, missed in zip(blocks, misses, strict=True):
        prior = covariance[block.parameters[:, :, None], block.parameters[:, None, :]]
        expected = np.empty((len(units), *prior.shape))
        for k, unit in enumerate(units):
            at = ParameterSteps(unit, steps, groups, space.to_parameters)
            deviations = np.full(block.prior_deviations.shape, 2.0 * STATE_STEP)
            linear = linearise(cost, block, missed[k], deviations, at, block.durations)
            expected[k] = _filtered(linear, block, prior, at, viewing)
        after = expected.mean(axis=0)
        yield block.members, Reduction.of(covariance, directions, block.parameters, after)


def _execution_errors(
    throws: Sequence[Throw], block: ObservationBlock, draws: int, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Errors (n_draws, W, d), in SI units, of throws of a block that miss by whole ranges."""
    widths = np.zeros((block.members.size, block.initial_states.observed.shape[1] * 12))
    for row, member in zip(widths, block.members, strict=True):
        spreads = throws[member].widths.ravel()
        row[: spreads.size] = spreads
    state_widths = np.take_along_axis(widths, block.initial_states.components, axis=1)
    normal = rng.standard_normal((draws, *state_widths.shape))
    return np.asarray(state_widths * normal)


def _filtered(
    linear: Linearisation,
    block: ObservationBlock,
    prior: NDArray[np.float64],
    at: ParameterSteps,
    viewing: ViewingConditions,
) -> NDArray[np.float64]:
    """Covariance (W, q, q) in widths² of each throw's parameters after it; `prior` before it."""
    noise = viewing.noise
    count, k, points = linear.slopes.shape[:3]
    d = block.prior_deviations.shape[1]
    covariance = np.zeros((count, k, k))
    covariance[:, range(d), range(d)] = block.prior_deviations**2
    covariance[:, d:, d:] = prior
    curvatures = _curvatures(linear, block, at)
    usable = linear.valid & _in_view(linear.residuals, block, viewing)
    first = block.times <= first_horizons(block)[:, None]
    alive = np.ones(count, dtype=bool)
    rows = np.arange(count)
    order = np.argsort(block.times, axis=1, kind="stable")
    for turn in range(points):
        p = order[:, turn]
        slopes = linear.slopes[rows, :, p]
        reach = covariance @ slopes
        predicted = slopes.transpose(0, 2, 1) @ reach
        spreads = np.sqrt(np.trace(predicted, axis1=1, axis2=2))
        # A bend of slope c per unit of the unknown errs by c σ² / 4 at half of σ, as `linearise`.
        variances = np.diagonal(covariance, axis1=1, axis2=2)[:, :, None]
        bends = np.sqrt(((0.25 * variances * curvatures[rows, :, p]) ** 2).sum(axis=(1, 2)))
        straight = bends <= LARGEST_BEND * noise + LARGEST_BEND_SHARE * spreads
        predictable = (spreads <= LARGEST_SPREAD) & straight
        visible = usable[rows, p]
        alive &= ~visible | predictable | first[rows, p]
        counted = (alive & visible)[:, None, None]
        gains = np.linalg.solve(predicted + noise**2 * np.eye(3), reach.transpose(0, 2, 1))
        covariance -= np.where(counted, reach @ gains, 0.0)
    return np.ascontiguousarray(covariance[:, d:, d:])


def _curvatures(
    linear: Linearisation, block: ObservationBlock, at: ParameterSteps
) -> NDArray[np.float64]:
    """Change of each slope per unit of its unknown, (W, k, P, 3); 0 where one side is a bound."""
    steps = np.full(linear.slopes.shape[:2], STATE_STEP)
    sides = np.minimum(at.up, at.down)[block.parameters]
    steps[:, block.prior_deviations.shape[1] :] = sides
    kinks = linear.kinks
    widths = np.broadcast_to(steps[:, :, None, None], kinks.shape)
    return np.divide(kinks, widths, out=np.zeros_like(kinks), where=widths > 0.0)


def _in_view(
    positions: NDArray[np.float64], block: ObservationBlock, viewing: ViewingConditions
) -> NDArray[np.bool_]:
    """Whether each detection (W, P) comes before its object leaves the region in view."""
    low, high = viewing.region.T
    inside = ((positions >= low) & (positions <= high)).all(axis=2)
    by_object = inside.reshape(len(inside), -1, viewing.times.size)
    return np.logical_and.accumulate(by_object, axis=2).reshape(inside.shape)
