"""Spins far from a guess, which slopes there do not lead to.

After a bounce that slips, the motion hardly depends on how fast the ball spun. The derivatives at a
guess far below the true spin are then nearly zero, and Gauss-Newton steps do not reach it: the fit
of such a trajectory ends before the bounce, or soon after it with another spin. This happens to the
fastest spins; without them the learned spread of initial spins would be too small.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm, qmc

from intuitive_physics.materials import StaticParameters
from intuitive_physics.prior_knowledge.spin_evidence import UnknownSpin
from intuitive_physics_learner.cost.cost_function import Cost
from intuitive_physics_learner.joint_estimation.fit_horizons import RETREAT, TrajectoryFits
from intuitive_physics_learner.joint_estimation.linearisation import residuals_at
from intuitive_physics_learner.joint_estimation.normal_equations import NOISE_LOSS
from intuitive_physics_learner.joint_estimation.observation_blocks import ObservationBlock
from intuitive_physics_learner.joint_estimation.trajectory_model import Estimate, TrajectoryModel

SMALLEST_GAIN = 3.0
"""Loss that a spin must gain to be taken: a likelihood ratio of e³ ≈ 20, hardly chance."""

TRIED_SPINS = 64
"""Spins simulated in each round."""

SPIN_WIDTHS = (3.0, 1.0, 0.3, 0.1, 0.03)
"""Standard deviation of the spins of each round about the best one so far, over the prior's. From
the best spin of the last round, Gauss-Newton steps converge."""


def other_spins(
    model: TrajectoryModel, estimate: Estimate
) -> dict[int, tuple[NDArray[np.float64], float]]:
    """Find spins that explain more of what comes beyond the horizons than those of an estimate.

    Returns
    -------
    By observation, where there are any, deviations (d,) from its observed initial states, and the
    time in s where the next misfit of the given fit would show, up to which they explain more.
    """
    parameters, counted = model.space.to_parameters(estimate.unit), model.task.counted

    def searched(index: int) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
        block, fits = model.blocks[index], estimate.fits[index]
        unknown = [model.unknown_spins[k] if counted[k] else [] for k in block.members.tolist()]
        reach = fits.horizons + RETREAT + model.largest_advance
        return _searched(model.cost, block, fits, unknown, parameters, reach)

    others = {}
    for block, found in zip(model.blocks, model.of_blocks(searched), strict=True):
        estimates, ends, gained = found
        for row in np.flatnonzero(gained).tolist():
            others[int(block.members[row])] = estimates[row], float(ends[row])
    return others


def _searched(
    cost: Cost,
    block: ObservationBlock,
    fits: TrajectoryFits,
    unknown: Sequence[Sequence[UnknownSpin]],
    parameters: StaticParameters,
    reach: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    """Return estimates (W, d) with the best spins, ends (W,) s, and whether (W,) they gain."""
    ends_early = (fits.horizons < block.durations) & np.array([bool(each) for each in unknown])
    ends = np.where(ends_early, np.minimum(reach, block.durations), 0.0)
    ends_early &= _is_misfit(cost, block, fits, parameters, ends)
    if not ends_early.any():
        return fits.estimate, fits.horizons, ends_early
    ends = np.where(ends_early, ends, 0.0)
    near, far = block.shortened(ends), replace(fits, horizons=ends)

    def losses(estimates: NDArray[np.float64]) -> NDArray[np.float64]:
        index = np.zeros((len(estimates), 1), dtype=np.int64)
        residuals = residuals_at(cost, near, estimates, [parameters], index, ends)
        return far.losses(near, estimates, residuals)

    best, every = fits.estimate.copy(), np.arange(len(ends))
    before = least = losses(best[None])[0]
    rounds = [(k, width) for k in range(max(map(len, unknown))) for width in SPIN_WIDTHS]
    for k, width in rounds:
        tried = np.tile(best, (TRIED_SPINS, 1, 1))
        for row in np.flatnonzero(ends_early).tolist():
            for spin in unknown[row][k : k + 1]:
                away = width * block.prior_deviations[row, spin.places] * _standard_normal()
                tried[:, row, spin.places] += away
        trial_losses = losses(tried)
        pick = trial_losses.argmin(axis=0)
        better = trial_losses[pick, every] < least
        best = np.where(better[:, None], tried[pick, every], best)
        least = np.minimum(trial_losses[pick, every], least)
    return best, ends, ends_early & (least < before - SMALLEST_GAIN)


def _is_misfit(
    cost: Cost,
    block: ObservationBlock,
    fits: TrajectoryFits,
    parameters: StaticParameters,
    ends: NDArray[np.float64],
) -> NDArray[np.bool_]:
    """Whether (W,) the estimate leaves more than noise of what is between horizons and `ends` (W,).

    No spin could gain more than what is left unexplained there.
    """
    near, present = block.shortened(ends), fits.estimate[None]
    index = np.zeros((1, 1), dtype=np.int64)
    residuals = residuals_at(cost, near, present, [parameters], index, ends)
    until = replace(fits, horizons=ends)
    left = (until.losses(near, present, residuals) - fits.losses(near, present, residuals))[0]
    after, within = near.times > fits.horizons[:, None], near.times <= ends[:, None]
    return left > NOISE_LOSS * (after & within).sum(axis=1) + SMALLEST_GAIN


@cache
def _standard_normal() -> NDArray[np.float64]:
    """Points (TRIED_SPINS, 3) spread like standard normal ones, more evenly than drawn ones."""
    even = qmc.Sobol(3, scramble=False).random(TRIED_SPINS)
    return np.asarray(norm.ppf((even + 0.5 / TRIED_SPINS).clip(max=1.0 - 0.5 / TRIED_SPINS)))
