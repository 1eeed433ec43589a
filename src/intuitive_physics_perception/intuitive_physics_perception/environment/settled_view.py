"""Settled readings of each pixel of a sensor that stands still, against those that were
modelled."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.kernels import entry
from intuitive_physics_perception.environment.noise import CHANGE_SIGMAS, RangeNoise

GONE_TIME = 0.5
"""Time for which one sees farther than before until what was there is gone, s: a reading that errs
is over by then."""

COME_TIME = 3.0
"""Time for which something nearer stays, and is no object, until it is a part of the environment,
s: people and hands seldom hold still that long."""

LOOK_EVERY = 0.25
"""Time, s, between two checks for changes: half of the shortest time of a change."""

CHANGED_PIXELS = 12.0
"""Side of a square of pixels that a change must fill: the face of a box of 4 cm, the smallest that
is modelled, at 1.7 m from a camera of 525 pixels focal length."""

OBJECT_MARGIN = 4
"""Pixels beside an object that are not taken for it."""

ROWS_APART = 4
"""Each frame updates every fourth row, in turn: what settles takes many frames, and a look at all
pixels would cost a frame four times as much."""

MAX_AVERAGED = 30
"""Readings that the mean of a settled pixel goes back to: its error is then below a fifth of that
of one reading, and it follows what drifts."""

MIN_LOOKS = 3
"""Equal readings that a settled pixel has at least: two may be equal by chance."""


class SettledView:
    """Mean readings of each pixel of an organised cloud, and the times since which they stay.

    A pixel is settled while its readings differ by no more than noise explains. Where nothing is
    read nothing is known, so missing readings neither settle a pixel nor unsettle it.

    `reference` (height, width, 3) m, what the environment was modelled from, NaN where nothing was
    read.
    """

    def __init__(self, reference: NDArray[np.float32], noise: RangeNoise) -> None:
        limits = np.append(noise.squares[:3], 2.0 * CHANGE_SIGMAS**2)
        self._limits = limits.astype(np.float32)
        self._reference = reference.copy()
        height, width = reference.shape[:2]
        self._means = np.full((height, width, 3), np.nan, dtype=np.float32)
        self._since = np.zeros((height, width), dtype=np.float64)
        self._counts = np.zeros((height, width), dtype=np.int32)
        self._next_row = 0
        self._next_look, self._changed_since = -np.inf, np.inf

    def take(
        self, points: NDArray[np.float32], time: float, objects: Sequence[NDArray[np.int64]]
    ) -> None:
        """Take a frame.

        `points` (height, width, 3) m, NaN where nothing was read; `time` in s; `objects` (n,)
        pixels of each object of the frame: they, and those beside them, show no part of the
        environment.
        """
        _take(points, self._means, self._since, self._counts, self._limits, time, self._next_row)
        self._next_row = (self._next_row + 1) % ROWS_APART
        height, width = points.shape[:2]
        for pixels in objects:
            if pixels.size:
                _unsettle(self._counts, pixels, height, width, OBJECT_MARGIN)

    def settled(self, time: float) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """Return what has settled elsewhere, and the reference where nothing has.

        What is farther than before is seen through what was there, which takes less time to believe
        than something nearer, which may go on again.

        `time` in s, of the last frame. Returns `points` (height, width, 3) m; `changed` (height,
        width) which of them have settled elsewhere than in the reference.
        """
        changed = self._changed(time, 1)
        return np.where(changed[:, :, None], self._means, self._reference), changed

    def has_changed(self, time: float) -> bool:
        """Return whether something of some size has settled elsewhere than in the reference.

        Edges that waver are one or two pixels wide, so a change must fill a square of pixels.

        `time` in s, of the last frame.
        """
        from scipy.ndimage import binary_erosion

        side = max(1, round(CHANGED_PIXELS / ROWS_APART))
        blobs = binary_erosion(self._changed(time, ROWS_APART), np.ones((side, side), dtype=bool))
        return bool(blobs.any())

    def must_be_modelled(self, time: float) -> bool:
        """Return whether something has changed, and all that has had time to settle.

        `time` in s, of the last frame.
        """
        if time < self._next_look:
            return False
        self._next_look = time + LOOK_EVERY
        if not self.has_changed(time):
            self._changed_since = np.inf
            return False
        self._changed_since = min(self._changed_since, time)
        return time - self._changed_since >= GONE_TIME

    def take_reference(self, points: NDArray[np.float32], time: float) -> None:
        """Take a new reference, from which the environment is modelled again.

        `points` (height, width, 3) m, NaN where nothing was read; `time` in s, of the last frame.
        """
        self._reference = points.copy()
        self._next_look, self._changed_since = time + GONE_TIME, np.inf

    def restart(self) -> None:
        """Forget since when readings have stayed; the reference remains."""
        self._counts[:] = 0
        self._next_look, self._changed_since = -np.inf, np.inf

    def _changed(self, time: float, stride: int) -> NDArray[np.bool_]:
        """Mark, of every `stride`-th pixel both ways, those that have settled elsewhere."""
        means, known, since, counts = (
            array[::stride, ::stride]
            for array in (self._means, self._reference, self._since, self._counts)
        )
        range2, known2, change2 = (
            np.einsum("vui,vui->vu", offsets, offsets) for offsets in (means, known, means - known)
        )
        is_settled = (counts >= MIN_LOOKS) & (since <= time - GONE_TIME)
        is_settled &= (range2 > known2) | (since <= time - COME_TIME)
        constant, quadratic, limit, sigmas2 = self._limits
        variance = np.minimum(constant + quadratic * range2 * range2, limit)
        # NaN compares false: where nothing was known something nearer than all has come.
        return np.asarray(is_settled & ~(change2 <= sigmas2 * variance))


@entry
def _take(
    points: Any, means: Any, since: Any, counts: Any, limits: Any, time: float, first: int
) -> None:
    """Go on with the means of pixels whose readings stay; start again where they do not."""
    for v in range(first, points.shape[0], ROWS_APART):
        for u in range(points.shape[1]):
            x, y, z = points[v, u, 0], points[v, u, 1], points[v, u, 2]
            if np.isnan(z):
                continue
            n = counts[v, u]
            if n > 0:
                mx, my, mz = means[v, u, 0], means[v, u, 1], means[v, u, 2]
                range2 = mx * mx + my * my + mz * mz
                variance = min(limits[0] + limits[1] * range2 * range2, limits[2])
                # The same ray, so the difference of the points is that of the ranges.
                change2 = (x - mx) ** 2 + (y - my) ** 2 + (z - mz) ** 2
                if change2 <= limits[3] * variance:
                    n = min(n + 1, MAX_AVERAGED)
                    counts[v, u] = n
                    means[v, u, 0] = mx + (x - mx) / n
                    means[v, u, 1] = my + (y - my) / n
                    means[v, u, 2] = mz + (z - mz) / n
                    continue
            counts[v, u] = 1
            since[v, u] = time
            means[v, u, 0], means[v, u, 1], means[v, u, 2] = x, y, z


@entry
def _unsettle(counts: Any, pixels: Any, height: int, width: int, margin: int) -> None:
    """Let pixels (n,) and those up to `margin` beside them start again."""
    for pixel in pixels:
        v, u = pixel // width, pixel % width
        for i in range(max(0, v - margin), min(height, v + margin + 1)):
            for j in range(max(0, u - margin), min(width, u + margin + 1)):
                counts[i, j] = 0
