"""Detect: when each object will next hit something."""

from __future__ import annotations

from math import inf, sqrt

import numpy as np
from numba import njit

from intuitive_physics.simulation.event_driven.roots import first_fall, first_fall_quadratic
from intuitive_physics.simulation.event_driven.world import plane_gap
from intuitive_physics.simulation.vectors import add_scaled, dot, load, norm, sub


@njit(cache=True)
def predict_plane_impacts(world, i):
    """Find the first plane that object i hits in its present phase."""
    body = world.objects[i]
    body.plane_impact_time = inf
    velocity, acceleration = load(body.velocity), load(body.acceleration)
    for p in range(world.planes.size):
        if not world.touches_plane[i, p]:
            plane = world.planes[p]
            n = load(plane.normal)
            gap = plane_gap(body, plane)
            t = body.time + first_fall_quadratic(gap, dot(velocity, n), dot(acceleration, n))
            if t < body.plane_impact_time and t <= body.phase_end:
                body.plane_impact_time = t
                body.plane_impact = p


@njit(cache=True)
def predict_object_impacts(world, i, end):
    """Find when object i hits each other object while both are in their present phases."""
    for j in range(world.objects.size):
        if j != i:
            t = inf
            if not world.touches_object[i, j]:
                t = _object_impact(world.objects[i], world.objects[j], end)
            world.object_impact_time[min(i, j), max(i, j)] = t


@njit(cache=True)
def _object_impact(one, other, end):
    """Time of impact of two objects: a root of a quartic, of a quadratic where both fly freely."""
    start = max(one.time, other.time)
    end = min(end, min(one.phase_end, other.phase_end))
    end = min(end, min(one.plane_impact_time, other.plane_impact_time))
    if end < start:
        return inf
    apart = sub(position_at(one, start), position_at(other, start))
    closing = sub(_velocity_at(one, start), _velocity_at(other, start))
    bending = sub(load(one.acceleration), load(other.acceleration))
    reach = one.radius + other.radius
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
def position_at(body, t):
    """Position (m) of a body at time t (s) of its present phase."""
    tau = t - body.time
    moved = add_scaled(load(body.position), load(body.velocity), tau)
    return add_scaled(moved, load(body.acceleration), 0.5 * tau * tau)


@njit(cache=True)
def _velocity_at(body, t):
    return add_scaled(load(body.velocity), load(body.acceleration), t - body.time)
