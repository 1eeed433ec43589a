"""Many frames of a sensor that stands still, made one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_perception.settings import PerceptionSettings

MAX_FUSED_POINTS = 24000
"""Points of the fused frame in which planes are searched for: bounds time and memory."""

MAX_EDGE_POINTS = 80000
"""Points of the fused frame in which edges of planes and static boxes, both finer than planes, are
searched for: bounds time and memory."""


def fuse(
    frames: Sequence[NDArray[np.float32]],
    settings: PerceptionSettings,
    rng: np.random.Generator,
    most: int = MAX_FUSED_POINTS,
) -> NDArray[np.float64]:
    """Return points in range (n, 3) m, at most `most`, of all frames; see `fused_frame`.

    `frames` (height, width, 3) m each.
    """
    points = fused_frame(frames, most).reshape(-1, 3)
    ranges = np.linalg.norm(points, axis=1)
    points = points[(ranges >= settings.min_range) & (ranges <= settings.max_range)]
    if len(points) > most:
        points = points[rng.choice(len(points), most, replace=False)]
    return points


def fused_frame(
    frames: Sequence[NDArray[np.float32]], most: int = MAX_FUSED_POINTS
) -> NDArray[np.float64]:
    """Return one frame of points (height, width, 3) m, fused from many.

    Frames of one organised size are fused by the median of each pixel, which averages noise and
    drops what moves, and thinned to `most` pixels; others are joined to a height of 1.

    `frames` (height, width, 3) m each; `most`: pixels of the fused frame at most.
    """
    if len({frame.shape for frame in frames}) > 1 or frames[0].shape[0] == 1:
        return np.concatenate([frame.reshape(1, -1, 3) for frame in frames], axis=1).astype(
            np.float64
        )
    height, width = frames[0].shape[:2]
    stride = max(1, int(np.ceil(np.sqrt(height * width / most))))
    stack = np.stack([frame[::stride, ::stride] for frame in frames])
    return _pixel_medians(stack.reshape(len(frames), -1, 3)).reshape(stack.shape[1:])


def _pixel_medians(stack: NDArray[np.float32]) -> NDArray[np.float64]:
    """Median reading of each pixel, (n_pixels, 3) of (n_frames, n_pixels, 3), seen in at least half
    of the frames; else NaN."""
    squares = np.einsum("fpi,fpi->fp", stack, stack)
    counts = np.isfinite(squares).sum(axis=0)
    # NaN sorts to the end, so the median of what was seen stands at half its count. Of an even
    # number it is the mean of two: the farther one of eight lies 0.15 standard deviations too far.
    order = np.argsort(squares, axis=0)
    middle = np.stack([(counts - 1).clip(min=0) // 2, (counts // 2).clip(max=len(stack) - 1)])
    chosen = np.take_along_axis(order, middle, axis=0)
    medians = stack[chosen, np.arange(stack.shape[1])].mean(axis=0, dtype=np.float64)
    medians[2 * counts < len(stack)] = np.nan
    return medians
