"""How well engines keep known laws at a step of 10 ms: bounce heights, and sliding into rolling."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers.engine import Engine
from benchmarks.scenes import TIME_STEP, Instance, dropped, pushed

PEAKS = 2  # bounces of a drop whose heights are compared
DROP_STEPS = 300  # steps of a drop; the slowest drop's second peak is at 2.3 s
PUSH_STEPS = 150  # steps of a push; sliding ends after 0.22 s
PUSH_SPEED, PUSH_FRICTION = 3.0, 0.4  # m/s and μ of a push


@dataclass(frozen=True)
class Accuracy:
    """Relative errors of one engine; those of a known drop and of rolling are signed."""

    known_drop: tuple[float, float]  # of both peaks of a drop from 1 m with e = 0.7
    first_median: float  # over random drops, of the first peak
    first_p95: float
    drop_median: float  # the same of the worse of both peaks
    drop_p95: float
    rolling: float  # of the end speed of a sliding ball against 5/7 v₀


def accuracy(engine: Engine, drops: int, rng: np.random.Generator) -> Accuracy:
    """Measure an engine on `drops` random drops: 0.3 to 2 m high, e from 0.3 to 0.9."""
    heights, restitutions = rng.uniform(0.3, 2.0, drops), rng.uniform(0.3, 0.9, drops)
    drawn = zip(heights, restitutions, strict=True)
    errors = np.abs([peak_errors(engine, h, e) for h, e in drawn])
    worst = errors.max(axis=1)
    first, second = peak_errors(engine, 1.0, 0.7)
    return Accuracy(
        known_drop=(float(first), float(second)),
        first_median=float(np.median(errors[:, 0])),
        first_p95=float(np.percentile(errors[:, 0], 95)),
        drop_median=float(np.median(worst)),
        drop_p95=float(np.percentile(worst, 95)),
        rolling=rolling_error(engine),
    )


def peak_errors(engine: Engine, height: float, restitution: float) -> NDArray[np.float64]:
    """Return the relative errors of the first PEAKS peaks, whose heights are e^(2k) h."""
    instance = dropped(height, restitution)
    heights = _trajectory(engine, instance, DROP_STEPS)[:, 2] - instance.shapes[0].bounding_radius
    expected = height * restitution ** (2 * np.arange(1, PEAKS + 1))
    return peak_heights(heights) / expected - 1.0


def peak_heights(heights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the first PEAKS peaks after bounces; 0 where there is none.

    A peak is that of the parabola through the highest sample and its neighbours, which is exact
    in free flight, however coarse the samples.
    """
    peaks = np.zeros(PEAKS)
    rising = np.diff(heights) > 0.0
    at = 0
    for k in range(PEAKS):
        rises = np.flatnonzero(rising[at:])
        if rises.size == 0:
            break
        at += int(rises[0])
        falls = np.flatnonzero(~rising[at:])
        if falls.size == 0:
            break
        at += int(falls[0])
        before, top, after = heights[at - 1 : at + 2]
        curvature = before - 2.0 * top + after
        peaks[k] = top - (before - after) ** 2 / (8.0 * curvature) if curvature < 0.0 else top
    return peaks


def rolling_error(engine: Engine) -> float:
    """Return the relative error of a pushed ball's end speed against 5/7 v₀.

    A ball that slides loses speed until v = ω r; friction acts at the floor, so that the angular
    momentum about a point of it stays m v₀ r = m v r + 2/5 m r² ω: v = 5/7 v₀.
    """
    x = _trajectory(engine, pushed(PUSH_SPEED, PUSH_FRICTION), PUSH_STEPS)[:, 0]
    last = PUSH_STEPS // 3
    speed = (x[-1] - x[-1 - last]) / (last * TIME_STEP)
    return float(speed / (5.0 / 7.0 * PUSH_SPEED) - 1.0)


def _trajectory(engine: Engine, instance: Instance, steps: int) -> NDArray[np.float64]:
    with engine.prepare(instance, steps, TIME_STEP) as world:
        return world.predict().positions[0, 0]
