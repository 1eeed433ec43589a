"""Looking for initial spins farther away than slopes reach.

A bounce that slips hardly tells how much a ball spun more, so from a guess that is far from the
truth no slope leads there: the fit of such a trajectory ends before the bounce, or soon after it
with another spin. These are the fastest spins. Were they left out, what is learned of how balls are
thrown would be too slow.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm, qmc

from intuitive_physics.materials import StaticParameters
from intuitive_physics_learner.cost.cost_function import Cost
from intuitive_physics_learner.joint_estimation.fit_horizons import TrajectoryFits
from intuitive_physics_learner.joint_estimation.initial_spins.spin_evidence import UnknownSpin
from intuitive_physics_learner.joint_estimation.linearisation import residuals_at
from intuitive_physics_learner.joint_estimation.observation_blocks import ObservationBlock
from intuitive_physics_learner.joint_estimation.settings import JointEstimationSettings

TRIED = 64
"""Spins in each round …"""

WIDTHS = (3.0, 1.0, 0.3, 0.1, 0.03)
"""… each round normal about the best of the one before, with standard deviations of so many times
the prior's: the last is as fine as slopes can take over from."""


def search_spins(
    cost: Cost,
    block: ObservationBlock,
    fits: TrajectoryFits,
    unknown: Sequence[Sequence[UnknownSpin]],
    parameters: StaticParameters,
    settings: JointEstimationSettings,
) -> tuple[TrajectoryFits, NDArray[np.bool_]]:
    """Find spins that explain more of what comes beyond the horizons of fits.

    Parameters
    ----------
    cost : simulates the observations
    block : W observations
    fits : to it
    unknown : of each observation, its initial spins that were guesses
    parameters : θ_s
    settings : of horizons, and of the smallest gain

    Returns
    -------
    fits : with such a spin where there is one, and the horizon where the next misfit of the given
        fit would show
    found : (W,) where that is
    """
    ends_early = (fits.horizons < block.durations) & np.array([bool(each) for each in unknown])
    if not ends_early.any():
        return fits, ends_early
    reach = fits.horizons + settings.retreat + settings.largest_advance
    ends = np.where(ends_early, np.minimum(reach, block.durations), 0.0)
    near, far = block.shortened(ends), replace(fits, horizons=ends)

    def losses(estimates: NDArray[np.float64]) -> NDArray[np.float64]:
        index = np.zeros((len(estimates), 1), dtype=np.int64)
        residuals = residuals_at(cost, near, estimates, [parameters], index, ends)
        return far.losses(near, estimates, residuals, settings)

    best, every = fits.estimate.copy(), np.arange(len(ends))
    before = least = losses(best[None])[0]
    rounds = [(k, width) for k in range(max(map(len, unknown))) for width in WIDTHS]
    for k, width in rounds:
        tried = np.tile(best, (TRIED, 1, 1))
        for row in np.flatnonzero(ends_early).tolist():
            for spin in unknown[row][k : k + 1]:
                away = width * block.prior_deviations[row, spin.places] * _standard_normal()
                tried[:, row, spin.places] += away
        found = losses(tried)
        pick = found.argmin(axis=0)
        better = found[pick, every] < least
        best = np.where(better[:, None], tried[pick, every], best)
        least = np.minimum(found[pick, every], least)
    gained = ends_early & (least < before - settings.smallest_scan_gain)
    horizons = np.where(gained, ends, fits.horizons)
    estimate = np.where(gained[:, None], best, fits.estimate)
    return replace(fits, estimate=estimate, horizons=horizons), gained


@cache
def _standard_normal() -> NDArray[np.float64]:
    """Points (TRIED, 3) that are spread like standard normal ones, more evenly than drawn ones."""
    even = qmc.Sobol(3, scramble=False).random(TRIED)
    return np.asarray(norm.ppf((even + 0.5 / TRIED).clip(max=1.0 - 0.5 / TRIED)))
