"""The motion of a body over one part of a step, and the outputs on the way.

Over a part, acceleration and torque are constant. Positions are then exact; orientations follow
one mean rotation vector: in free flight by a Magnus series of fourth order over Euler's equations,
under contact forces of second order. The angular momentum, not the spin, is carried along: so a
body in free flight keeps it to rounding, and its kinetic energy to fourth order.
"""

from __future__ import annotations

from math import sqrt

from intuitive_physics.geometry.vectors import (
    add,
    add_scaled,
    cross,
    dot,
    load,
    norm,
    scaled,
    store,
    sub,
)
from intuitive_physics.kernels import fast_inlined, kernel
from intuitive_physics.simulation.rigid_bodies.outputs import (
    TIME_ROUNDING,
    output_time,
    write_orientation,
    write_position,
)
from intuitive_physics.simulation.rigid_bodies.poses import (
    angular_momentum,
    centre_of_mass,
    rotate,
    set_rotation,
    turned,
)
from intuitive_physics.simulation.rigid_bodies.world import body_at, times, transposed_times
from intuitive_physics.simulation.world_batch import SPHERE

LARGEST_TURN = 1.0
"""rad that a body of unequal moments of inertia turns at most in a part of a step."""

QUIET_SPEED = 1e-3
"""m/s. A body no point of which moves faster is still, and sleeps if it is balanced."""


@kernel
def free_acceleration(world, body, duration):
    """Gravity and the air's forces, these at the middle of the part, in m/s²."""
    gravity = load(world.gravity)
    if body.drag == 0.0 and body.magnus == 0.0:
        return gravity
    velocity = load(body.velocity)
    start = add(gravity, _air(body, velocity))
    return add(gravity, _air(body, add_scaled(velocity, start, 0.5 * duration)))


@fast_inlined
def _air(body, velocity):
    braking = scaled(velocity, -body.drag * norm(velocity))
    force = add_scaled(braking, cross(load(body.spin), velocity), body.magnus)
    return scaled(force, body.inverse_mass)


@fast_inlined
def is_still(body, velocity, spin):
    """Whether no point of the body moves faster than QUIET_SPEED."""
    rim = scaled(spin, body.reach)
    return dot(velocity, velocity) + dot(rim, rim) < QUIET_SPEED * QUIET_SPEED


@kernel
def begin(body):
    """Note the state at the start of a part of a step."""
    store(body.start_position, centre_of_mass(body))
    for k in range(3):
        body.start_velocity[k] = body.velocity[k]
        body.start_spin[k] = body.spin[k]
    for k in range(4):
        body.start_orientation[k] = body.orientation[k]
    store(body.angular_momentum, angular_momentum(body))
    body.placed_after = 0.0


@kernel
def plan_flight(world, body, duration):
    """Let a body that begins a part of a step fly freely over it."""
    acceleration = free_acceleration(world, body, duration)
    store(body.acceleration, acceleration)
    store(body.path_acceleration, acceleration)
    store(body.path_velocity, load(body.start_velocity))
    store(body.torque, (0.0, 0.0, 0.0))
    body.pressed = 0
    spin = load(body.start_spin)
    if body.round == 1:
        store(body.turning, spin)
        return
    euler = load(body.euler)
    r = duration
    w0 = transposed_times(body.rotation, spin)
    k1 = _euler(euler, w0)
    k2 = _euler(euler, add_scaled(w0, k1, 0.5 * r))
    k3 = _euler(euler, add_scaled(w0, k2, 0.5 * r))
    k4 = _euler(euler, add_scaled(w0, k3, r))
    w1 = add_scaled(w0, add(add(k1, k4), scaled(add(k2, k3), 2.0)), r / 6.0)
    ends = add(w0, w1)
    slope = sub(k1, _euler(euler, w1))
    # Simpson's rule with the middle of the cubic through both ends, and the Magnus commutator.
    mean = add_scaled(scaled(ends, 0.5), slope, r / 12.0)
    store(body.turning, turned(body, add_scaled(mean, cross(w0, w1), r / 12.0)))


@fast_inlined
def _euler(euler, w):
    """Euler's equations without torque: dω/dt in the body's axes."""
    return euler[0] * w[1] * w[2], euler[1] * w[2] * w[0], euler[2] * w[0] * w[1]


@kernel
def plan_pressed(body, duration):
    """Let a body move so that it reaches, over a part of a step, the velocities it now holds.

    While its contacts are steady, so that sliding and rolling are exact, it moves by the mean of
    its first and last velocities. Where a contact still parts or closes it moves by the last ones
    alone, which damps that play.
    """
    velocity, spin = load(body.velocity), load(body.spin)
    start, start_spin = load(body.start_velocity), load(body.start_spin)
    store(body.acceleration, scaled(sub(velocity, start), 1.0 / duration))
    momentum = angular_momentum(body)
    store(body.torque, scaled(sub(momentum, load(body.angular_momentum)), 1.0 / duration))
    mean = spin
    store(body.path_velocity, velocity)
    store(body.path_acceleration, (0.0, 0.0, 0.0))
    if body.steady == 1:
        mean = scaled(add(start_spin, spin), 0.5)
        store(body.path_velocity, start)
        store(body.path_acceleration, load(body.acceleration))
    if body.round == 0:
        w = transposed_times(body.rotation, mean)
        mean = add_scaled(mean, turned(body, _euler(load(body.euler), w)), 0.5 * duration)
    store(body.turning, mean)


@kernel
def place(body, after):
    """Put a body where it is `after` (s) the start of its part of a step."""
    if body.placed_after == after:
        return
    body.placed_after = after
    moved = add_scaled(load(body.start_position), load(body.path_velocity), after)
    store(body.position, add_scaled(moved, load(body.path_acceleration), 0.5 * after * after))
    if body.kind != SPHERE:
        rotate(body, body.start_orientation, scaled(load(body.turning), after))
        set_rotation(body)
        if body.off_centre == 1:
            store(body.position, sub(load(body.position), turned(body, load(body.centre_offset))))


@kernel
def finish(body, after):
    """End a body's part of a step `after` (s) its start, where `place` has put it."""
    velocity = add_scaled(load(body.start_velocity), load(body.acceleration), after)
    store(body.velocity, velocity)
    momentum = add_scaled(load(body.angular_momentum), load(body.torque), after)
    if body.kind == SPHERE:
        store(body.spin, scaled(momentum, body.own_inverse_inertia[0]))
        return
    local, inverse = transposed_times(body.rotation, momentum), load(body.own_inverse_inertia)
    w = local[0] * inverse[0], local[1] * inverse[1], local[2] * inverse[2]
    store(body.spin, turned(body, w))


@kernel
def keep_turning_energy(body, after):
    """Let a body's spin have the energy of its motion, `after` (s) the start of its part of a step.

    Turning alone changes neither angular momentum L nor L · ω / 2, but a finite turn of a body of
    unequal moments of inertia keeps only the first. The inverse inertia is that of the start.
    """
    if body.round == 1:
        return
    momentum = add_scaled(load(body.angular_momentum), load(body.torque), after)
    kept = dot(momentum, times(body.inverse_inertia, momentum))
    has = dot(momentum, load(body.spin))
    if has > 0.0:
        store(body.spin, scaled(load(body.spin), sqrt(kept / has)))


@fast_inlined
def turned_by(body, after):
    """Rotation vector (rad) of a body `after` (s) the start of its part of a step.

    That of a sphere, whose moments of inertia are alike, is ω τ + α τ² / 2.
    """
    if body.kind != SPHERE:
        return scaled(load(body.turning), after)
    mean = 0.5 * after * body.own_inverse_inertia[0]
    return scaled(add_scaled(load(body.start_spin), load(body.torque), mean), after)


@kernel
def write_outputs(world, i, start, after):
    """Write body i's outputs from time `start` up to `after` (s) later."""
    body = body_at(world, i)
    k = body.next_output
    end = start + after + TIME_ROUNDING
    if k < world.output_count and output_time(world, k) <= end:
        position, velocity = load(body.start_position), load(body.path_velocity)
        acceleration = load(body.path_acceleration)
        while k < world.output_count and output_time(world, k) <= end:
            tau = output_time(world, k) - start
            moved = add_scaled(position, velocity, tau)
            moved = add_scaled(moved, acceleration, 0.5 * tau * tau)
            if world.orientations != 0 or body.off_centre == 1:
                rotate(body, body.start_orientation, turned_by(body, tau))
            if body.off_centre == 1:
                set_rotation(body)
                moved = sub(moved, turned(body, load(body.centre_offset)))
            write_position(world, i, k, moved)
            if world.orientations != 0:
                write_orientation(world, i, k)
            k += 1
        body.next_output = k
        # The orientation is now that of an output.
        body.placed_after = -1.0
