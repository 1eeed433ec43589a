"""The loop over worlds."""

from __future__ import annotations

from math import inf

from intuitive_physics.geometry.vectors import load, norm
from intuitive_physics.kernels import entry, kernel
from intuitive_physics.simulation.core.islands import carry_bodies
from intuitive_physics.simulation.rigid_bodies.outputs import (
    TIME_ROUNDING,
    blank_rest,
    output_time,
    write_rest,
)
from intuitive_physics.simulation.rigid_bodies.placing import place_environment, place_object
from intuitive_physics.simulation.rigid_bodies.solids import place_solids
from intuitive_physics.simulation.rigid_bodies.world import (
    body_at,
    is_finite,
    pair_of,
    set_followed,
    set_member,
    sphere_contact_at,
)
from intuitive_physics.simulation.rollout import NOT_FINITE, OK, OutputArrays
from intuitive_physics.simulation.spheres.events import follow_from_start
from intuitive_physics.simulation.stepped.collision import find_contacts, part_overlaps
from intuitive_physics.simulation.stepped.parts import rebound_threshold
from intuitive_physics.simulation.world_batch import WorldArrays
from intuitive_physics.simulation.world_record import start_world, wanted_outputs


@entry
def roll_worlds(first, last, batch, results, scratch, settings):
    """Roll out the worlds `first` to `last` (exclusive) of a batch.

    `batch` is `WorldBatch.arrays`, `results` are `OutputArrays` as a plain tuple, to be filled,
    `scratch` (1,) is a WORLD whose arrays have room for the largest of the worlds, and `settings`
    are `CoreSimulator.settings`.
    """
    worlds, outputs = WorldArrays(*batch), OutputArrays(*results)
    step, most_events, closed_forms = settings
    world = scratch[0]
    world.most_events, world.closed_forms = most_events, closed_forms
    placed, placed_behind = -1, -1
    for w in range(first, last):
        start_world(world, worlds, w, outputs.stop)
        world.gravity_size = norm(load(world.gravity))
        world.moving = worlds.object_counts[w]
        for i in range(world.moving):
            material = worlds.object_materials[w, i]
            place_object(
                body_at(world, i),
                worlds.shape_kinds[w, i],
                worlds.dimensions[w, i],
                material,
                worlds.states[w, i],
                worlds.air_factors[w, i],
                worlds.mass_centres[w, i],
                worlds.volumes[w, i],
                worlds.density[worlds.parameter_index[w], material],
                worlds.unit_inertias[w, i],
                worlds.inertia_ratios[w, i],
            )
        environment = worlds.environment_index[w]
        if environment != placed or world.moving != placed_behind:
            placed, placed_behind = environment, world.moving
            place_environment(world, worlds, environment)
            place_solids(world, worlds, environment)
        times = outputs.times[w if outputs.times.shape[0] > 1 else 0]
        world.output_room = times.size
        world.output_count = wanted_outputs(times)
        world.times = times.ctypes.data
        world.positions = outputs.positions[w].ctypes.data
        turns = outputs.orientations.shape[1] > 0
        world.orientations = outputs.orientations[w].ctypes.data if turns else 0
        _roll_world(world, step)
        blank_rest(world, outputs.positions.shape[1])
        outputs.status[w] = world.status


@kernel
def _roll_world(world, step):
    """Roll out one world from its bodies' initial states; its record says how it ended."""
    end = output_time(world, world.output_count - 1)
    world.events = world.followed_count = 0
    for c in range(world.sphere_contact_room):
        sphere_contact_at(world, c).until = -1.0
    spheres_only = True
    for i in range(world.moving):
        for j in range(i):
            pair_of(world, i, j).touches = 0
        body = body_at(world, i)
        body.exact = body.exact * world.closed_forms
        spheres_only = spheres_only and body.exact == 1
        if not is_finite(body):
            world.status = NOT_FINITE
    if world.status != OK:
        return
    if spheres_only:
        for i in range(world.moving):
            set_followed(world, i, i)
        world.followed_count = world.moving
        follow_from_start(world, end)
    else:
        _part_start(world)
        total = 1 + int((end - TIME_ROUNDING) / step) if end > TIME_ROUNDING else 0
        carry_bodies(world, total, step, rebound_threshold(world, step))
        if world.status == OK:
            for i in range(world.moving):
                write_rest(world, i, inf)


@kernel
def _part_start(world):
    """Move what overlaps at the start apart: noisy states of touching objects overlap a little."""
    for i in range(world.body_count):
        set_member(world, i, i)
    part_overlaps(world, find_contacts(world, world.moving, world.body_count))
    for i in range(world.moving):
        write_rest(world, i, 0.0)
