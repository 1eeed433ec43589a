"""The loops over worlds and steps."""

from __future__ import annotations

from math import inf, nan

from intuitive_physics.geometry.vectors import load, norm
from intuitive_physics.kernels import entry, kernel
from intuitive_physics.simulation.rigid_bodies.placing import place_environment, place_object
from intuitive_physics.simulation.rigid_bodies.world import body_at, set_member
from intuitive_physics.simulation.rollout import OK, OutputArrays
from intuitive_physics.simulation.stepped.collision import find_contacts, part_overlaps
from intuitive_physics.simulation.stepped.islands import carry_bodies
from intuitive_physics.simulation.stepped.motion import TIME_ROUNDING, output_time, write_rest
from intuitive_physics.simulation.stepped.parts import rebound_threshold
from intuitive_physics.simulation.world_batch import WorldArrays
from intuitive_physics.simulation.world_record import start_world, wanted_outputs


@entry
def roll_worlds(first, last, batch, results, scratch, step):
    """Roll out the worlds `first` to `last` (exclusive) of a batch.

    `batch` is `WorldBatch.arrays`, `results` are `OutputArrays` as a plain tuple, to be filled, and
    `scratch` (1,) is a WORLD whose arrays have room for the largest of the worlds.
    """
    worlds, outputs = WorldArrays(*batch), OutputArrays(*results)
    world = scratch[0]
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
        place_environment(world, worlds, worlds.environment_index[w])
        # What is never reached, and what is padding, has no place.
        outputs.positions[w] = nan
        outputs.orientations[w] = nan
        times = outputs.times[w if outputs.times.shape[0] > 1 else 0]
        world.output_room = times.size
        world.output_count = wanted_outputs(times)
        world.times = times.ctypes.data
        world.positions = outputs.positions[w].ctypes.data
        turns = outputs.orientations.shape[1] > 0
        world.orientations = outputs.orientations[w].ctypes.data if turns else 0
        _roll_world(world, world.moving, step)
        outputs.status[w] = world.status


@kernel
def _roll_world(world, moving, step):
    """Roll out one world from its bodies' initial states; its record says how it ended.

    The first `moving` bodies move; the others are static boxes.
    """
    threshold = rebound_threshold(world, step)
    _part_start(world, moving)
    end = output_time(world, world.output_count - 1)
    total = 1 + int((end - TIME_ROUNDING) / step) if end > TIME_ROUNDING else 0
    carry_bodies(world, moving, total, step, threshold)
    if world.status == OK:
        for i in range(moving):
            write_rest(world, i, inf)


@kernel
def _part_start(world, moving):
    """Move what overlaps at the start apart: noisy states of touching objects overlap a little."""
    for i in range(world.body_count):
        set_member(world, i, i)
    part_overlaps(world, find_contacts(world, moving, world.body_count))
    for i in range(moving):
        write_rest(world, i, 0.0)
