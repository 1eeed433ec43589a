"""Evolve: carry objects along their closed-form motion and write what was asked for."""

from __future__ import annotations

from intuitive_physics.geometry.quaternions import load_quaternion, store_quaternion
from intuitive_physics.geometry.vectors import add_scaled, load, store
from intuitive_physics.kernels import kernel
from intuitive_physics.simulation.event_driven.rotation import turned, write_orientations
from intuitive_physics.simulation.event_driven.world import object_at


@kernel
def carry(body, t, turns):
    """Bring a body to time t (s) of its phase, its orientation only if `turns`."""
    tau = t - body.time
    if tau == 0.0:
        return
    velocity, acceleration = load(body.velocity), load(body.acceleration)
    spin, spin_acceleration = load(body.spin), load(body.spin_acceleration)
    moved = add_scaled(load(body.position), velocity, tau)
    store(body.position, add_scaled(moved, acceleration, 0.5 * tau * tau))
    if turns:
        q = turned(load_quaternion(body.orientation), spin, spin_acceleration, tau)
        store_quaternion(body.orientation, q)
    store(body.velocity, add_scaled(velocity, acceleration, tau))
    store(body.spin, add_scaled(spin, spin_acceleration, tau))
    body.time = t
    if body.turning and t >= body.phase_end:
        store(body.velocity, load(body.end_velocity))


@kernel
def write_outputs(world, i, t, times, positions, orientations):
    """Write all outputs of the present phase of object i up to and including time t (s).

    Parameters
    ----------
    times : (T,) s, output times
    positions, orientations : (O, T, 3) and (O, T, 4), the latter only if they are wanted
    """
    body = object_at(world, i)
    first = body.next_output
    last = first
    while last < times.size and times[last] <= t:
        last += 1
    if last == first:
        return
    body.next_output = last
    _write_positions(body, times[first:last], positions[i, first:last])
    if world.turns:
        write_orientations(body, times[first:last], orientations[i, first:last])


@kernel
def _write_positions(body, times, positions):
    # Copies keep the loop free of loads that a store might have changed.
    since = body.time
    x, y, z = load(body.position)
    vx, vy, vz = load(body.velocity)
    ax, ay, az = load(body.acceleration)
    for k in range(times.size):
        tau = times[k] - since
        half = 0.5 * tau * tau
        positions[k, 0] = x + tau * vx + half * ax
        positions[k, 1] = y + tau * vy + half * ay
        positions[k, 2] = z + tau * vz + half * az
