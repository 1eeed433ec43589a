"""What a sphere touches in contacts that last."""

from __future__ import annotations

from intuitive_physics.geometry.vectors import add_scaled, load, norm, scaled, store, sub
from intuitive_physics.kernels import inlined, kernel
from intuitive_physics.simulation.rigid_bodies.solids import solid_at
from intuitive_physics.simulation.rigid_bodies.world import MOST_TOUCHED, body_at
from intuitive_physics.simulation.rollout import TOO_MANY_CONTACTS
from intuitive_physics.simulation.world_record import coefficient


@inlined
def solid_coefficient(world, kind, i, s):
    """One of the four coefficients between sphere i and solid s."""
    return coefficient(world, kind, body_at(world, i).material, solid_at(world, s).material)


@inlined
def pair_coefficient(world, kind, i, j):
    """One of the four coefficients between spheres i and j."""
    return coefficient(world, kind, body_at(world, i).material, body_at(world, j).material)


@inlined
def touches(body, s):
    """Whether a body is in lasting contact with solid s."""
    found = False
    for k in range(body.touched_count):
        found = found or body.touched[k] == s
    return found


@kernel
def touch(world, body, s):
    """Take note that a body touches solid s."""
    if touches(body, s):
        return
    if body.touched_count == MOST_TOUCHED:
        world.status = TOO_MANY_CONTACTS
    else:
        body.touched[body.touched_count] = s
        body.touched_count += 1


@inlined
def forget_touched(body, k):
    """Strike out the k-th solid a body touches; the last one takes its place."""
    body.touched_count -= 1
    body.touched[k] = body.touched[body.touched_count]


@inlined
def lift(body, n, gap):
    """Move a body along the normal n so that a gap (m) closes."""
    store(body.position, add_scaled(load(body.position), n, -gap))


@kernel
def part_overlap(one, other):
    """Move two overlapping bodies apart, the lighter one further; return whether they did."""
    apart = sub(load(one.position), load(other.position))
    distance = norm(apart)
    overlap = one.radius + other.radius - distance
    if not overlap > 0.0:
        return False
    n = scaled(apart, 1.0 / distance) if distance > 0.0 else (0.0, 0.0, 1.0)
    share = overlap / (one.mass + other.mass)
    store(one.position, add_scaled(load(one.position), n, share * other.mass))
    store(other.position, add_scaled(load(other.position), n, -share * one.mass))
    return True
