"""The loop from event to event, over worlds."""

from __future__ import annotations

from math import inf, isfinite, nan, pi, sqrt

from numba import int64

from intuitive_physics.geometry.vectors import store
from intuitive_physics.kernels import entry, kernel
from intuitive_physics.simulation.event_driven.clusters import gather
from intuitive_physics.simulation.event_driven.impacts import hit_object, hit_solid
from intuitive_physics.simulation.event_driven.motion import carry, write_outputs
from intuitive_physics.simulation.event_driven.solids import place_solids
from intuitive_physics.simulation.event_driven.transitions import (
    end_jam,
    find_touching,
    part_start,
    replan,
)
from intuitive_physics.simulation.event_driven.world import (
    contact_at,
    member_at,
    object_at,
    pair_at,
    pair_index,
)
from intuitive_physics.simulation.rollout import NOT_FINITE, OK, TOO_MANY_EVENTS, OutputArrays
from intuitive_physics.simulation.world_batch import WorldArrays
from intuitive_physics.simulation.world_record import start_world, stop_if_asked, wanted_outputs

INSTANT = 1e-7
"""s. Events nearer than this are at the same time …"""

JAM = 30
"""… and more of them than this are a jam."""

TOUCHES = 1e-9
"""m. Objects nearer than this at the start are in contact."""


@entry
def roll_worlds(first, last, batch, results, scratch, max_events):
    """Roll out the worlds `first` to `last` (exclusive) of a batch.

    `batch` is `WorldBatch.arrays`, `results` are `OutputArrays` as a plain tuple, to be filled, and
    `scratch` (1,) is a WORLD whose arrays have room for the largest of the worlds.
    """
    worlds, outputs = WorldArrays(*batch), OutputArrays(*results)
    world = scratch[0]
    world.turns = outputs.orientations.shape[1] > 0
    placed = -1
    for w in range(first, last):
        if worlds.environment_index[w] != placed:
            placed = worlds.environment_index[w]
            place_solids(world, worlds, placed)
        start_world(world, worlds, w, outputs.stop)
        world.object_count = worlds.object_counts[w]
        for i in range(world.object_count):
            material = worlds.object_materials[w, i]
            _place(
                object_at(world, i),
                worlds.states[w, i],
                worlds.dimensions[w, i, 0],
                worlds.inertia_ratios[w, i],
                material,
                worlds.density[worlds.parameter_index[w], material],
            )
        times = outputs.times[w if outputs.times.shape[0] > 1 else 0]
        times = times[: wanted_outputs(times)]
        world.end = times[times.size - 1]
        for k in range(world.contact_room):
            contact_at(world, k).until = -1.0
        _roll_world(world, times, max_events, outputs.positions[w], outputs.orientations[w])
        outputs.status[w] = world.status


@kernel
def _place(body, state, radius, inertia_ratio, material, rho):
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
    body.inertia = inertia_ratio * body.mass * radius * radius
    body.rolling_share = 1.0 / (1.0 + inertia_ratio)
    body.spin_gain = 1.0 / inertia_ratio
    body.slip_gain = 1.0 + body.spin_gain
    body.impact_time = inf
    body.impact_solid = -1
    body.material = material
    body.clustered = 0
    body.turning = 0
    body.next_output = 0
    body.touched_count = 0


@kernel
def _roll_world(world, times, max_events, positions, orientations):
    """Roll out one world; its record says how it ended."""
    objects = world.object_count
    _start(world)
    if not _all_finite(world):
        world.status = NOT_FINITE
    events = 0
    instant, at_once = -1.0, 0
    while world.status == OK:
        stop_if_asked(world)
        t, i, j = _next_event(world)
        if t > world.end or world.status != OK:
            break
        events += 1
        at_once = at_once + 1 if t - instant < INSTANT else 0
        instant = t
        if events > max_events:
            world.status = TOO_MANY_EVENTS
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
            world.status = NOT_FINITE
            break
        _replan(world, i, times, positions, orientations)
    if world.status == OK:
        for i in range(objects):
            _advance(world, i, world.end, times, positions, orientations)
        if not _all_finite(world):
            world.status = NOT_FINITE
    _blank_rest(world, positions, orientations)


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
    """Plan object i and all that touch it again, after these have been brought to its time."""
    count = gather(world, i)
    for k in range(1, count):
        now = object_at(world, i).time
        _advance(world, member_at(world, k), now, times, positions, orientations)
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
def _blank_rest(world, positions, orientations):
    """Write NaN where there is no output: after a stop, for unwanted times and absent objects."""
    for i in range(positions.shape[0]):
        first = 0
        if i < world.object_count:
            first = object_at(world, i).next_output
            if world.status == NOT_FINITE:
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
