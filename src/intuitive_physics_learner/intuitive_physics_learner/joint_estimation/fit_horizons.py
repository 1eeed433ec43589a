"""Fit horizons: the time span of each trajectory that is fitted, advanced step by step.

Motion among contacts is chaotic. Where the estimate leaves open on which edge a box lands, slopes
say nothing about what comes after, and a fit to it would end in one of many local optima. So a fit
begins with a few points and includes more as far as the posterior of the present estimate predicts
them. Where a fit fails nevertheless, its horizon retreats to before the failure.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.stats import binom, chi

from intuitive_physics_learner.joint_estimation.linearisation import Linearisation
from intuitive_physics_learner.joint_estimation.normal_equations import robust_loss
from intuitive_physics_learner.joint_estimation.observation_blocks import ObservationBlock
from intuitive_physics_learner.search.plain_state import Resumable

LARGEST_STATE_DEVIATION = 0.3
"""Standard deviation of a component of an initial state (m, m/s, rad or rad/s) that the first
finite differences assume at most; set by hand."""

FIRST_POINTS = 10
"""Points of each object that the first fit horizon includes at most; set by hand."""

FIRST_DURATION = 0.5
"""Largest first fit horizon, s; set by hand."""

LARGEST_SPREAD = 0.15
"""Standard deviation of a predicted position up to which it may enter the fit, m; set by hand."""

LARGEST_BEND = 2.0
"""Linearisation error of a predicted position up to which it may enter the fit, σ; set by hand."""

LARGEST_BEND_SHARE = 1.0
"""Linearisation error that is allowed beyond `LARGEST_BEND`, a part of the standard deviation of
the predicted position; set by hand."""

MISFIT_FALSE_ALARM = 1e-3
"""Misfits that noise alone is expected to feign in one observation: fewer than one in the hundreds
of observations of a large set."""

MISFIT_POINTS = 9
"""Neighbouring points whose median length is compared with that of noise; set by hand."""

RETREAT = 0.3
"""Time before its first misfit to which a fit horizon retreats, s; set by hand."""

MOST_RETREATS = 2
"""Retreats of a fit horizon that never gets farther meanwhile, after which it advances no more: it
would advance and retreat for ever, and each time it moves the estimate; set by hand."""

FAILED_LENGTH = 1e4
"""Length of the residual, in σ of the noise, of a point that the simulator did not reach: finite,
so that losses can be compared, and longer than those of fits."""


@dataclass(eq=False)
class TrajectoryFits(Resumable):
    """The initial states and fit horizons of a block's W observations.

    Parameters
    ----------
    estimate : (W, d) nuisance parameters: deviations from the observed initial states, in SI units,
        and amounts of shared errors
    deviations : (W, d) standard deviation of each, in SI units
    horizons : (W,) s, the last time of each observation that is fitted
    misfits : (W,) whether each had a misfit in the last step
    farthest : (W,) s, the largest horizon that each has had
    retreats : (W,) how often each has retreated since
    """

    estimate: NDArray[np.float64]
    deviations: NDArray[np.float64]
    horizons: NDArray[np.float64]
    misfits: NDArray[np.bool_]
    farthest: NDArray[np.float64]
    retreats: NDArray[np.int64]

    remembered = ("estimate", "deviations", "horizons", "misfits", "farthest", "retreats")

    @staticmethod
    def initial(block: ObservationBlock) -> TrajectoryFits:
        """Return the observed initial states with the first horizons."""
        count = block.members.size
        return TrajectoryFits(
            np.zeros_like(block.prior_deviations),
            np.minimum(block.prior_deviations, LARGEST_STATE_DEVIATION),
            first_horizons(block),
            np.zeros(count, dtype=bool),
            np.zeros(count),
            np.zeros(count, dtype=np.int64),
        )

    def losses(
        self,
        block: ObservationBlock,
        estimates: NDArray[np.float64],
        residuals: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """Losses (c, W) up to the horizons; `estimates` (c, W, d), `residuals` (c, W, P, 3) m."""
        lengths = np.linalg.norm(block.whitened(residuals), axis=3)
        lengths = np.nan_to_num(lengths, nan=FAILED_LENGTH, posinf=FAILED_LENGTH)
        counted = block.times <= self.horizons[:, None]
        fit = (robust_loss(lengths) * counted).sum(axis=2)
        return fit + 0.5 * ((estimates / block.prior_deviations) ** 2).sum(axis=2)

    def draws(
        self, generator: np.random.Generator, covariances: NDArray[np.float64], count: int
    ) -> NDArray[np.float64]:
        """Draw nuisance parameters (count, W, d), first the estimate; `covariances` (W, d, d)."""
        values, vectors = np.linalg.eigh(covariances)
        factors = vectors * np.sqrt(np.maximum(values, 0.0))[:, None]
        normal = generator.normal(size=(count, *self.estimate.shape))
        normal[0] = 0.0
        return np.asarray(self.estimate + np.einsum("wij,cwj->cwi", factors, normal))

    def advance(
        self, block: ObservationBlock, residuals: NDArray[np.float64], goals: NDArray[np.float64]
    ) -> bool:
        """Move horizons to `goals` (W,) s, or before a misfit in `residuals` (W, P, 3) m.

        One that has retreated `MOST_RETREATS` times and got no farther stays. Returns whether any
        horizon got farther than before.
        """
        starts = self.note_misfits(block, residuals)
        self.retreats[self.misfits] += 1
        before = self.horizons
        self.horizons = np.where(self.retreats >= MOST_RETREATS, before, goals)
        retreat = np.maximum(starts - RETREAT, first_horizons(block))
        self.horizons = np.where(self.misfits, np.minimum(retreat, before), self.horizons)
        farther = self.horizons > self.farthest
        self.retreats[farther] = 0
        self.farthest = np.maximum(self.farthest, self.horizons)
        return bool(farther.any())

    def note_misfits(
        self, block: ObservationBlock, residuals: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Note which fits fail by residuals (W, P, 3) m; return `misfit_starts` (W,) s."""
        starts = misfit_starts(block, residuals, self.horizons)
        self.misfits = np.isfinite(starts)
        return starts


def first_horizons(block: ObservationBlock) -> NDArray[np.float64]:
    """Return the first horizons (W,) s of a fit: up to the first points, or the first time."""
    ordered = np.sort(block.times, axis=1)
    counts = np.isfinite(ordered).sum(axis=1)
    last = np.minimum(FIRST_POINTS * block.initial_states.objects, counts) - 1
    return np.minimum(ordered[np.arange(last.size), last], FIRST_DURATION)


def farthest_horizons(
    block: ObservationBlock, horizons: NDArray[np.float64], largest_advance: float
) -> NDArray[np.float64]:
    """Return the times (W,) in s that horizons (W,) in s can reach in one step."""
    return np.minimum(horizons + largest_advance, block.durations)


def advanced_horizons(
    block: ObservationBlock,
    linear: Linearisation,
    spreads: NDArray[np.float64],
    horizons: NDArray[np.float64],
    largest_advance: float,
) -> NDArray[np.float64]:
    """Include points, in the order of time, up to the first one that cannot be predicted.

    `spreads` (W, P) m, standard deviation of the predicted positions, which must be small, as must
    linearisation errors; `horizons` (W,) s, the present ones. Returns (W,) s, never below these.
    """
    allowed = LARGEST_BEND * block.noise + LARGEST_BEND_SHARE * spreads
    straight = linear.bends <= allowed
    predictable = (spreads <= LARGEST_SPREAD) & straight
    blocked = ~(predictable & linear.valid) & (block.times > horizons[:, None])
    first_blocked = np.where(blocked, block.times, np.inf).min(axis=1)
    before = np.where(block.times < first_blocked[:, None], block.times, -np.inf).max(axis=1)
    limits = farthest_horizons(block, horizons, largest_advance)
    return np.maximum(horizons, np.minimum(before, limits))


@cache
def misfit_length(window: int, points: int, false_alarm: float) -> float:
    """Return the median length of neighbouring residuals, in σ, that noise hardly exceeds.

    The length of a normal residual exceeds c σ with probability p = P(χ₃ > c). The median of n
    neighbours can only exceed it where ⌈n/2⌉ of them do, which is binomial, and `points` hold
    points / n windows without a common point: c is where the expected number of such windows is
    the rate of false alarms.
    """
    needed = (window + 1) // 2
    rate = false_alarm * window / max(points, window)
    share = brentq(lambda p: binom.sf(needed - 1, window, p) - rate, 0.0, 1.0)
    return float(chi(3).isf(share))


def misfit_starts(
    block: ObservationBlock, residuals: NDArray[np.float64], horizons: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the time (W,), in s, at which each fit begins to fail; infinite where it does not.

    `residuals` (W, P, 3) m, of the present estimate; `horizons` (W,) s; later points do not count.
    """
    inside = block.times <= horizons[:, None]
    lengths = np.linalg.norm(block.whitened(residuals), axis=2)
    lengths = np.where(inside, np.nan_to_num(lengths, nan=np.inf), 0.0)
    order = np.argsort(np.where(inside, block.times, np.inf), axis=1, kind="stable")
    window = min(MISFIT_POINTS, order.shape[1])
    ordered = np.take_along_axis(lengths, order, axis=1)
    medians = np.median(np.lib.stride_tricks.sliding_window_view(ordered, window, axis=1), axis=2)
    begins = np.take_along_axis(np.where(inside, block.times, np.inf), order, axis=1)
    failing = medians > misfit_length(window, order.shape[1], MISFIT_FALSE_ALARM)
    return np.where(failing, begins[:, : medians.shape[1]], np.inf).min(axis=1)
