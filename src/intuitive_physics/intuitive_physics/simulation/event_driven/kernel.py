"""The loop from event to event, over worlds."""

from __future__ import annotations

from math import inf, isfinite

from numba import njit

from intuitive_physics.simulation.event_driven.impacts import hit_object, hit_plane
from intuitive_physics.simulation.event_driven.motion import advance
from intuitive_physics.simulation.event_driven.transitions import part_overlap, replan
from intuitive_physics.simulation.event_driven.world import make_world
from intuitive_physics.simulation.vectors import add_scaled, dot, load, store

OK, NOT_FINITE, TOO_MANY_EVENTS = range(3)


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
                world.normal[p, k] = planes[e, p, k]
            world.offset[p] = planes[e, p, 3]
            world.plane_material[p] = plane_materials[e, p]
        for i in range(object_counts[w]):
            rho = density[c, object_materials[w, i]]
            _place(world, i, states[w, i], dimensions[w, i, 0], object_materials[w, i], rho)
        row = times[w if times.shape[0] > 1 else 0]
        wanted = row.size
        while not isfinite(row[wanted - 1]):
            wanted -= 1
        status[w] = _roll_world(world, row[:wanted], max_events, positions[w], orientations[w])


@njit(cache=True)
def _place(world, i, state, radius, material, rho):
    for k in range(3):
        world.position[i, k] = state[k]
        world.velocity[i, k] = state[7 + k]
        world.spin[i, k] = state[10 + k]
    for k in range(4):
        world.orientation[i, k] = state[3 + k]
    world.radius[i] = radius
    world.mass[i] = rho * 4.0 / 3.0 * 3.141592653589793 * radius**3
    world.material[i] = material


@njit(cache=True)
def _roll_world(world, times, max_events, positions, orientations):
    objects = world.radius.size
    _part_start(world)
    for i in range(objects):
        replan(world, i, times, positions, orientations)
    status = OK
    events = 0
    while True:
        t, i, j = _next_event(world)
        if t > times[-1]:
            break
        events += 1
        if events > max_events:
            status = TOO_MANY_EVENTS
            break
        advance(world, i, t, times, positions, orientations)
        if j >= 0:
            advance(world, j, t, times, positions, orientations)
            world.object_impact_time[i, j] = inf
            hit_object(world, i, j)
            replan(world, j, times, positions, orientations)
        elif world.plane_impact_time[i] <= t:
            hit_plane(world, i, world.plane_impact[i])
        if not isfinite(world.velocity[i, 0] + world.velocity[i, 1] + world.velocity[i, 2]):
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
    for a in range(world.radius.size):
        t = min(world.phase_end[a], world.plane_impact_time[a])
        if t < first:
            first, i, j = t, a, -1
        for b in range(a + 1, world.radius.size):
            t = world.object_impact_time[a, b]
            if t < first:
                first, i, j = t, a, b
    return first, i, j


@njit(cache=True)
def _part_start(world):
    """Move what overlaps at the start apart: noisy states of touching things overlap a little."""
    objects, planes = world.radius.size, world.normal.shape[0]
    for _ in range(20):
        for i in range(objects):
            for j in range(i):
                part_overlap(world, i, j)
        for i in range(objects):
            for p in range(planes):
                n = load(world.normal, p)
                gap = dot(load(world.position, i), n) - world.offset[p] - world.radius[i]
                if gap < 0.0:
                    store(world.position, i, add_scaled(load(world.position, i), n, -gap))
    for i in range(objects):
        for p in range(planes):
            n = load(world.normal, p)
            gap = dot(load(world.position, i), n) - world.offset[p] - world.radius[i]
            world.touches_plane[i, p] = abs(gap) < 1e-9
        for j in range(objects):
            if i != j:
                d = 0.0
                for k in range(3):
                    d += (world.position[i, k] - world.position[j, k]) ** 2
                reach = world.radius[i] + world.radius[j]
                world.touches_object[i, j] = abs(d**0.5 - reach) < 1e-9
