"""After an event: which contacts last, and how its objects move until the next one."""

from __future__ import annotations

from numba import njit

from intuitive_physics.simulation.event_driven.clusters import gather, plan_cluster
from intuitive_physics.simulation.event_driven.contact_phases import PRESSES, STILL, plan_alone
from intuitive_physics.simulation.event_driven.detection import (
    predict_object_impacts,
    predict_plane_impacts,
)
from intuitive_physics.simulation.event_driven.motion import advance
from intuitive_physics.simulation.vectors import add_scaled, dot, load, norm, scaled, store, sub

CLUSTER_SPEED = 1e-3
"""m/s. Normal velocity that a cluster's solver may leave on a contact that lasts."""


@njit(cache=True)
def replan(world, i, times, positions, orientations):
    """Plan anew the motion of object i, and of all that touch it, from its present time on."""
    count = gather(world, i)
    now = world.time[i]
    in_cluster = False
    for k in range(count):
        advance(world, world.members[k], now, times, positions, orientations)
        in_cluster = in_cluster or world.clustered[world.members[k]]
    _settle_contacts(world, count, CLUSTER_SPEED if in_cluster else STILL)
    count = gather(world, i)
    if not _plan_apart(world, count):
        plan_cluster(world, count)
    elif in_cluster:
        _settle_contacts(world, count, STILL)
        for k in range(count):
            world.clustered[world.members[k]] = False
            plan_alone(world, world.members[k])
    for k in range(count):
        predict_plane_impacts(world, world.members[k])
    for k in range(count):
        predict_object_impacts(world, world.members[k], times[-1])


@njit(cache=True)
def _plan_apart(world, count):
    """Plan each member by itself; False where a contact between them or with a plane presses."""
    for k in range(count):
        if not plan_alone(world, world.members[k]):
            return False
    for k in range(count):
        i = world.members[k]
        for j in range(world.radius.size):
            if world.touches_object[i, j]:
                apart = sub(load(world.position, i), load(world.position, j))
                relative = sub(load(world.acceleration, i), load(world.acceleration, j))
                if dot(relative, apart) < -PRESSES * norm(apart):
                    return False
    return True


@njit(cache=True)
def _settle_contacts(world, count, tolerance):
    """Keep contacts that neither part nor close; the others are for the detection again."""
    for k in range(count):
        i = world.members[k]
        for p in range(world.normal.shape[0]):
            if world.touches_plane[i, p]:
                n = load(world.normal, p)
                speed = dot(load(world.velocity, i), n)
                if abs(speed) > tolerance:
                    world.touches_plane[i, p] = False
                else:
                    gap = dot(load(world.position, i), n) - world.offset[p] - world.radius[i]
                    store(world.position, i, add_scaled(load(world.position, i), n, -gap))
                    store(world.velocity, i, add_scaled(load(world.velocity, i), n, -speed))
        for j in range(world.radius.size):
            if world.touches_object[i, j]:
                apart = sub(load(world.position, i), load(world.position, j))
                n = scaled(apart, 1.0 / norm(apart))
                closing = dot(sub(load(world.velocity, i), load(world.velocity, j)), n)
                if abs(closing) > tolerance:
                    world.touches_object[i, j] = False
                    world.touches_object[j, i] = False
                else:
                    part_overlap(world, i, j)


@njit(cache=True)
def part_overlap(world, i, j):
    """Move two overlapping objects apart, the lighter one further."""
    apart = sub(load(world.position, i), load(world.position, j))
    distance = norm(apart)
    overlap = world.radius[i] + world.radius[j] - distance
    if overlap <= 0.0:
        return
    n = scaled(apart, 1.0 / distance) if distance > 0.0 else (0.0, 0.0, 1.0)
    share = overlap / (world.mass[i] + world.mass[j])
    store(world.position, i, add_scaled(load(world.position, i), n, share * world.mass[j]))
    store(world.position, j, add_scaled(load(world.position, j), n, -share * world.mass[i]))
