"""Fill a world's records from a batch's arrays."""

from __future__ import annotations

from math import inf

from intuitive_physics.geometry.vectors import add, cross, load, norm, store
from intuitive_physics.kernels import kernel
from intuitive_physics.simulation.rigid_bodies.poses import (
    set_inverse_inertia,
    set_rotation,
    turned,
)
from intuitive_physics.simulation.rigid_bodies.world import body_at, plane_at
from intuitive_physics.simulation.world_batch import BOX, CAPSULE, SPHERE


@kernel
def place_object(
    body,
    kind,
    dimensions,
    material,
    state,
    air_factors,
    lever,
    volume,
    density,
    unit_inertia,
    inertia_ratio,
):
    """Fill in a body that moves; see `WorldBatch` for the arrays."""
    place_shape(body, kind, dimensions, material, state)
    for k in range(3):
        body.velocity[k] = state[7 + k]
        body.spin[k] = state[10 + k]
        body.inertia[k] = density * unit_inertia[k]
        body.centre_offset[k] = lever[k]
    _set_centre_of_mass(body)
    _set_inverses(body)
    body.inverse_mass = 1.0 / (density * volume)
    body.inertia_ratio = inertia_ratio
    body.drag, body.magnus = air_factors[0], air_factors[1]
    set_inverse_inertia(body)
    _set_closed_form(body)


@kernel
def _set_closed_form(body):
    """Fill in what a sphere needs whose motion is taken in closed form, if this one's can be."""
    heavy_outside = body.off_centre == 1 or body.round == 0
    in_air = body.drag != 0.0 or body.magnus != 0.0
    body.exact = body.kind == SPHERE and not heavy_outside and not in_air
    body.followed = body.clustered = body.rounds_edge = body.touched_count = 0
    body.mass = 1.0 / body.inverse_mass
    body.rolling_share = 1.0 / (1.0 + body.inertia_ratio)
    body.spin_gain = 1.0 / body.inertia_ratio
    body.slip_gain = 1.0 + body.spin_gain
    body.time, body.phase_end, body.impact_time = 0.0, inf, inf
    body.impact_solid = -1


@kernel
def _set_centre_of_mass(body):
    """Let a body move about its centre of mass: the state's velocity is that of the shape's."""
    size = norm(load(body.centre_offset))
    if size > 0.0:
        body.off_centre = 1
        body.reach += 2.0 * size
        arm = turned(body, load(body.centre_offset))
        store(body.velocity, add(load(body.velocity), cross(load(body.spin), arm)))


@kernel
def place_static_box(body, box, material):
    """Fill in a box that never moves: centre, orientation, edge lengths."""
    place_shape(body, BOX, box[7:10], material, box)
    for k in range(3):
        body.start_position[k] = box[k]
    body.inverse_mass = 0.0


@kernel
def place_shape(body, kind, dimensions, material, pose):
    """Fill in what a body is and where: `pose` begins with its centre and orientation."""
    _reset(body, kind, material)
    for k in range(3):
        body.position[k] = pose[k]
    for k in range(4):
        body.orientation[k] = pose[3 + k]
    _set_size(body, kind, dimensions)
    set_rotation(body)


@kernel
def _reset(body, kind, material):
    body.kind, body.material = kind, material
    body.drag = body.magnus = 0.0
    body.pressed = body.asleep = body.next_output = body.warm_starts = 0
    body.behind = body.off_centre = 0
    for k in range(3):
        body.velocity[k] = body.spin[k] = body.half_extents[k] = 0.0
    for k in range(9):
        body.inverse_inertia[k] = 0.0


@kernel
def _set_inverses(body):
    a, b, c = load(body.inertia)
    store(body.own_inverse_inertia, (1.0 / a, 1.0 / b, 1.0 / c))
    store(body.euler, ((b - c) / a, (c - a) / b, (a - b) / c))
    body.round = a == b == c


@kernel
def _set_size(body, kind, dimensions):
    body.radius = 0.0 if kind == BOX else dimensions[0]
    body.thinness = body.radius
    if kind == BOX:
        for k in range(3):
            body.half_extents[k] = 0.5 * dimensions[k]
        body.thinness = min(min(dimensions[0], dimensions[1]), dimensions[2]) * 0.5
    elif kind == CAPSULE:
        body.half_extents[2] = 0.5 * dimensions[1]
    body.reach = body.radius + norm(load(body.half_extents))


@kernel
def place_plane(plane, numbers, material, corners, boundary):
    """Fill in a plane: normal and offset, and number and address of its corners."""
    for k in range(3):
        plane.normal[k] = numbers[k]
    plane.offset = numbers[3]
    plane.material = material
    plane.corners, plane.boundary = corners, boundary


@kernel
def place_environment(world, worlds, e):
    """Fill in what never moves in environment e of a batch, the boxes behind the bodies that do."""
    world.plane_count = worlds.plane_counts[e]
    world.body_count = world.moving + worlds.box_counts[e]
    for b in range(worlds.box_counts[e]):
        box = body_at(world, world.moving + b)
        place_static_box(box, worlds.boxes[e, b], worlds.box_materials[e, b])
    for p in range(world.plane_count):
        place_plane(
            plane_at(world, p),
            worlds.planes[e, p],
            worlds.plane_materials[e, p],
            worlds.corner_counts[e, p],
            worlds.corners[e, p].ctypes.data,
        )
