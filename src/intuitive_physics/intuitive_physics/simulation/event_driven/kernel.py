"""The loop from event to event, over worlds."""

from __future__ import annotations

from math import inf, isfinite, pi

from numba import njit

from intuitive_physics.simulation.event_driven.impacts import hit_object, hit_plane
from intuitive_physics.simulation.event_driven.motion import advance
from intuitive_physics.simulation.event_driven.transitions import (
    end_jam,
    find_touching,
    lift_onto,
    part_overlap,
    replan,
)
from intuitive_physics.simulation.event_driven.world import make_world, plane_gap
from intuitive_physics.simulation.vectors import load

OK, NOT_FINITE, TOO_MANY_EVENTS = range(3)

INSTANT = 1e-7
"""s. Events nearer than this are at the same time …"""

JAM = 30
"""… and more of them than this are a jam."""

TOUCHES = 1e-9
"""m. Objects nearer than this at the start are in contact."""


@njit(nogil=True, cache=True)
def roll_worlds(
    first,
    last,
    object_counts,
    dimensions,
    object_materials,
    states,
    environment_index,
    gravity,
    plane_counts,
    planes,
    plane_materials,
    parameter_index,
    density,
    coefficients,
    times,
    max_events,
    positions,
    orientations,
    status,
):
    """Roll out the worlds `first` to `last` (exclusive) of a `WorldBatch`'s arrays.

    Parameters
    ----------
    times : (W or 1, T) s, NaN only at a row's end
    positions : (W, O, T, 3) to be filled, as are orientations (W, O, T, 4), whose axis O has
        length zero when they are not wanted, and status (W,)
    """
    for w in range(first, last):
        e, c = environment_index[w], parameter_index[w]
        world = make_world(object_counts[w], plane_counts[e], gravity[e], coefficients[c])
        for p in range(plane_counts[e]):
            for k in range(3):
                world.planes[p].normal[k] = planes[e, p, k]
            world.planes[p].offset = planes[e, p, 3]
            world.planes[p].material = plane_materials[e, p]
        for i in range(object_counts[w]):
            rho = density[c, object_materials[w, i]]
            _place(world.objects[i], states[w, i], dimensions[w, i, 0], object_materials[w, i], rho)
        row = times[w if times.shape[0] > 1 else 0]
        wanted = row.size
        while not isfinite(row[wanted - 1]):
            wanted -= 1
        status[w] = _roll_world(world, row[:wanted], max_events, positions[w], orientations[w])


@njit(cache=True)
def _place(body, state, radius, material, rho):
    for k in range(3):
        body.position[k] = state[k]
        body.velocity[k] = state[7 + k]
        body.spin[k] = state[10 + k]
    for k in range(4):
        body.orientation[k] = state[3 + k]
    body.radius = radius
    body.mass = rho * 4.0 / 3.0 * pi * radius**3
    body.material = material


@njit(cache=True)
def _roll_world(world, times, max_events, positions, orientations):
    objects = world.objects.size
    _part_start(world)
    for i in range(objects):
        replan(world, i, times, positions, orientations)
    status = OK
    events = 0
    instant, at_once = -1.0, 0
    while True:
        t, i, j = _next_event(world)
        if t > times[-1]:
            break
        events += 1
        at_once = at_once + 1 if t - instant < INSTANT else 0
        instant = t
        if events > max_events:
            status = TOO_MANY_EVENTS
            break
        advance(world, i, t, times, positions, orientations)
        if at_once > JAM:
            end_jam(world, i, times, positions, orientations)
            for k in range(objects):
                advance(world, k, t, times, positions, orientations)
                replan(world, k, times, positions, orientations)
            at_once = 0
        elif j >= 0:
            advance(world, j, t, times, positions, orientations)
            world.object_impact_time[i, j] = inf
            hit_object(world, i, j)
            replan(world, j, times, positions, orientations)
        elif world.objects[i].plane_impact_time <= t:
            hit_plane(world, i, world.objects[i].plane_impact)
        velocity = load(world.objects[i].velocity)
        if not isfinite(velocity[0] + velocity[1] + velocity[2]):
            status = NOT_FINITE
            break
        replan(world, i, times, positions, orientations)
    if status == OK:
        for i in range(objects):
            advance(world, i, times[-1], times, positions, orientations)
    return status


@njit(cache=True)
def _next_event(world):
    """Time of the next event, its object, and the other object or -1."""
    first, i, j = inf, 0, -1
    for a in range(world.objects.size):
        body = world.objects[a]
        t = min(body.phase_end, body.plane_impact_time)
        if t < first:
            first, i, j = t, a, -1
        for b in range(a + 1, world.objects.size):
            t = world.object_impact_time[a, b]
            if t < first:
                first, i, j = t, a, b
    return first, i, j


@njit(cache=True)
def _part_start(world):
    """Move what overlaps at the start apart: noisy states of touching things overlap a little."""
    objects, planes = world.objects.size, world.planes.size
    for _ in range(20):
        for i in range(objects):
            for j in range(i):
                part_overlap(world.objects[i], world.objects[j])
        for i in range(objects):
            for p in range(planes):
                if plane_gap(world.objects[i], world.planes[p]) < 0.0:
                    lift_onto(world.objects[i], world.planes[p])
    for i in range(objects):
        find_touching(world, i, TOUCHES)
