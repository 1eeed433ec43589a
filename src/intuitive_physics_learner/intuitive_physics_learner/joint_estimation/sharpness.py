"""How sharply the observations hold each parameter at an estimate, looked at from all sides."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_learner.joint_estimation.coordinate_scan import LEVELS
from intuitive_physics_learner.joint_estimation.posterior import Posterior
from intuitive_physics_learner.joint_estimation.trajectory_model import Estimate, TrajectoryModel

PLAUSIBLE_RISE = 2.0
"""Loss that two standard deviations cost: half of two squared."""

SCANNED_LEVELS = LEVELS[::2]
"""Of each parameter that are tried to find how far on its range it can go without a loss."""

WIDENING = 3.0
"""By what steps are wider than those of the fit, to find slopes that say how sharp it is."""


def sharpness(model: TrajectoryModel, estimate: Estimate) -> tuple[Posterior, NDArray[np.float64]]:
    """What is believed of the parameters at the estimate, on the unit cube.

    Returns
    -------
    posterior : from slopes to both sides
    deviations : (n,) largest standard deviation of each parameter by slopes to one side, or
        both, and by how far on its range it can go without a loss. Where friction suffices,
        more would change nothing: the data hold it on one side only.
    """
    linear = model.linearised(estimate, WIDENING)
    posterior = model.posterior(model.equations(estimate, linear))[0]
    deviations = [posterior.deviations]
    for side in range(2):
        sided = [replace(each, slopes=each.one_sided[side]) for each in linear]
        deviations.append(model.posterior(model.equations(estimate, sided))[0].deviations)
    rises, _ = model.scanned(estimate, linear, SCANNED_LEVELS)
    away = np.abs(np.array(SCANNED_LEVELS) - estimate.unit[:, None])
    deviations.append(np.where(rises < PLAUSIBLE_RISE, 0.5 * away, 0.0).max(axis=1))
    return posterior, np.max(deviations, axis=0)


def sharpness_simulations(model: TrajectoryModel) -> int:
    """Simulations of single observations that `sharpness` takes."""
    return sum(
        block.members.size
        * (
            1
            + 2 * block.prior_deviations.shape[1]
            + 2 * (1 + len(SCANNED_LEVELS)) * block.parameters.shape[1]
        )
        for block in model.blocks
    )
