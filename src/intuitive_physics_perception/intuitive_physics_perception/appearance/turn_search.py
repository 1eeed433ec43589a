"""Searches the spins under which all images of a flight go together, over all rotations."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from intuitive_physics_perception.appearance.registration import (
    add_scores,
    best_apart,
    joint_scores,
)
from intuitive_physics_perception.appearance.sphere_image import GRID_CELLS, SphereImage, pitch_of

MAX_SPIN = 150.0
"""Fastest angular velocity that is looked for; more than half a turn from frame to frame, 94 rad/s
at 30 Hz, looks like a turn the other way, rad/s."""

SEARCH_STEP = 0.3
"""Distance of the rotations from one image to another that are tried, rad."""

MIN_CONTRAST = 2.5
"""Standard deviation of the brightness of a surface, less shading, in those of the noise of a
pixel, below which it is plain."""

LARGEST_SEARCHED = 2.9
"""Largest turn from frame to frame, rad: a little less than half a turn, which has two
directions."""

LAGS = 4
"""Images that far apart in order are compared. What turns by a third of a turn from one frame to
the next shows the same side in every third."""

FINER = 3
"""Times by which the spins that are tried are closer together than the rotations, for the image
that is `LAGS` later."""

UNEVEN = 0.1
"""Intervals by which the time between two images may differ from a whole number of them."""

APART = 0.3
"""Smallest difference of returned spins, rad from frame to frame."""


class TurnSearch:
    """Agreement of the images of a flight, for each of many constant spins.

    What two images that are some intervals apart say of the rotation between them is kept for all
    rotations, one table for each number of intervals. A spin is at one place in each table.

    `duration` in s, from one frame to the next.
    """

    def __init__(self, duration: float) -> None:
        self.duration = duration
        self._rotations, turns, places = turn_tables(SEARCH_STEP)
        count = np.searchsorted(np.linalg.norm(turns, axis=1), MAX_SPIN * duration)
        self._turns, self._places = turns[:count], places[:count]
        self._pitch = 2.0 * pitch_of(GRID_CELLS)
        self._scores = np.zeros((LAGS, len(self._rotations)))

    def add(self, times: Sequence[float], images: Sequence[SphereImage]) -> None:
        """Compare the last image with those before it.

        `times` (k,) s; `images` (k,) at these times.
        """
        newest = images[-1]
        for time, image in zip(times[:-1], images[:-1], strict=True):
            intervals = (times[-1] - time) / self.duration
            lag = round(intervals)
            # Two sides without a pattern say nothing.
            shown = max(image.contrast, newest.contrast) >= MIN_CONTRAST
            if shown and 1 <= lag <= LAGS and abs(intervals - lag) < UNEVEN:
                # A R Bᵀ of all rotations, by rows: (A ⊗ B) times the rows of R.
                both = np.kron(image.axes, newest.axes)
                ways = (self._rotations.reshape(-1, 9) @ both.T).reshape(-1, 3, 3)
                scores = self._scores[lag - 1]
                add_scores(image.coarse, newest.coarse, ways, self._pitch, scores)

    def best(self, count: int) -> list[NDArray[np.float64]]:
        """Return some spins (3,) rad/s with most evidence, apart from one another."""
        joint = joint_scores(self._scores, self._places)
        chosen = best_apart(joint, self._turns, APART, count)
        return [self._turns[k] / self.duration for k in chosen if k >= 0]


@lru_cache(maxsize=4)
def turn_tables(step: float) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int32]]:
    """Return rotations, spins, and where in the rotations they lead.

    `step` in rad between neighbouring rotations. Returns `rotations` (m, 3, 3), as good as all
    there are, from a later image to an earlier one; `turns` (n, 3) rad in one interval, `FINER`
    times as close, slow ones first; `places` (n, LAGS), index of the rotation in each number of
    intervals.
    """
    vectors = ball_of_turns(step, np.pi + step)
    turns = ball_of_turns(step / FINER, LARGEST_SEARCHED)
    turns = turns[np.argsort(np.linalg.norm(turns, axis=1))]
    half = int((np.pi + step) / step)
    index = np.full((2 * half + 1,) * 3, -1, np.int32)
    index[tuple(np.rint(vectors / step).astype(int).T + half)] = np.arange(len(vectors))
    angle = np.linalg.norm(turns, axis=1)
    places = np.empty((len(turns), LAGS), np.int32)
    for lag in range(1, LAGS + 1):
        whole = np.floor(lag * angle / (2.0 * np.pi) + 0.5)
        short = turns * (lag - 2.0 * np.pi * whole / np.maximum(angle, 1e-9))[:, None]
        places[:, lag - 1] = index[tuple(np.rint(short / step).astype(int).T + half)]
    used, renumbered = np.unique(places, return_inverse=True)
    rotations = Rotation.from_rotvec(-vectors[used]).as_matrix()
    return rotations, turns, renumbered.reshape(-1, LAGS).astype(np.int32)


def ball_of_turns(step: float, largest: float) -> NDArray[np.float64]:
    """Return rotation vectors (n, 3) rad on a grid, up to a largest angle."""
    count = int(largest / step)
    line = step * np.arange(-count, count + 1)
    grid = np.stack(np.meshgrid(line, line, line, indexing="ij"), axis=-1).reshape(-1, 3)
    return np.ascontiguousarray(grid[np.linalg.norm(grid, axis=1) <= largest])
