"""How far the fits to the observations of a block are, and how they go on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_learner.joint_estimation import horizons
from intuitive_physics_learner.joint_estimation.normal_equations import robust_loss
from intuitive_physics_learner.joint_estimation.observation_blocks import ObservationBlock

FAILED_LENGTH = 1e4
"""Standard deviations of noise that a point counts as which the simulator did not reach."""

LARGEST_STATE_DEVIATION = 0.3
"""m, m/s, rad, rad/s at most over which an initial state is moved to find slopes, to begin with."""


@dataclass(eq=False)
class TrajectoryFits:
    """How far the fits to a block's W observations are.

    Parameters
    ----------
    estimate : (W, d) of the initial states' deviations
    deviations : (W, d) standard deviation of each
    horizons : (W,) s up to which each is fitted
    misfits : (W,) for how many steps each has not fitted
    """

    estimate: NDArray[np.float64]
    deviations: NDArray[np.float64]
    horizons: NDArray[np.float64]
    misfits: NDArray[np.int64]

    @staticmethod
    def beginning(block: ObservationBlock) -> TrajectoryFits:
        """Return fits to the first points, not begun yet."""
        return TrajectoryFits(
            np.zeros_like(block.prior_deviations),
            np.minimum(block.prior_deviations, LARGEST_STATE_DEVIATION),
            horizons.first_horizons(block),
            np.zeros(block.members.size, dtype=np.int64),
        )

    def losses(
        self,
        block: ObservationBlock,
        trying: NDArray[np.float64],
        residuals: NDArray[np.float64],
        noise: float,
    ) -> NDArray[np.float64]:
        """Loss (c, W) of initial states (c, W, d) that leave residuals (c, W, P, 3) m."""
        lengths = np.linalg.norm(residuals, axis=3) / noise
        lengths = np.nan_to_num(lengths, nan=FAILED_LENGTH, posinf=FAILED_LENGTH)
        counted = block.times <= self.horizons[:, None]
        fit = (robust_loss(lengths) * counted).sum(axis=2)
        return fit + 0.5 * ((trying / block.prior_deviations) ** 2).sum(axis=2)

    def advance(
        self,
        block: ObservationBlock,
        residuals: NDArray[np.float64],
        goal: NDArray[np.float64],
        noise: float,
    ) -> tuple[bool, int]:
        """Move horizons on where all fits, and back where it has not for too long.

        Parameters
        ----------
        residuals : (W, P, 3) m
        goal : (W,) s where horizons may go

        Returns
        -------
        moved : whether any horizon did
        misfits : how many observations did not fit
        """
        starts = horizons.misfit_starts(block, residuals, self.horizons, noise)
        misfit = np.isfinite(starts)
        self.misfits = np.where(misfit, self.misfits + 1, 0)
        back = self.misfits >= horizons.PATIENCE
        self.misfits[back] = 0
        before = self.horizons
        self.horizons = np.where(misfit, before, goal)
        retreat = np.maximum(starts - horizons.RETREAT, horizons.first_horizons(block))
        self.horizons = np.where(back, np.minimum(retreat, before), self.horizons)
        return bool((self.horizons != before).any()), int(misfit.sum())

    def state(self) -> dict[str, Any]:
        """Plain data."""
        return {name: array.tolist() for name, array in vars(self).items()}

    def load_state(self, state: Mapping[str, Any]) -> None:
        """Take over what `state` returned."""
        for name, values in state.items():
            own = getattr(self, name)
            setattr(self, name, np.array(values, dtype=own.dtype).reshape(own.shape))
