"""Flights of table-tennis balls whose spin a camera measured.

Time stamps of the set jitter by some milliseconds, in which a ball flies some centimetres. The
images were taken at even times: how many frames lie between two rows follows from the ball's way.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.observation import Observation
from intuitive_physics.validation import finite_array, positive_float
from intuitive_physics_experiments.recorded_sets.table_tennis import (
    VACUUM,
    ball_in_air,
    flight_observation,
    table_at,
)
from intuitive_physics_recordings.npz_file import Arrays, split_rows

FEWEST_ROWS = 12  # Rows of the shortest recording that becomes a flight

# m, at most, of the ball's centre from 0 in the lowest row of a bounce: the table is there.
BOUNCE_HEIGHT = 0.03

BOUNCE_NEIGHBOURS = 3  # Rows on either side of the lowest one, all above it
LONGEST_GAP = 0.03  # s; after a longer one, what is seen may be another ball, or one that was hit
SPEED_STEPS = 5  # Steps on either side whose median is the ball's way in one frame


@dataclass(frozen=True, eq=False)
class SpinFlight:
    """One flight."""

    name: str  # unique in its set
    times: NDArray[np.float64]  # (n,) s, of the images, from 0
    stamps: NDArray[np.float64]  # (n,) s, as recorded, from 0
    positions: NDArray[np.float64]  # (n, 3) m, of the ball's centre; some rows may be no ball
    spin: NDArray[np.float64]  # (3,) rad/s, before the bounce, as a camera measured it
    bounce: int | None  # lowest row of the first bounce on the table; None where there is none


def spin_flights(arrays: Arrays) -> list[SpinFlight]:
    """Flights of a set; recordings of fewer than `FEWEST_ROWS` rows are left out.

    The arrays are `time` (n,) s, `position` (n, 3) m, `offsets` (k + 1,), `spin` (k, 3) rad/s,
    `radius` m and `mass` kg.
    """
    positive_float(arrays["radius"], "radius")
    positive_float(arrays["mass"], "mass")
    stamps, positions = split_rows(arrays, "time"), split_rows(arrays, "position")
    spins = finite_array(arrays["spin"], "spin", (len(stamps), 3))
    rows = [_unbroken(*recording) for recording in zip(stamps, positions, strict=True)]
    kept = [i for i, (since, _) in enumerate(rows) if len(since) >= FEWEST_ROWS]
    frames = {i: frame_numbers(*rows[i]) for i in kept}
    period = _common_period([(rows[i][0], frames[i]) for i in kept])
    return [
        SpinFlight(
            f"flight_{i:03d}",
            frames[i] * period,
            rows[i][0],
            rows[i][1],
            spins[i],
            _first_bounce(rows[i][1][:, 2]),
        )
        for i in kept
    ]


def spin_flight_observations(arrays: Arrays) -> list[Observation]:
    """Observations of the flights; those without enough free flight are left out."""
    radius = positive_float(arrays["radius"], "radius")
    environment, ball = table_at(-radius), ball_in_air(radius, VACUUM)
    observations = [
        flight_observation(flight.name, flight.times, flight.positions, environment, ball)
        for flight in spin_flights(arrays)
    ]
    return [observation for observation in observations if observation is not None]


def frame_numbers(
    stamps: NDArray[np.float64], positions: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Number the frames (n,) of rows by stamps (n,) s and positions (n, 3) m, increasing from 0.

    The ball's way since the row before, over its way in one frame around that, is a whole number.
    Where the stamps give another number that differs by more than one, it is taken instead.
    """
    steps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    elapsed = np.diff(stamps)
    period = max(float(np.median(elapsed)), 1e-9)
    before = [float(np.median(steps[: SPEED_STEPS + 1]))]
    counts = np.ones_like(steps)
    for i, step in enumerate(steps):
        after = steps[i + 1 : i + 1 + SPEED_STEPS]
        ways = [np.median(before[-SPEED_STEPS:]), *([np.median(after)] if after.size else [])]
        by_way = np.rint(step / max(float(np.mean(ways)), 1e-9))
        by_stamp = elapsed[i] / period
        counts[i] = max(by_way if abs(by_way - by_stamp) <= 1.0 else np.rint(by_stamp), 1.0)
        before.append(step / counts[i])
    return np.concatenate([[0.0], np.cumsum(counts)])


def _unbroken(
    stamps: NDArray[np.float64], positions: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The rows before the first long gap, with times from 0."""
    elapsed = np.diff(stamps)
    if (elapsed < 0.0).any():
        at = int((elapsed < 0.0).argmax())
        raise InvalidInputError(
            f"time goes from {stamps[at]:.9g} to {stamps[at + 1]:.9g} s in one recording; "
            "expected times that never go back"
        )
    gaps = np.flatnonzero(elapsed > LONGEST_GAP)
    end = int(gaps[0]) + 1 if gaps.size else len(stamps)
    return stamps[:end] - stamps[0], positions[:end]


def _common_period(
    recordings: Sequence[tuple[NDArray[np.float64], NDArray[np.float64]]],
) -> float:
    """s between frames: the median over recordings of the stamps' slope over frame numbers."""
    slopes = [float(np.polyfit(frames, stamps, 1)[0]) for stamps, frames in recordings]
    if not slopes:
        return 1.0
    return positive_float(float(np.median(slopes)), "time between frames")


def _first_bounce(heights: NDArray[np.float64]) -> int | None:
    for k in range(BOUNCE_NEIGHBOURS, len(heights) - BOUNCE_NEIGHBOURS):
        around = heights[k - BOUNCE_NEIGHBOURS : k + BOUNCE_NEIGHBOURS + 1]
        if abs(heights[k]) <= BOUNCE_HEIGHT and heights[k] == around.min():
            return k
    return None
