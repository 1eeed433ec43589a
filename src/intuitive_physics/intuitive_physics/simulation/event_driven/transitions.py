"""After an event: which contacts last, and how its objects move until the next one."""

from __future__ import annotations

from numba import njit

from intuitive_physics.simulation.event_driven.clusters import gather, plan_cluster, stop_jam
from intuitive_physics.simulation.event_driven.contact_phases import PRESSES, STILL, plan_alone
from intuitive_physics.simulation.event_driven.detection import (
    position_at,
    predict_object_impacts,
    predict_plane_impacts,
)
from intuitive_physics.simulation.event_driven.motion import advance
from intuitive_physics.simulation.event_driven.world import plane_gap
from intuitive_physics.simulation.vectors import add_scaled, dot, load, norm, scaled, store, sub

JAM_GAP = 1e-7
"""m. Objects nearer than this take part in a jam."""

CLUSTER_SPEED = 1e-3
"""m/s. Normal velocity that a cluster's solver may leave on a contact that lasts."""


@njit(cache=True)
def replan(world, i, times, positions, orientations):
    """Plan anew the motion of object i, and of all that touch it, from its present time on."""
    count = gather(world, i)
    now = world.objects[i].time
    in_cluster = False
    for k in range(count):
        advance(world, world.objects[k].member, now, times, positions, orientations)
        in_cluster = in_cluster or world.objects[world.objects[k].member].clustered == 1
    _settle_contacts(world, count, CLUSTER_SPEED if in_cluster else STILL)
    count = gather(world, i)
    if not _plan_apart(world, count):
        plan_cluster(world, count)
    elif in_cluster:
        _settle_contacts(world, count, STILL)
        for k in range(count):
            world.objects[world.objects[k].member].clustered = 0
            plan_alone(world, world.objects[k].member)
    for k in range(count):
        predict_plane_impacts(world, world.objects[k].member)
    for k in range(count):
        predict_object_impacts(world, world.objects[k].member, times[-1])


@njit(cache=True)
def end_jam(world, i, times, positions, orientations):
    """Resolve at once all contacts around object i, whose impacts find no end."""
    find_touching(world, i, JAM_GAP)
    count = gather(world, i)
    for k in range(count):
        member = world.objects[k].member
        advance(world, member, world.objects[i].time, times, positions, orientations)
    stop_jam(world, count)


@njit(cache=True)
def find_touching(world, i, tolerance):
    """Take note of all that object i touches besides what is known, within `tolerance` (m)."""
    body = world.objects[i]
    for p in range(world.planes.size):
        if abs(plane_gap(body, world.planes[p])) < tolerance:
            world.touches_plane[i, p] = True
    for j in range(world.objects.size):
        if j != i:
            apart = sub(position_at(body, body.time), position_at(world.objects[j], body.time))
            gap = norm(apart) - body.radius - world.objects[j].radius
            if abs(gap) < tolerance:
                world.touches_object[i, j] = world.touches_object[j, i] = True


@njit(cache=True)
def _plan_apart(world, count):
    """Plan each member by itself; False where a contact between them or with a plane presses."""
    for k in range(count):
        if not plan_alone(world, world.objects[k].member):
            return False
    for k in range(count):
        i = world.objects[k].member
        body = world.objects[i]
        for j in range(world.objects.size):
            if world.touches_object[i, j]:
                other = world.objects[j]
                apart = sub(load(body.position), load(other.position))
                relative = sub(load(body.acceleration), load(other.acceleration))
                if dot(relative, apart) < -PRESSES * norm(apart):
                    return False
    return True


@njit(cache=True)
def _settle_contacts(world, count, tolerance):
    """Keep contacts that neither part nor close; the others are for the detection again."""
    for k in range(count):
        i = world.objects[k].member
        body = world.objects[i]
        for p in range(world.planes.size):
            if world.touches_plane[i, p]:
                n = load(world.planes[p].normal)
                speed = dot(load(body.velocity), n)
                if abs(speed) > tolerance:
                    world.touches_plane[i, p] = False
                else:
                    lift_onto(body, world.planes[p])
                    store(body.velocity, add_scaled(load(body.velocity), n, -speed))
        for j in range(world.objects.size):
            if world.touches_object[i, j]:
                other = world.objects[j]
                apart = sub(load(body.position), load(other.position))
                relative = sub(load(body.velocity), load(other.velocity))
                if abs(dot(relative, apart)) > tolerance * norm(apart):
                    world.touches_object[i, j] = False
                    world.touches_object[j, i] = False
                else:
                    part_overlap(body, other)


@njit(cache=True)
def lift_onto(body, plane):
    """Move a body along a plane's normal until it touches the plane."""
    moved = add_scaled(load(body.position), load(plane.normal), -plane_gap(body, plane))
    store(body.position, moved)


@njit(cache=True)
def part_overlap(one, other):
    """Move two overlapping bodies apart, the lighter one further."""
    apart = sub(load(one.position), load(other.position))
    distance = norm(apart)
    overlap = one.radius + other.radius - distance
    if overlap <= 0.0:
        return
    n = scaled(apart, 1.0 / distance) if distance > 0.0 else (0.0, 0.0, 1.0)
    share = overlap / (one.mass + other.mass)
    store(one.position, add_scaled(load(one.position), n, share * other.mass))
    store(other.position, add_scaled(load(other.position), n, -share * one.mass))
