"""Bodies that collide do not enter one another, by a check that shares nothing with the engines.

Two convex solids are apart exactly if a plane parts them. For boxes its normal is one of 15: the
face normals of both, and the cross products of their edges (separating-axis theorem). For a sphere
and a box it points to the sphere's centre from the nearest point of the box.
"""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from intuitive_physics.geometry.rotations import rotation_matrix
from intuitive_physics.shapes import Box, Sphere

from .laws_scenes import (
    EVENT_DRIVEN,
    FLOOR,
    STEPPED,
    Body,
    G,
    coefficients,
    engines,
    make_scene,
    random_quaternion,
)

TIMES = np.arange(1, 241) * 0.005
DEEPEST = 5e-5
"""m. Twice what `stepped` lets a contact that presses sink, and a little for impacts."""
PARALLEL = 1e-6
"""Length of the cross product of two edges, unit vectors, below which they are parallel."""


def separation_of_boxes(centres, turns, edges):
    """Greatest gap (n,) along an axis of 15, m, negative where two boxes overlap.

    `centres` (2, n, 3), `turns` (2, n, 3, 3), `edges` (2, 3).
    """
    axes = [turns[k, :, :, i] for k in range(2) for i in range(3)]
    axes += [np.cross(turns[0, :, :, i], turns[1, :, :, j]) for i in range(3) for j in range(3)]
    apart = np.full(centres.shape[1], -np.inf)
    for axis in axes:
        length = np.linalg.norm(axis, axis=1)
        axis = axis / np.maximum(length, PARALLEL)[:, None]
        half = sum(np.abs(np.einsum("nij,ni->nj", turns[k], axis)) @ edges[k] / 2 for k in range(2))
        gap = np.abs(np.einsum("ni,ni->n", axis, centres[0] - centres[1])) - half
        apart = np.where(length > PARALLEL, np.maximum(apart, gap), apart)
    return apart


def spinning_boxes(rng):
    """Edge lengths (2, 3) of two boxes that meet in the air, spinning, and their scene."""
    edges = rng.uniform(0.05, 0.3, size=(2, 3))
    away = rng.normal(size=3)
    away /= np.linalg.norm(away)
    velocity = -away * rng.uniform(1.0, 4.0) + rng.normal(size=3) * 0.3
    starts = ((0.6 * away, velocity), (np.zeros(3), np.zeros(3)))
    bodies = [
        Body(Box(tuple(size)), position, random_quaternion(rng), moving, 15 * rng.normal(size=3))
        for size, (position, moving) in zip(edges, starts, strict=True)
    ]
    return edges, make_scene(*bodies, planes=((0, 0, 1, -50.0),))


def test_spinning_boxes_do_not_enter_one_another() -> None:
    # What presses may get twice 20 µm deeper before its forces are sought again, what is apart not
    # at all.
    rng = np.random.default_rng(5)
    cases = [spinning_boxes(rng) for _ in range(150)]
    scenes = [scene for _, scene in cases]
    rollout = STEPPED.simulator.rollout(scenes, coefficients(mu=0.4, e=0.3), TIMES)
    assert not rollout.status.any()
    hits = 0
    for (edges, _), positions, orientations in zip(
        cases, rollout.positions, rollout.orientations, strict=True
    ):
        apart = separation_of_boxes(positions, rotation_matrix(orientations), edges)
        assert apart.min() > -DEEPEST
        hits += apart.min() < 0.01
    assert hits > 75


@pytest.mark.parametrize("spin", [5, 20, 40, 80])
def test_no_corner_of_a_spinning_box_dips_into_the_floor(spin) -> None:
    # A corner may be clear of the floor at both ends of a step and inside it in between.
    rng, times = np.random.default_rng(3), np.arange(1, 8001) * 2.5e-4
    signs = np.array(list(itertools.product((-0.5, 0.5), repeat=3)))
    for _ in range(30):
        edges, start = rng.uniform(0.1, 0.3, 3), random_quaternion(rng)
        turning = rng.normal(size=3)
        velocity = (rng.uniform(1, 4), 0.0, -rng.uniform(0, 4))
        turning *= spin / np.linalg.norm(turning)
        box = Body(Box(tuple(edges)), (0, 0, 0.35), start, velocity, turning)
        x, q = STEPPED.poses(make_scene(box), coefficients(mu=0.4, e=0.5), times)
        corners = np.einsum("tj,cj->tc", rotation_matrix(q[0])[:, 2], signs * edges)
        assert (x[0, :, None, 2] + corners).min() > -DEEPEST


@engines(EVENT_DRIVEN, STEPPED)
def test_spinning_ball_does_not_enter_a_box(engine) -> None:
    rng = np.random.default_rng(6)
    radius, centre, hits = 0.05, np.array([0.0, 0.0, 0.4]), 0
    for _ in range(60):
        edges, turned = rng.uniform(0.05, 0.5, size=3), random_quaternion(rng)
        away = rng.normal(size=3)
        away[2] = abs(away[2])
        start = centre + away / np.linalg.norm(away) * 0.8
        velocity = 3.0 * (centre - start) + rng.normal(size=3) * 0.3 + [0, 0, 0.5 * G / 3.0]
        ball = Body(Sphere(radius), start, velocity=velocity, spin=30 * rng.normal(size=3))
        scene = make_scene(ball, boxes=((centre, tuple(edges), turned),))
        path = engine.path(scene, coefficients(mu=0.4, e=0.6), TIMES)[0]
        beyond = np.abs((path - centre) @ rotation_matrix(turned)) - edges / 2
        apart = np.linalg.norm(np.maximum(beyond, 0.0), axis=1) - radius
        apart = np.where((beyond < 0).all(axis=1), -np.inf, apart)
        assert apart.min() > -DEEPEST
        hits += apart.min() < 0.01
    assert hits > 30


@engines(EVENT_DRIVEN, STEPPED)
def test_a_ball_that_is_pushed_to_a_wall_does_not_enter_it(engine):
    # Slow enough for no rebound, it is held by the wall; what touches may be 20 µm inside.
    rng, radius, scenes = np.random.default_rng(0), 0.1, []
    for _ in range(200):
        speed, aside = rng.uniform(0.05, 0.4), rng.uniform(-0.1, 0.1)
        apart = np.sqrt((2 * radius) ** 2 - aside**2) + rng.uniform(1e-4, 0.01)
        place = radius + rng.uniform(0.0, 0.002)
        still = Body(Sphere(radius), (place, 0, radius))
        pusher = Body(
            Sphere(radius),
            (place + apart, aside, radius),
            velocity=(-speed, 0, 0),
            spin=(0, -speed / radius, 0),
        )
        scenes.append(make_scene(still, pusher, planes=[FLOOR, (1, 0, 0, 0)]))
    theta = coefficients(0.3, mu_r=0.06, e=0.35)
    rollout = engine.simulator.rollout(scenes, theta, np.linspace(0.001, 0.4, 400))
    assert (rollout.status == 0).all()
    assert rollout.positions[:, 0, :, 0].min() > radius - 2.2e-5
