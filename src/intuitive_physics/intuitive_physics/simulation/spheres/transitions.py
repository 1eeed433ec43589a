"""After an event: which contacts last, and how its spheres move until the next one."""

from __future__ import annotations

from intuitive_physics.geometry.vectors import add_scaled, dot, load, norm, store, sub
from intuitive_physics.kernels import kernel
from intuitive_physics.simulation.rigid_bodies.solids import solid_at
from intuitive_physics.simulation.rigid_bodies.world import body_at, followed_at, member_at, pair_of
from intuitive_physics.simulation.spheres.clusters import (
    gather,
    plan_cluster,
    stop_jam,
)
from intuitive_physics.simulation.spheres.contact_geometry import nearest
from intuitive_physics.simulation.spheres.contact_phases import (
    PRESSES,
    STILL,
    plan_alone,
)
from intuitive_physics.simulation.spheres.detection import (
    position_at,
    predict_solid_impacts,
    predict_sphere_impacts,
)
from intuitive_physics.simulation.spheres.touching import forget_touched, lift, part_overlap, touch

JAM_GAP = 1e-7
"""m. Objects nearer than this take part in a jam."""

CLUSTER_SPEED = 1e-3
"""m/s. Normal velocity that a cluster's solver may leave on a contact that lasts."""

LOST = 1e-4
"""m. A gap that no contact has that lasts."""


@kernel
def replan(world, i, count):
    """Plan again the motion of sphere i, and of all that touch it, from their present time on.

    They are the first `count` members that `gather` found.
    """
    roughly = False
    for k in range(count):
        body = body_at(world, member_at(world, k))
        roughly = roughly or body.clustered == 1 or body.rounds_edge == 1
    _settle_contacts(world, count, CLUSTER_SPEED if roughly else STILL)
    if count > 1:
        count = gather(world, i)
    if not _plan_apart(world, count):
        plan_cluster(world, count)
    elif roughly:
        _leave_cluster(world, count)
    for k in range(count):
        predict_solid_impacts(world, member_at(world, k))
    if world.followed_count > 1:
        for k in range(count):
            predict_sphere_impacts(world, member_at(world, k))


@kernel
def _leave_cluster(world, count):
    """Let members that can be planned by themselves go on with what lasts exactly."""
    clustered = False
    for k in range(count):
        body = body_at(world, member_at(world, k))
        clustered = clustered or body.clustered == 1
        body.clustered = 0
    if clustered:
        _settle_contacts(world, count, STILL)
        for k in range(count):
            plan_alone(world, member_at(world, k))


@kernel
def end_jam(world, i):
    """Resolve at once all contacts around sphere i, whose impacts find no end.

    All spheres must have been brought to its time.
    """
    find_touching(world, i, JAM_GAP)
    stop_jam(world, gather(world, i))


@kernel
def find_touching(world, i, tolerance):
    """Take note of all that sphere i touches besides what is known, within `tolerance` (m)."""
    body = body_at(world, i)
    for s in range(world.solid_count):
        gap, _, _, _ = nearest(world, solid_at(world, s), load(body.position), body.radius)
        if abs(gap) < tolerance:
            touch(world, body, s)
    for k in range(world.followed_count):
        j = followed_at(world, k)
        if j != i:
            other = body_at(world, j)
            apart = sub(load(body.position), position_at(other, body.time))
            if abs(norm(apart) - body.radius - other.radius) < tolerance:
                pair_of(world, i, j).touches = 1


@kernel
def _plan_apart(world, count):
    """Plan each member by itself; False where a contact between them or with a solid presses."""
    for k in range(count):
        if not plan_alone(world, member_at(world, k)):
            return False
    if count == 1:
        return True
    for k in range(count):
        i = member_at(world, k)
        body = body_at(world, i)
        for j in range(i):
            if pair_of(world, i, j).touches:
                other = body_at(world, j)
                apart = sub(load(body.position), load(other.position))
                relative = sub(load(body.acceleration), load(other.acceleration))
                if dot(relative, apart) < -PRESSES * norm(apart):
                    return False
    return True


@kernel
def _settle_contacts(world, count, tolerance):
    """Keep contacts that neither part nor close; the others are for the detection again."""
    for k in range(count):
        i = member_at(world, k)
        body = body_at(world, i)
        for t in range(body.touched_count - 1, -1, -1):
            solid = solid_at(world, body.touched[t])
            gap, n, _, _ = nearest(world, solid, load(body.position), body.radius)
            speed = dot(load(body.velocity), n)
            if abs(speed) > tolerance or gap > LOST:
                forget_touched(body, t)
            else:
                lift(body, n, gap)
                store(body.velocity, add_scaled(load(body.velocity), n, -speed))
        if count == 1:
            return
        for j in range(i):
            pair = pair_of(world, i, j)
            if pair.touches:
                other = body_at(world, j)
                apart = sub(load(body.position), load(other.position))
                relative = sub(load(body.velocity), load(other.velocity))
                if abs(dot(relative, apart)) > tolerance * norm(apart):
                    pair.touches = 0
                else:
                    part_overlap(body, other)


@kernel
def part_start(world):
    """Move what overlaps at the start apart: noisy states of touching spheres overlap a little."""
    for _ in range(20):
        moved = False
        for a in range(world.followed_count):
            one = body_at(world, followed_at(world, a))
            for b in range(a):
                other = body_at(world, followed_at(world, b))
                moved = part_overlap(one, other) or moved
        for a in range(world.followed_count):
            body = body_at(world, followed_at(world, a))
            for s in range(world.solid_count):
                solid = solid_at(world, s)
                gap, n, _, _ = nearest(world, solid, load(body.position), body.radius)
                if gap < 0.0:
                    lift(body, n, gap)
                    moved = True
        if not moved:
            return
