"""Evolve: carry objects along their closed-form motion and write what was asked for."""

from __future__ import annotations

from numba import njit

from intuitive_physics.simulation.vectors import add_scaled, load, scaled, store, turn


@njit(cache=True)
def _carry(body, t):
    tau = t - body.time
    if tau == 0.0:
        return
    velocity, acceleration = load(body.velocity), load(body.acceleration)
    moved = add_scaled(load(body.position), velocity, tau)
    store(body.position, add_scaled(moved, acceleration, 0.5 * tau * tau))
    store(body.velocity, add_scaled(velocity, acceleration, tau))
    spin, spin_acceleration = load(body.spin), load(body.spin_acceleration)
    turn(body.orientation, scaled(add_scaled(spin, spin_acceleration, 0.5 * tau), tau))
    store(body.spin, add_scaled(spin, spin_acceleration, tau))
    body.time = t


@njit(cache=True)
def advance(world, i, t, times, positions, orientations):
    """Bring object i to time t, writing all its outputs up to and including t.

    Parameters
    ----------
    times : (T,) output times
    positions, orientations : (O, T, 3) and (O, T, 4); the latter of length zero if not wanted
    """
    body = world.objects[i]
    k = body.next_output
    if k < times.size and times[k] <= t:
        start, velocity = load(body.position), load(body.velocity)
        acceleration, since = load(body.acceleration), body.time
        turns = orientations.shape[0] > 0
        while k < times.size and times[k] <= t:
            tau = times[k] - since
            half = 0.5 * tau * tau
            for c in range(3):
                positions[i, k, c] = start[c] + tau * velocity[c] + half * acceleration[c]
            if turns:
                _carry(body, times[k])
                for c in range(4):
                    orientations[i, k, c] = body.orientation[c]
            k += 1
        body.next_output = k
    _carry(body, t)
