"""Detect: when each object will next hit something."""

from __future__ import annotations

from math import inf, sqrt

import numpy as np
from numba import njit

from intuitive_physics.simulation.event_driven.roots import first_fall, first_fall_quadratic
from intuitive_physics.simulation.vectors import add_scaled, dot, load, norm, sub


@njit(cache=True)
def predict_plane_impacts(world, i):
    """Find the first plane that object i hits in its present phase."""
    world.plane_impact_time[i] = inf
    at, velocity = load(world.position, i), load(world.velocity, i)
    acceleration = load(world.acceleration, i)
    for p in range(world.normal.shape[0]):
        if world.touches_plane[i, p]:
            continue
        n = load(world.normal, p)
        gap = dot(at, n) - world.offset[p] - world.radius[i]
        t = world.time[i] + first_fall_quadratic(gap, dot(velocity, n), dot(acceleration, n))
        if t < world.plane_impact_time[i] and t <= world.phase_end[i]:
            world.plane_impact_time[i] = t
            world.plane_impact[i] = p


@njit(cache=True)
def predict_object_impacts(world, i, end):
    """Find when object i hits each other object while both are in their present phases."""
    for j in range(world.radius.size):
        if j != i:
            t = inf
            if not world.touches_object[i, j]:
                t = _object_impact(world, i, j, end)
            world.object_impact_time[min(i, j), max(i, j)] = t


@njit(cache=True)
def _object_impact(world, i, j, end):
    """Time of impact of two objects: a root of a quartic, of a quadratic where both fly freely."""
    start = max(world.time[i], world.time[j])
    end = min(end, min(world.phase_end[i], world.phase_end[j]))
    end = min(end, min(world.plane_impact_time[i], world.plane_impact_time[j]))
    if end < start:
        return inf
    apart, closing = _relative_motion(world, i, j, start)
    bending = sub(load(world.acceleration, i), load(world.acceleration, j))
    reach = world.radius[i] + world.radius[j]
    span = end - start
    if norm(apart) - reach > span * (norm(closing) + 0.5 * span * norm(bending)):
        return inf
    gap = dot(apart, apart) - reach * reach
    approach = dot(apart, closing)
    if dot(bending, bending) == 0.0:
        if approach >= 0.0:
            return inf
        speed = dot(closing, closing)
        under_root = approach * approach - speed * gap
        if under_root <= 0.0:
            return inf
        t = start + max(0.0, gap / (sqrt(under_root) - approach))
        return t if t <= end else inf
    polynomial = np.empty(5)
    polynomial[0] = gap
    polynomial[1] = 2.0 * approach
    polynomial[2] = dot(closing, closing) + dot(apart, bending)
    polynomial[3] = dot(closing, bending)
    polynomial[4] = 0.25 * dot(bending, bending)
    return start + first_fall(polynomial, 4, span)


@njit(cache=True)
def _relative_motion(world, i, j, t):
    """Position and velocity of i relative to j at time t."""
    apart, closing = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for k, sign in ((i, 1.0), (j, -1.0)):
        tau = t - world.time[k]
        acceleration = load(world.acceleration, k)
        at = add_scaled(load(world.position, k), load(world.velocity, k), tau)
        apart = add_scaled(apart, add_scaled(at, acceleration, 0.5 * tau * tau), sign)
        closing = add_scaled(closing, add_scaled(load(world.velocity, k), acceleration, tau), sign)
    return apart, closing
