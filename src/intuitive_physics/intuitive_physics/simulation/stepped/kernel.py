"""The loops over worlds, steps and islands."""

from __future__ import annotations

from math import inf, isfinite, sqrt

from intuitive_physics.simulation.kernels import kernel
from intuitive_physics.simulation.stepped.collision import are_near, find_contacts, part_overlaps
from intuitive_physics.simulation.stepped.motion import TIME_ROUNDING, write_rest
from intuitive_physics.simulation.stepped.parts import rebound_threshold, step_island
from intuitive_physics.simulation.stepped.set_up import (
    place_object,
    place_plane,
    place_static_box,
)
from intuitive_physics.simulation.stepped.world import World
from intuitive_physics.simulation.vectors import dot, load, norm, store

OK, NOT_FINITE = range(2)

QUIET_SPEED = 2e-3
"""m/s. Bodies no point of which moves faster …"""

QUIET_STEPS = 10
"""… for so many steps, while something holds them, fall asleep."""


@kernel
def roll_worlds(
    first,
    last,
    step,
    object_counts,
    shape_kinds,
    dimensions,
    volumes,
    unit_inertias,
    object_materials,
    states,
    air_factors,
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
    times,
    scratch,
    positions,
    orientations,
    status,
):
    """Roll out the worlds `first` to `last` (exclusive) of a `WorldBatch`'s arrays.

    Parameters
    ----------
    step : s
    times : (W or 1, T) s, NaN only at a row's end
    scratch : a `World` with room for the largest of the worlds
    positions : (W, O, T, 3) to be filled, as are orientations (W, O, T, 4), whose axis O has
        length zero when they are not wanted, and status (W,)
    """
    for w in range(first, last):
        e, c = environment_index[w], parameter_index[w]
        moving = object_counts[w]
        for i in range(moving):
            mass = density[c, object_materials[w, i]]
            place_object(
                scratch.bodies[i],
                shape_kinds[w, i],
                dimensions[w, i],
                object_materials[w, i],
                states[w, i],
                air_factors[w, i],
                mass * volumes[w, i],
                mass,
                unit_inertias[w, i],
            )
        for b in range(box_counts[e]):
            place_static_box(scratch.bodies[moving + b], boxes[e, b], box_materials[e, b])
        used = 0
        for p in range(plane_counts[e]):
            place_plane(
                scratch.planes[p],
                planes[e, p],
                plane_materials[e, p],
                corner_counts[e, p],
                corners[e, p],
                used,
                scratch.corners,
            )
            used += corner_counts[e, p]
        row = times[w if times.shape[0] > 1 else 0]
        wanted = row.size
        while not isfinite(row[wanted - 1]):
            wanted -= 1
        world = World(
            scratch.bodies[: moving + box_counts[e]],
            scratch.planes[: plane_counts[e]],
            scratch.corners,
            scratch.contacts,
            scratch.clip,
            scratch.members,
            gravity[e],
            coefficients[c],
            row[:wanted],
            positions[w],
            orientations[w],
        )
        status[w] = _roll_world(world, moving, step)


@kernel
def _roll_world(world, moving, step):
    """Roll out one world from its bodies' first states; return its status.

    Parameters
    ----------
    moving : so many of `World.bodies` move, the others are static boxes
    step : s
    """
    threshold = rebound_threshold(world, step)
    _part_start(world, moving)
    end = world.times[world.times.size - 1]
    steps = 0
    while steps * step < end - TIME_ROUNDING:
        start = steps * step
        _mark_islands(world, moving, step)
        awake = False
        for root in range(moving):
            if world.bodies[root].island == root:
                awake = _step_one(world, moving, root, start, step, threshold) or awake
        for i in range(moving):
            body = world.bodies[i]
            if not isfinite(norm(load(body.position)) + norm(load(body.velocity))):
                return NOT_FINITE
        steps += 1
        if not awake:
            break
    for i in range(moving):
        write_rest(world, i, inf)
    return OK


@kernel
def _part_start(world, moving):
    """Move what overlaps at the start apart: noisy states of touching things overlap a little."""
    for i in range(world.bodies.size):
        world.members[i] = i
    part_overlaps(world, find_contacts(world, moving, world.bodies.size))
    for i in range(moving):
        write_rest(world, i, 0.0)


@kernel
def _mark_islands(world, moving, step):
    """Give all bodies that may meet within a step, directly or through others, one number."""
    gravity = load(world.gravity)
    fall = step * step * sqrt(dot(gravity, gravity))
    for i in range(moving):
        world.bodies[i].island = i
    for i in range(moving):
        for j in range(i):
            one, other = world.bodies[i], world.bodies[j]
            if (one.asleep == 1 and other.asleep == 1) or one.island == other.island:
                continue
            if are_near(one, other, step, fall):
                old, new = max(one.island, other.island), min(one.island, other.island)
                for k in range(i + 1):
                    if world.bodies[k].island == old:
                        world.bodies[k].island = new


@kernel
def _step_one(world, moving, root, start, step, threshold):
    """Step the island of a root, if any of it is awake; return whether."""
    count = 0
    awake = False
    for i in range(root, moving):
        if world.bodies[i].island == root:
            world.members[count] = i
            count += 1
            awake = awake or world.bodies[i].asleep == 0
    if not awake:
        for a in range(count):
            write_rest(world, world.members[a], start + step)
        return False
    members = count
    gravity = load(world.gravity)
    fall = step * step * sqrt(dot(gravity, gravity))
    for j in range(moving, world.bodies.size):
        for a in range(count):
            if are_near(world.bodies[world.members[a]], world.bodies[j], step, fall):
                world.members[members] = j
                members += 1
                break
    step_island(world, count, members, start, step, threshold)
    _put_to_sleep(world, count)
    return True


@kernel
def _put_to_sleep(world, count):
    """Let an island sleep when all of it has been quiet for long enough."""
    quiet = True
    for a in range(count):
        body = world.bodies[world.members[a]]
        speed = norm(load(body.velocity)) + body.reach * norm(load(body.spin))
        body.quiet_steps = body.quiet_steps + 1 if body.pressed and speed < QUIET_SPEED else 0
        quiet = quiet and body.quiet_steps >= QUIET_STEPS
    for a in range(count):
        body = world.bodies[world.members[a]]
        body.asleep = quiet
        if quiet:
            store(body.velocity, (0.0, 0.0, 0.0))
            store(body.spin, (0.0, 0.0, 0.0))
