"""Points at which objects were seen, whitened by their noise, cut into segments of time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_learner.cost.packed_observations import PackedObservations
from intuitive_physics_learner.joint_estimation.fit_horizons import FAILED_LENGTH
from intuitive_physics_learner.joint_estimation.joint_fit import JointFit
from intuitive_physics_learner.joint_estimation.normal_equations import robust_loss

RESTING_LOSS = 2.5
"""Mean loss of all later points about one place up to which it stays there: 1.5 of noise, and what
the place errs."""

FEWEST_POINTS = 3
"""Points over which the loss of a segment is averaged at least."""

TIME_ROUNDING = 1e-6
"""Error of stamps, s, by which a segment may be longer."""


def point_losses(
    whitening: NDArray[np.float64], offsets: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Losses (...,) of offsets (..., 3) m from points, 0 where there is none.

    `whitening` (..., 3, 3) 1/m, 0 where there is no point.
    """
    lengths = np.linalg.norm((whitening @ offsets[..., None])[..., 0], axis=-1)
    lengths = np.nan_to_num(lengths, nan=FAILED_LENGTH, posinf=FAILED_LENGTH)
    return np.where(whitening.any(axis=(-2, -1)), robust_loss(lengths), 0.0)


def mean_precisions(whitening: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean 1/σ² (...,) of the axes of points, by `whitening` (..., 3, 3) 1/m; 0 without a point."""
    return np.asarray((whitening**2).sum(axis=(-2, -1)) / 3.0)


@dataclass(frozen=True, eq=False)
class SeenPoints:
    """Points of A observations of O objects at up to T times, and what begins where fits stop.

    Parameters
    ----------
    times : (A, T) s, NaN beyond the last
    observed : (A, O, T, 3) m, without shared errors
    whitening : (A, O, T, 3, 3) 1/m, 0 where there is no point
    begin : (A,) column of the fit horizon
    """

    times: NDArray[np.float64]
    observed: NDArray[np.float64]
    whitening: NDArray[np.float64]
    begin: NDArray[np.int64]

    @staticmethod
    def of(fit: JointFit, group: PackedObservations, rows: NDArray[np.int64]) -> SeenPoints:
        """Take the estimate's shared errors out of what was observed; `rows` (A,) in the group."""
        observed, times = group.observed[rows].copy(), group.times[rows]
        whitening, begin = np.zeros((*observed.shape, 3)), np.zeros(rows.size, dtype=np.int64)
        place = {int(group.members[row]): a for a, row in enumerate(rows)}
        for block, fits in zip(fit.model.blocks, fit.estimate.fits, strict=True):
            moved = block.displaced(np.zeros((*block.times.shape, 3)), fits.estimate)
            for k, member in enumerate(block.members.tolist()):
                if member not in place:
                    continue
                a = place[member]
                points = group.points[rows[a]]
                points = points[points >= 0]
                where = (a, *np.divmod(points, times.shape[1]))
                observed[where] -= moved[k, : points.size]
                whitening[where] = block.whitening[k, : points.size]
                begin[a] = int((times[a] <= fits.horizons[k]).sum()) - 1
        return SeenPoints(times, observed, whitening, begin)

    @property
    def last(self) -> NDArray[np.int64]:
        """Column (A,) of the last time."""
        return np.isfinite(self.times).sum(axis=1) - 1

    def ends(self, begin: NDArray[np.int64], duration: float) -> NDArray[np.int64]:
        """Columns (A,) at which segments of a duration, in s, end that begin after columns (A,)."""
        start = self.starts(np.arange(begin.size), begin)[:, None]
        inside = (self.times <= start + duration + TIME_ROUNDING).sum(axis=1) - 1
        return np.minimum(np.maximum(inside, begin + 1), self.last)

    def starts(self, rows: NDArray[np.int64], begin: NDArray[np.int64]) -> NDArray[np.float64]:
        """Times (a,) in s of columns `begin` (a,) of `rows` (a,); 0 before the first, column -1."""
        return np.where(begin < 0, 0.0, self.times[rows, begin])

    def stays(self, row: int, column: int, places: NDArray[np.float64]) -> bool:
        """Whether an observation's objects stay at places (O, 3) in m after a column."""
        after = slice(column + 1, self.last[row] + 1)
        offsets = places[:, None] - self.observed[row, :, after]
        whitening = self.whitening[row, :, after]
        there = whitening.any(axis=(2, 3))
        lengths = np.linalg.norm((whitening @ offsets[..., None])[..., 0], axis=-1)[there]
        return bool(robust_loss(lengths).mean() < RESTING_LOSS)

    def segment(
        self, rows: NDArray[np.int64], begin: NDArray[np.int64], end: NDArray[np.int64]
    ) -> SeenPoints:
        """Return the points of `rows` (a,) after columns `begin` (a,) up to `end` (a,)."""
        columns = begin[:, None] + 1 + np.arange((end - begin).max())
        there = columns <= end[:, None]
        at = rows[:, None], np.where(there, columns, 0)
        observed = self.observed.swapaxes(1, 2)[at].swapaxes(1, 2)
        whitening = self.whitening.swapaxes(1, 2)[at].swapaxes(1, 2)
        return SeenPoints(
            np.where(there, self.times[at], np.nan),
            observed,
            whitening * there[:, None, :, None, None],
            self.begin[rows],
        )

    @property
    def precisions(self) -> NDArray[np.float64]:
        """Mean 1/σ² (a, O, C) of the axes of each point, 0 where there is none."""
        return mean_precisions(self.whitening)

    def losses(self, offsets: NDArray[np.float64]) -> NDArray[np.float64]:
        """Losses (a, K, O, C) of offsets (a, K, O, C, 3) m from the points."""
        return point_losses(self.whitening[:, None], offsets)
