"""Perceived balls against the truth: errors, recall and false positives."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from benchmarks.perception.truth import TrueBall

ENOUGH_PIXELS = 60  # visible pixels from which on a ball counts for the recall
NEAR = 2.0  # m, up to which the bar of position holds

Ball = tuple[NDArray[np.float64], float]  # centre (3,) m in the sensor's frame and radius in m


@dataclass(frozen=True)
class Hit:
    """A true ball that was found."""

    size: float  # true radius, m
    distance: float  # m from the sensor
    position_error: float  # m
    radius_error: float  # m, found less true


@dataclass
class Score:
    """Counts and errors over frames."""

    frames: int = 0
    visible: int = 0  # balls with at least `ENOUGH_PIXELS`, over all frames
    found: int = 0  # visible balls that were found
    false: int = 0  # balls that were found where there is none
    hits: list[Hit] = field(default_factory=list)  # all balls that were found

    @property
    def recall(self) -> float:
        """Part of the balls with enough pixels that was found."""
        return self.found / self.visible if self.visible else float("nan")

    @property
    def false_positives_per_1000(self) -> float:
        """False balls in 1,000 frames."""
        return 1000.0 * self.false / self.frames if self.frames else float("nan")

    def add(self, found: Iterable[Ball], truth: Sequence[TrueBall]) -> list[tuple[int, int]]:
        """Add one frame; return pairs of indices (found, true) that belong together.

        A true ball is found by the nearest that lies within its radius; all others are false.
        """
        balls = list(found)
        pairs = matched(balls, truth)
        self.frames += 1
        self.false += len(balls) - len(pairs)
        self.visible += sum(ball.pixels >= ENOUGH_PIXELS for ball in truth)
        for k, n in pairs:
            (center, radius), true = balls[k], truth[n]
            self.found += true.pixels >= ENOUGH_PIXELS
            error = float(np.linalg.norm(center - true.position))
            self.hits.append(Hit(true.radius, true.distance, error, radius - true.radius))
        return pairs

    def near_hits(self, size: float | None = None) -> list[Hit]:
        """Hits up to `NEAR`, of one size or of all."""
        return [
            hit for hit in self.hits if hit.distance <= NEAR and (size is None or hit.size == size)
        ]


def matched(found: Sequence[Ball], truth: Sequence[TrueBall]) -> list[tuple[int, int]]:
    """Pairs of indices (found, true), nearest first, each used once."""
    distances = sorted(
        (float(np.linalg.norm(center - ball.position)), k, n)
        for k, (center, _) in enumerate(found)
        for n, ball in enumerate(truth)
    )
    pairs: list[tuple[int, int]] = []
    for distance, k, n in distances:
        if distance < truth[n].radius and all(k != a and n != b for a, b in pairs):
            pairs.append((k, n))
    return pairs


def rms(values: Iterable[float]) -> float:
    """Root of the mean square, NaN of nothing."""
    array = np.fromiter(values, dtype=np.float64)
    return float(np.sqrt(np.mean(np.square(array)))) if array.size else float("nan")
