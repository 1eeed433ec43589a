"""The loop from event to event, over worlds."""

from __future__ import annotations

from math import inf, isfinite, nan, pi, sqrt

from numba import int64

from intuitive_physics.geometry.vectors import load, store
from intuitive_physics.kernels import entry, kernel
from intuitive_physics.simulation.event_driven.clusters import gather
from intuitive_physics.simulation.event_driven.impacts import hit_object, hit_solid
from intuitive_physics.simulation.event_driven.motion import carry, write_outputs
from intuitive_physics.simulation.event_driven.solids import place_bounded, place_planes
from intuitive_physics.simulation.event_driven.transitions import (
    end_jam,
    find_touching,
    part_start,
    replan,
)
from intuitive_physics.simulation.event_driven.world import object_at, pair_at, pair_index
from intuitive_physics.simulation.noisy_impacts import set_noise

OK, NOT_FINITE, TOO_MANY_EVENTS = range(3)

INSTANT = 1e-7
"""s. Events nearer than this are at the same time …"""

JAM = 30
"""… and more of them than this are a jam."""

TOUCHES = 1e-9
"""m. Objects nearer than this at the start are in contact."""


@entry
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
    corner_counts,
    corners,
    box_counts,
    boxes,
    box_materials,
    parameter_index,
    density,
    coefficients,
    noise_keys,
    contact_noise,
    times,
    max_events,
    scratch,
    objects,
    solids,
    features,
    contacts,
    pairs,
    positions,
    orientations,
    status,
):
    """Roll out the worlds `first` to `last` (exclusive) of a `WorldBatch`'s arrays.

    Parameters
    ----------
    times : (W or 1, T) s, NaN only at a row's end
    scratch : (1,) WORLD
    objects, solids, features, contacts, pairs : its arrays, with room for the largest of the worlds
    positions : (W, O, T, 3) to be filled, as are orientations (W, O, T, 4), whose axis O has
        length zero when they are not wanted, and status (W,)
    """
    world = scratch[0]
    world.objects, world.solids = objects.ctypes.data, solids.ctypes.data
    world.features = features.ctypes.data
    world.contacts, world.pairs = contacts.ctypes.data, pairs.ctypes.data
    world.turns = orientations.shape[1] > 0
    world.material_count = density.shape[1]
    placed, endless = -1, 0
    for w in range(first, last):
        e, c = environment_index[w], parameter_index[w]
        count = plane_counts[e]
        bounded = solids[: count + box_counts[e]]
        if e != placed:
            endless = place_planes(bounded, count, planes[e], plane_materials[e], corner_counts[e])
            if bounded.size > endless:
                place_bounded(
                    bounded,
                    endless,
                    features,
                    count,
                    planes[e],
                    plane_materials[e],
                    corner_counts[e],
                    corners[e],
                    boxes[e],
                    box_materials[e],
                )
            placed = e
        for i in range(object_counts[w]):
            material = object_materials[w, i]
            _place(
                object_at(world, i),
                states[w, i],
                dimensions[w, i, 0],
                material,
                density[c, material],
            )
        row = times[w if times.shape[0] > 1 else 0]
        wanted = row.size
        while not isfinite(row[wanted - 1]):
            wanted -= 1
        world.object_count = object_counts[w]
        world.solid_count = bounded.size
        world.planes = endless
        store(world.gravity, load(gravity[e]))
        world.coefficients = coefficients[c].ctypes.data
        set_noise(world, contact_noise, noise_keys[w])
        world.end = row[wanted - 1]
        for k in range(contacts.size):
            contacts[k].until = -1.0
        status[w] = _roll_world(world, row[:wanted], max_events, positions[w], orientations[w])


@kernel
def _place(body, state, radius, material, rho):
    for k in range(3):
        body.position[k] = state[k]
        body.velocity[k] = state[7 + k]
        body.spin[k] = state[10 + k]
    size = sqrt(state[3] ** 2 + state[4] ** 2 + state[5] ** 2 + state[6] ** 2)
    for k in range(4):
        body.orientation[k] = state[3 + k] / size
    body.time = 0.0
    body.phase_end = inf
    body.radius = radius
    body.mass = rho * 4.0 / 3.0 * pi * radius**3
    body.impact_time = inf
    body.impact_solid = -1
    body.material = material
    body.clustered = 0
    body.turning = 0
    body.next_output = 0
    body.touched_count = 0


@kernel
def _roll_world(world, times, max_events, positions, orientations):
    """Roll out one world; return its status."""
    objects = world.object_count
    _start(world)
    status = OK if _all_finite(world) else NOT_FINITE
    events = 0
    instant, at_once = -1.0, 0
    while status == OK:
        t, i, j = _next_event(world)
        if t > world.end:
            break
        events += 1
        at_once = at_once + 1 if t - instant < INSTANT else 0
        instant = t
        if events > max_events:
            status = TOO_MANY_EVENTS
            break
        _advance(world, i, t, times, positions, orientations)
        if j >= 0:
            _advance(world, j, t, times, positions, orientations)
        if at_once > JAM:
            at_once = 0
            for k in range(objects):
                _advance(world, k, t, times, positions, orientations)
            end_jam(world, i)
            for k in range(objects):
                replan(world, k, gather(world, k))
        elif j >= 0:
            pair_at(world, pair_index(i, j)).impact_time = inf
            hit_object(world, i, j)
            _replan(world, j, times, positions, orientations)
        elif object_at(world, i).impact_time <= t:
            hit_solid(world, i, object_at(world, i).impact_solid)
        if not _finite(object_at(world, i)):
            status = NOT_FINITE
            break
        _replan(world, i, times, positions, orientations)
    if status == OK:
        for i in range(objects):
            _advance(world, i, world.end, times, positions, orientations)
        status = OK if _all_finite(world) else NOT_FINITE
    _blank_rest(world, status, positions, orientations)
    return status


@kernel
def _start(world):
    for k in range(world.object_count * (world.object_count - 1) // 2):
        pair_at(world, k).touches = 0
        pair_at(world, k).impact_time = inf
    part_start(world)
    for i in range(world.object_count):
        find_touching(world, i, TOUCHES)
    for i in range(world.object_count):
        replan(world, i, gather(world, i))


@kernel
def _replan(world, i, times, positions, orientations):
    """Plan object i and all that touch it anew, after these have been brought to its time."""
    count = gather(world, i)
    for k in range(1, count):
        now = object_at(world, i).time
        _advance(world, object_at(world, k).member, now, times, positions, orientations)
    replan(world, i, count)


@kernel
def _advance(world, i, t, times, positions, orientations):
    """Bring object i to time t, writing all its outputs up to and including t."""
    write_outputs(world, i, t, times, positions, orientations)
    carry(object_at(world, i), t, world.turns)


@kernel
def _finite(body):
    v = body.velocity[0] + body.velocity[1] + body.velocity[2]
    return isfinite(v + body.position[0] + body.position[1] + body.position[2])


@kernel
def _all_finite(world):
    finite = True
    for i in range(world.object_count):
        finite = finite and _finite(object_at(world, i))
    return finite


@kernel
def _blank_rest(world, status, positions, orientations):
    """Write NaN where there is no output: after a stop, for unwanted times and absent objects."""
    for i in range(positions.shape[0]):
        first = 0
        if i < world.object_count:
            first = object_at(world, i).next_output
            if status == NOT_FINITE:
                first = _first_not_finite(positions[i, :first])
        for k in range(first, positions.shape[1]):
            store(positions[i, k], (nan, nan, nan))
            if world.turns:
                store(orientations[i, k], (nan, nan, nan))
                orientations[i, k, 3] = nan


@kernel
def _first_not_finite(positions):
    for k in range(positions.shape[0]):
        if not isfinite(positions[k, 0] + positions[k, 1] + positions[k, 2]):
            return k
    return positions.shape[0]


@kernel
def _next_event(world):
    """Time of the next event, its object, and the other object or -1."""
    first, i, j = inf, int64(0), int64(-1)
    pair = 0
    for b in range(world.object_count):
        body = object_at(world, b)
        t = min(body.phase_end, body.impact_time)
        if t < first:
            first, i, j = t, b, -1
        for a in range(b):
            t = pair_at(world, pair).impact_time
            if t < first:
                first, i, j = t, a, b
            pair += 1
    return first, i, j
