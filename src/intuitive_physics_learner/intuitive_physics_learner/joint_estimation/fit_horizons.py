"""Up to when each trajectory is fitted: as far as it can be foretold, a little more each time.

Motion among contacts is chaotic. Where the estimate leaves open on which edge a box lands, slopes
say nothing of what comes after, and a fit to it would settle in one of many false optima. So a fit
begins with a few points and takes in more as what it has learned lets it see further.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_learner.joint_estimation.linearisation import Linearisation
from intuitive_physics_learner.joint_estimation.normal_equations import robust_loss
from intuitive_physics_learner.joint_estimation.observation_blocks import ObservationBlock

FIRST_POINTS = 10
"""Points of each object that a fit begins with."""

FIRST_DURATION = 0.5
"""s that a fit begins with at most."""

LARGEST_ADVANCE = 0.2
"""s by which a horizon advances at most in one step."""

TRUSTED_SPREAD = 0.15
"""m of standard deviation up to which a point can be foretold well enough to be taken in."""

TRUSTED_BEND = 2.0
"""Standard deviations of noise that a bend may add to what is foretold in a straight line."""

TRUSTED_PART = 1.0
"""Of the spread, that a bend may add likewise."""

MISFIT = 2.3
"""Median of neighbouring residuals' lengths, in standard deviations of noise, that is no fit; that
of good ones is 1.5."""

MISFIT_POINTS = 6
"""Neighbouring points whose median counts."""

RETREAT = 0.3
"""s before a misfit to which a horizon goes back."""

PATIENCE = 1
"""Steps that a fit has to mend a misfit before its horizon goes back."""


def first_horizons(block: ObservationBlock) -> NDArray[np.float64]:
    """Where to begin, (W,) s."""
    ordered = np.sort(block.times, axis=1)
    counts = np.isfinite(ordered).sum(axis=1)
    last = np.minimum(FIRST_POINTS * block.initial_states.objects, counts) - 1
    return np.minimum(ordered[np.arange(last.size), last], FIRST_DURATION)


def advanced_horizons(
    block: ObservationBlock,
    linear: Linearisation,
    spreads: NDArray[np.float64],
    horizons: NDArray[np.float64],
    limits: NDArray[np.float64],
    noise: float,
) -> NDArray[np.float64]:
    """Take in points, in the order of time, up to the first one that cannot be foretold.

    Parameters
    ----------
    spreads : (W, P) m, standard deviation of what is foretold
    horizons : (W,) s, the present ones
    limits : (W,) s, up to where `linear` was simulated
    """
    foretold = (spreads <= TRUSTED_SPREAD) & (
        linear.bends <= TRUSTED_BEND * noise + TRUSTED_PART * spreads
    )
    blocked = ~(foretold & linear.valid) & (block.times > horizons[:, None])
    first_blocked = np.where(blocked, block.times, np.inf).min(axis=1)
    before = np.where(block.times < first_blocked[:, None], block.times, -np.inf).max(axis=1)
    return np.maximum(horizons, np.minimum(before, limits))


def misfit_starts(
    block: ObservationBlock,
    residuals: NDArray[np.float64],
    horizons: NDArray[np.float64],
    noise: float,
) -> NDArray[np.float64]:
    """Time (W,) s at which each fit begins to be none, infinite where it holds to its horizon.

    Parameters
    ----------
    residuals : (W, P, 3) m
    """
    inside = block.times <= horizons[:, None]
    lengths = np.linalg.norm(residuals, axis=2) / noise
    lengths = np.where(inside, np.nan_to_num(lengths, nan=np.inf), 0.0)
    order = np.argsort(np.where(inside, block.times, np.inf), axis=1, kind="stable")
    window = min(MISFIT_POINTS, order.shape[1])
    ordered = np.take_along_axis(lengths, order, axis=1)
    medians = np.median(np.lib.stride_tricks.sliding_window_view(ordered, window, axis=1), axis=2)
    begins = np.take_along_axis(np.where(inside, block.times, np.inf), order, axis=1)
    return np.where(medians > MISFIT, begins[:, : medians.shape[1]], np.inf).min(axis=1)


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
            first_horizons(block),
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
        starts = misfit_starts(block, residuals, self.horizons, noise)
        misfit = np.isfinite(starts)
        self.misfits = np.where(misfit, self.misfits + 1, 0)
        back = self.misfits >= PATIENCE
        self.misfits[back] = 0
        before = self.horizons
        self.horizons = np.where(misfit, before, goal)
        retreat = np.maximum(starts - RETREAT, first_horizons(block))
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
