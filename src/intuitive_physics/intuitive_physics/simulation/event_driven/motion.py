"""Evolve: carry objects along their closed-form motion and write what was asked for."""

from __future__ import annotations

from numba import njit

from intuitive_physics.simulation.vectors import add_scaled, load, scaled, store, turn


@njit(cache=True)
def _carry(world, i, t):
    tau = t - world.time[i]
    if tau == 0.0:
        return
    moved = add_scaled(load(world.position, i), load(world.velocity, i), tau)
    moved = add_scaled(moved, load(world.acceleration, i), 0.5 * tau * tau)
    store(world.position, i, moved)
    spin, spin_acceleration = load(world.spin, i), load(world.spin_acceleration, i)
    mean_spin = add_scaled(spin, spin_acceleration, 0.5 * tau)
    turn(world.orientation, i, scaled(mean_spin, tau))
    store(world.velocity, i, add_scaled(load(world.velocity, i), load(world.acceleration, i), tau))
    store(world.spin, i, add_scaled(spin, spin_acceleration, tau))
    world.time[i] = t


@njit(cache=True)
def advance(world, i, t, times, positions, orientations):
    """Bring object i to time t, writing all its outputs up to and including t.

    Parameters
    ----------
    times : (T,) output times
    positions, orientations : (O, T, 3) and (O, T, 4); the latter of length zero if not wanted
    """
    k = world.next_output[i]
    start, velocity = load(world.position, i), load(world.velocity, i)
    acceleration, since = load(world.acceleration, i), world.time[i]
    while k < times.size and times[k] <= t:
        tau = times[k] - since
        half = 0.5 * tau * tau
        for c in range(3):
            positions[i, k, c] = start[c] + tau * velocity[c] + half * acceleration[c]
        if orientations.shape[0] > 0:
            _carry(world, i, times[k])
            for c in range(4):
                orientations[i, k, c] = world.orientation[i, c]
        k += 1
    world.next_output[i] = k
    _carry(world, i, t)
