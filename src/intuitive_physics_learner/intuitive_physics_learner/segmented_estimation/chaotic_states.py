"""States of objects that move chaotically: changes, spreads, and what a rollout ends in.

A change of a state has the twelve components of its covariance: of position (m), turn (rad, about
the environment's axes), velocity (m/s) and spin (rad/s).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.frames.change_of_frame import CONJUGATE
from intuitive_physics.geometry.rotations import quaternion_product, rotate_quaternions
from intuitive_physics.simulation import Rollout, Simulator, WorldBatch, WorldStatus

SPREADS = (0.004, 0.06, 0.05, 1.0)
"""Standard deviations by which states are spread at the start of a segment, of position (m), turn
(rad), velocity (m/s) and spin (rad/s); set by hand on the sets of seeds 100 to 105 and 130 to
137."""

CHANGE_SPREADS = np.repeat(SPREADS, 3)
"""The same of each component of a change, (12,)."""

CHAOTIC_SPEED = 0.5
"""Speed of the centre and of the surface together from which on jumps are as large as these, m/s;
set by hand."""

SMALLEST_SCALE = 0.01
"""Part of the jumps that is left to what rests: none would leave no room for rounding."""

RESTING_SPEED = 0.1
"""Mean speed of all motions of an object below which it may have come to rest, m/s; set by hand."""

VELOCITY_STEP = 1e-4
"""Time over which velocities are differences of positions, s."""

TEMPER = 2.0
"""Loss by which a motion is drawn again e times less often: by the likelihood itself a few motions
would be left of hundreds; set by hand."""


def moved(states: NDArray[np.float64], changes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return states (..., 13) after changes (..., 12), which broadcast."""
    after = states + np.concatenate(
        [changes[..., :3], np.zeros_like(changes[..., :4]), changes[..., 6:]], axis=-1
    )
    after[..., 3:7] = rotate_quaternions(after[..., 3:7], changes[..., 3:6])
    return after


def change(after: NDArray[np.float64], before: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the changes (..., 12) from states `before` (..., 13) to states `after` (..., 13)."""
    shape = np.broadcast_shapes(after.shape, before.shape)[:-1]
    changes = np.empty((*shape, 12))
    changes[..., :3] = after[..., :3] - before[..., :3]
    changes[..., 6:] = after[..., 7:] - before[..., 7:]
    turned = quaternion_product(after[..., 3:7], before[..., 3:7] * CONJUGATE)
    sines = np.sqrt(np.einsum("...i,...i->...", turned[..., :3], turned[..., :3]))
    # Of the two quaternions of a rotation that of the smaller angle.
    angles = 2.0 * np.arctan2(sines, np.abs(turned[..., 3]))
    per_sine = np.divide(angles, sines, out=np.full(shape, 2.0), where=sines > 0.0)
    factors = np.where(turned[..., 3] < 0.0, -1.0, 1.0) * per_sine
    changes[..., 3:6] = factors[..., None] * turned[..., :3]
    return changes


def surface_speeds(states: NDArray[np.float64], radii: NDArray[np.float64]) -> NDArray[np.float64]:
    """Speeds (...,) of the centre and of the surface together, m/s.

    `states` (..., 13); `radii` (...,) m of their bounding spheres.
    """
    squares = states[..., 7:13] ** 2
    return np.sqrt(squares[..., :3].sum(axis=-1)) + radii * np.sqrt(squares[..., 3:].sum(axis=-1))


def chaos_scales(speeds: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the part (...,) of the spreads that objects of such speeds (...,) in m/s have."""
    return np.clip(np.nan_to_num(speeds) / CHAOTIC_SPEED, SMALLEST_SCALE, 1.0)


def drawn_again(
    losses: NDArray[np.float64], failed: NDArray[np.bool_], generator: np.random.Generator
) -> NDArray[np.int64]:
    """Draw as many of K motions as there are, by losses (a, K); return their indices (a, K).

    `failed` (a, K) are not drawn, unless all have failed.
    """
    count = losses.shape[1]
    weights = np.exp(-(losses - losses.min(axis=1, keepdims=True)) / TEMPER)
    weights = np.where(failed, 0.0, weights) + np.finfo(float).tiny
    levels = weights.cumsum(axis=1) / weights.sum(axis=1, keepdims=True)
    asked = (np.arange(count) + generator.random((losses.shape[0], 1))) / count
    return np.asarray((levels[:, None, :] < asked[:, :, None]).sum(axis=2).clip(max=count - 1))


def followed(
    simulator: Simulator, worlds: WorldBatch, times: NDArray[np.float64], count: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Simulate `count` worlds side by side for each row of `times` (n, T) s, NaN beyond the last.

    Returns positions (n count, O, T, 3) m, and states (n count, O, 13) at the last times; NaN where
    a simulation failed.
    """
    counts = np.isfinite(times).sum(axis=1)
    every = np.arange(counts.size)
    asked = np.full((counts.size, times.shape[1] + 1), np.nan)
    asked[:, :-1] = times
    asked[every, counts] = times[every, counts - 1] + VELOCITY_STEP
    rollout = simulator.rollout_batch(worlds, np.repeat(asked, count, axis=0))
    ends = states_at(rollout, np.repeat(counts - 1, count))
    positions, failed = rollout.positions[:, :, :-1], rollout.status != WorldStatus.OK
    ends[failed], positions[failed] = np.nan, np.nan
    return positions, ends


def states_at(rollout: Rollout, columns: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return states (N, O, 13) at columns (N,), velocities as differences to the columns after."""
    every = np.arange(columns.size)
    positions, turns = rollout.positions, np.asarray(rollout.orientations)
    here, there = positions[every, :, columns], positions[every, :, columns + 1]
    before, after = turns[every, :, columns], turns[every, :, columns + 1]
    turned = quaternion_product(after, before * CONJUGATE)
    spins = 2.0 * np.sign(turned[..., 3:]) * turned[..., :3] / VELOCITY_STEP
    return np.concatenate([here, before, (there - here) / VELOCITY_STEP, spins], axis=-1)
