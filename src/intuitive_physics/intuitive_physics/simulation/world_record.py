"""What a world's record has of its laws and its status, and the values from a batch."""

from __future__ import annotations

from math import isfinite

from intuitive_physics.geometry.vectors import load, store
from intuitive_physics.kernels import inlined
from intuitive_physics.kernels.pointers import flag_at, float_at
from intuitive_physics.simulation.noisy_impacts import NOISE_FIELDS, set_noise
from intuitive_physics.simulation.rollout import OK, STOPPED

COMMON_FIELDS = [
    ("status", "i8"),  # `WorldStatus`
    ("stop", "i8"),  # address of the int64 of `StopFlag`
    ("coefficients", "i8"),  # address of (4, m, m) float64
    ("material_count", "i8"),  # m
    ("gravity", "f8", 3),  # m/s²
    *NOISE_FIELDS,
]
"""Fields of `WORLD` beside those of its bodies."""

STATIC, DYNAMIC, ROLLING, RESTITUTION = range(4)
"""Kinds of coefficients, in the order of `StaticParameters.coefficients`."""


@inlined
def start_world(world, worlds, w, stop):
    """Fill in these fields for world w of `WorldArrays`; `stop` is `StopFlag.number`."""
    world.status = OK
    world.stop = stop.ctypes.data
    table = worlds.coefficients[worlds.parameter_index[w]]
    world.coefficients = table.ctypes.data
    world.material_count = table.shape[1]
    store(world.gravity, load(worlds.gravity[worlds.environment_index[w]]))
    set_noise(world, worlds.contact_noise, worlds.noise_keys[w])


@inlined
def stop_if_asked(world):
    """Give a world that was simulated without a fault the status STOPPED if its flag is set."""
    if flag_at(world.stop) != 0 and world.status == OK:
        world.status = STOPPED


@inlined
def coefficient(world, kind, a, b):
    """One of the four coefficients of a pair of materials."""
    row = kind * world.material_count + a
    return float_at(world.coefficients, row * world.material_count + b)


@inlined
def wanted_outputs(times):
    """Number of times (T,) before those that are NaN."""
    count = times.size
    while not isfinite(times[count - 1]):
        count -= 1
    return count
