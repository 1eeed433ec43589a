"""Several spheres, and what must hold for any scene."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from intuitive_physics.shapes import Sphere
from intuitive_physics.simulation import WorldStatus
from intuitive_physics.simulation.core.engines import EventDrivenSimulator

from .laws_scenes import EVENT_DRIVEN, UPRIGHT, Body, coefficients, first_motion, make_scene

R = 0.05


@given(
    ratio=st.floats(0.3, 3.0),
    e=st.floats(0.0, 1.0),
    offset=st.floats(-0.8, 0.8),
    closing=st.floats(0.5, 5.0),
)
@settings(max_examples=100)
def test_collision_without_friction(ratio, e, offset, closing):
    # In free fall without friction: momentum is kept and the normal relative velocity becomes -e
    # times what it was: v1' = v1 + (1 + e) m2 / (m1 + m2) (v2 - v1)·n n.
    if e * closing * np.sqrt(1 - offset**2) < 6e-3:
        return
    r1, r2 = R, R * ratio
    reach = r1 + r2
    start = np.array([-0.5, offset * reach, 0.0])
    scene = make_scene(
        Body(Sphere(r1), (0, 0, 0)),
        Body(Sphere(r2), start, velocity=(closing, 0, 0)),
        planes=(),
        gravity=(0, 0, 0),
    )
    contact = np.array([-reach * np.sqrt(1 - offset**2), offset * reach, 0.0])
    t_hit = (contact[0] - start[0]) / closing
    after = EVENT_DRIVEN.path(scene, coefficients(0.0, e=e), [t_hit + 0.1, t_hit + 0.3])
    v1, v2 = (after[:, 1] - after[:, 0]) / 0.2
    m1, m2 = r1**3, r2**3
    n = -contact / reach
    v = np.array([closing, 0, 0])
    np.testing.assert_allclose(v1, (1 + e) * m2 / (m1 + m2) * (v @ n) * n, atol=1e-9)
    np.testing.assert_allclose(v2, v - (1 + e) * m1 / (m1 + m2) * (v @ n) * n, atol=1e-9)


@pytest.mark.parametrize("mu", [0.05, 1.0])
def test_momentum_is_kept_in_free_collisions(mu):
    # Linear: Σ m v. Angular about the origin: Σ (x × m v + 2/5 m r² ω). Both spins are steady.
    rng = np.random.default_rng(0)
    theta, gap = coefficients(mu, e=0.8), 1e-3
    for _ in range(8):
        radii = rng.uniform(0.03, 0.1, 2)
        direction = rng.normal(size=3)
        direction /= np.linalg.norm(direction)
        spins = rng.normal(size=(2, 3)) * 5.0
        velocity = -2.0 * direction + rng.normal(size=3) * 0.3
        apart = direction * (radii.sum() + 0.2)
        scene = make_scene(
            Body(Sphere(radii[0]), (0, 0, 0), spin=spins[0]),
            Body(Sphere(radii[1]), apart, velocity=velocity, spin=spins[1]),
            planes=(),
            gravity=(0, 0, 0),
        )
        linear, angular = first_motion(scene).momentum(scene, theta)
        after = EVENT_DRIVEN.motion(scene, theta, 0.5, gap).momentum(scene, theta)
        mass = sum(thing.shape.mass(500.0) for thing in scene.objects)
        np.testing.assert_allclose(after[0], linear, atol=1e-7 * mass)
        np.testing.assert_allclose(after[1], angular, atol=1e-9 * mass)


def test_newtons_cradle():
    # Equal frictionless balls at e = 1 in a row: the last takes the whole velocity.
    balls = [Body(Sphere(R), (0.2 + 2 * R * k, 0, R)) for k in range(4)]
    scene = make_scene(Body(Sphere(R), (0, 0, R), velocity=(1.0, 0, 0)), *balls)
    path = EVENT_DRIVEN.path(scene, coefficients(0.0, e=1.0), [0.2, 1.2])
    moved = (path[:, 1] - path[:, 0])[:, 0]
    np.testing.assert_allclose(moved, [0, 0, 0, 0, 1.0], atol=1e-9)


def test_ball_falls_off_a_ball():
    # A ball balanced on another stays only without any push; slightly beside, it must come down.
    scene = make_scene(Body(Sphere(R), (0, 0, R)), Body(Sphere(R), (0.004, 0, 3 * R - 0.0001)))
    path = EVENT_DRIVEN.path(scene, coefficients(0.4, mu_s=0.5, mu_r=0.02, e=0.1), [5.0])[:, 0]
    np.testing.assert_allclose(path[:, 2], R, atol=1e-6)
    assert np.linalg.norm(path[0] - path[1]) >= 2 * R - 1e-6


@pytest.mark.parametrize("seed", [3, 5, 9])
def test_pile_of_balls_comes_to_rest_without_overlap(seed):
    rng = np.random.default_rng(seed)
    balls = [Body(Sphere(R), (*rng.uniform(-0.06, 0.06, 2), 0.1 + 0.12 * k)) for k in range(8)]
    tray = [(0, 0, 1, 0), (1, 0, 0, -0.12), (-1, 0, 0, -0.12), (0, 1, 0, -0.12), (0, -1, 0, -0.12)]
    scene = make_scene(*balls, planes=tray)
    path = EVENT_DRIVEN.path(scene, coefficients(0.4, mu_s=0.5, mu_r=0.05, e=0.2), [8.0, 10.0])
    ends = path[:, 1]
    assert np.linalg.norm(path[:, 1] - path[:, 0], axis=1).max() < 2e-3
    gaps = np.linalg.norm(ends[:, None] - ends[None], axis=2)[np.triu_indices(8, 1)] - 2 * R
    assert gaps.min() > -1e-4
    assert ends[:, 2].min() > R - 1e-6


def test_event_cap_is_reported():
    # e = 1 between two walls a hair apart: without a cap this would take 1e7 events.
    walls = [(1, 0, 0, 0), (-1, 0, 0, -2 * R - 1e-6)]
    scene = make_scene(Body(Sphere(R), (R + 5e-7, 0, 0), UPRIGHT, (1.0, 0, 0)), planes=walls)
    rollout = EventDrivenSimulator(max_events=1000).rollout(
        [scene, make_scene(Body(Sphere(R), (0, 0, 1)))],
        coefficients(0.4, mu_s=0.5, e=1.0),
        [0.0, 10.0],
    )
    assert rollout.status[0] == WorldStatus.TOO_MANY_EVENTS
    assert np.isnan(rollout.positions[0, 0, 1]).all()
    assert rollout.status[1] == WorldStatus.OK
