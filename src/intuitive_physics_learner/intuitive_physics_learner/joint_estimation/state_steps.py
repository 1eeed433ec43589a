"""Steps of initial states alone, θ_s held, with slopes that are known already.

A step in all unknowns is straight, but the initial states that explain a motion lie on a curve as
θ_s changes: where motion is sensitive, it leaves the floor of a narrow curved valley of the loss
after a small part of its way, and damping then makes it small. A step of the initial states from
where it ended, with the slopes where it began (a simplified Newton step: Deuflhard 2011, *Newton
Methods for Nonlinear Problems*, Sec. 2.1.2), leads back to the floor. Transtrum and Sethna (2012),
*Improvements to the Levenberg-Marquardt algorithm for nonlinear least-squares minimization*,
correct steps to the second order for the same reason.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_learner.joint_estimation.fit_horizons import TrajectoryFits
from intuitive_physics_learner.joint_estimation.linearisation import Linearisation
from intuitive_physics_learner.joint_estimation.normal_equations import (
    NormalEquations,
    huber_weights,
)
from intuitive_physics_learner.joint_estimation.observation_blocks import ObservationBlock


@dataclass(frozen=True, eq=False)
class StateSteps:
    """Gauss-Newton steps of the initial states of a block's W observations.

    The slopes, and so the matrix H_ss of `normal_equations`, are those of one estimate.

    Parameters
    ----------
    block : the observations
    counted : (W, P) bool, which of their points are fitted
    gains : (W, d, 3 P) H_ss⁻¹ A_sᵀ, SI units per standard deviation of a point
    shrinking : (W, d, d) H_ss⁻¹ P_s, without a unit
    """

    block: ObservationBlock
    counted: NDArray[np.bool_]
    gains: NDArray[np.float64]
    shrinking: NDArray[np.float64]

    @staticmethod
    def of(
        block: ObservationBlock,
        fits: TrajectoryFits,
        linear: Linearisation,
        equations: NormalEquations,
    ) -> StateSteps:
        """Set them up by `equations` of the points up to the horizons, at the estimate."""
        count, d = fits.estimate.shape
        inner = equations.hessian[:, :d, :d]
        slopes = np.einsum("wpij,wkpj->wkpi", block.whitening, linear.slopes[:, :d])
        slopes = slopes.reshape(count, d, 3 * block.times.shape[1])
        prior = np.eye(d) * block.prior_deviations[:, None, :] ** -2
        gains = np.linalg.solve(inner, slopes)
        shrinking = np.asarray(np.linalg.solve(inner, prior), dtype=np.float64)
        counted = linear.valid & (block.times <= fits.horizons[:, None])
        return StateSteps(block, counted, gains, shrinking)

    def stepped(
        self, estimates: NDArray[np.float64], residuals: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return initial states (c, W, d) that suit the θ_s of each trial.

        `estimates` (c, W, d) deviations from the observed initial states, in SI units, to step
        from; `residuals` (c, W, P, 3) m, of simulations from these. Points that a trial does not
        reach do not count.
        """
        after = np.empty(estimates.shape)
        # One trial at a time: all at once would take memory for as many points again.
        for k, left in enumerate(residuals):
            reached = self.counted & np.isfinite(left).all(axis=2)
            left = self.block.whitened(np.where(reached[..., None], left, 0.0))
            weights = huber_weights(np.linalg.norm(left, axis=2))
            target = (left * weights[..., None]).reshape(len(left), -1, 1)
            step = self.gains @ target + self.shrinking @ estimates[k][..., None]
            after[k] = estimates[k] - step[..., 0]
        return after
