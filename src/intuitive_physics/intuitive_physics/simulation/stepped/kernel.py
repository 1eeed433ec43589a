"""The loops over worlds and steps."""

from __future__ import annotations

from math import inf, isfinite, nan

from intuitive_physics.geometry.vectors import load, norm
from intuitive_physics.kernels import entry, fast_inlined, kernel
from intuitive_physics.simulation.noisy_impacts import set_noise
from intuitive_physics.simulation.stepped.collision import find_contacts, part_overlaps
from intuitive_physics.simulation.stepped.islands import carry_island, mark_islands
from intuitive_physics.simulation.stepped.motion import TIME_ROUNDING, output_time, write_rest
from intuitive_physics.simulation.stepped.parts import rebound_threshold
from intuitive_physics.simulation.stepped.set_up import place_environment, place_object
from intuitive_physics.simulation.stepped.world import body_at

OK, NOT_FINITE = range(2)


@entry
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
    mass_centres,
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
    scratch : (1,) WORLD whose arrays have room for the largest of the worlds
    positions : (W, O, T, 3) to be filled, as are orientations (W, O, T, 4), whose axis O has
        length zero when they are not wanted, and status (W,)
    """
    world = scratch[0]
    for w in range(first, last):
        e, c = environment_index[w], parameter_index[w]
        moving = object_counts[w]
        world.moving = moving
        for k in range(3):
            world.gravity[k] = gravity[e, k]
        world.gravity_size = norm(load(world.gravity))
        world.coefficients = coefficients[c].ctypes.data
        set_noise(world, contact_noise, noise_keys[w])
        world.material_count = density.shape[1]
        for i in range(moving):
            rho = density[c, object_materials[w, i]]
            place_object(
                body_at(world, i),
                shape_kinds[w, i],
                dimensions[w, i],
                object_materials[w, i],
                states[w, i],
                air_factors[w, i],
                mass_centres[w, i],
                rho * volumes[w, i],
                rho,
                unit_inertias[w, i],
            )
        place_environment(
            world,
            plane_counts[e],
            planes[e],
            plane_materials[e],
            corner_counts[e],
            corners[e],
            box_counts[e],
            boxes[e],
            box_materials[e],
        )
        # What is never reached, and what is padding, has no place.
        positions[w] = nan
        orientations[w] = nan
        row = times[w if times.shape[0] > 1 else 0]
        world.output_room = world.output_count = row.size
        while not isfinite(row[world.output_count - 1]):
            world.output_count -= 1
        world.times = row.ctypes.data
        world.positions = positions[w].ctypes.data
        world.orientations = orientations[w].ctypes.data if orientations.shape[1] > 0 else 0
        status[w] = _roll_world(world, moving, step)


@kernel
def _roll_world(world, moving, step):
    """Roll out one world from its bodies' initial states; return its status.

    Parameters
    ----------
    moving : so many of its bodies move, the others are static boxes
    step : s
    """
    threshold = rebound_threshold(world, step)
    _part_start(world, moving)
    end = output_time(world, world.output_count - 1)
    steps = 0
    while steps * step < end - TIME_ROUNDING:
        left = 1 + int((end - TIME_ROUNDING) / step) - steps
        count = max(1, min(left, mark_islands(world, moving, step)))
        awake = False
        for root in range(moving):
            if body_at(world, root).island == root:
                awake = carry_island(world, moving, root, steps, count, step, threshold) or awake
        for i in range(moving):
            body = body_at(world, i)
            if not isfinite(_sum(load(body.position)) + _sum(load(body.velocity))):
                return NOT_FINITE
        steps += count
        if not awake:
            break
    for i in range(moving):
        write_rest(world, i, inf)
    return OK


@fast_inlined
def _sum(a):
    return a[0] + a[1] + a[2]


@kernel
def _part_start(world, moving):
    """Move what overlaps at the start apart: noisy states of touching things overlap a little."""
    for i in range(world.body_count):
        body_at(world, i).member = i
    part_overlaps(world, find_contacts(world, moving, world.body_count))
    for i in range(moving):
        write_rest(world, i, 0.0)
