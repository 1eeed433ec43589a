"""Impacts: bounces, collisions, and that nothing passes through anything."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from intuitive_physics.scene import Plane
from intuitive_physics.shapes import Box, Capsule, Sphere
from intuitive_physics.simulation import pack_worlds

from .laws_scenes import (
    BULLET,
    EVENT_DRIVEN,
    LYING_ALONG_X,
    LYING_ALONG_Y,
    STEPPED,
    UPRIGHT,
    Body,
    G,
    coefficients,
    engines,
    first_motion,
    make_scene,
    motion_between,
    random_quaternion,
)

R = 0.05


@pytest.mark.parametrize("e", [0.0, 0.2, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.99, 1.0])
@engines()
def test_bounce_heights(engine, e):
    # Dropped from h: peak k is e^(2k) h, reached at t1 (1 + 2 (e + … + e^(k-1)) + e^k),
    # t1 = sqrt(2 h / g).
    h = 1.0
    t1 = np.sqrt(2 * h / G)
    peaks = [t1 * (1 + 2 * sum(e**j for j in range(1, k)) + e**k) for k in range(1, 5)]
    scene = make_scene(Body(Sphere(R), (0, 0, h + R)))
    times = [t1 + 0.1] if e == 0.0 else peaks
    heights = engine.path(scene, coefficients(e=e), times)[0, :, 2] - R
    truth = np.array([e ** (2 * k) * h for k in range(1, 1 + len(times))])
    # A rebound below the rest speed is none; an impact that comes late by τ ends v τ deeper, with
    # g τ more speed, and the k bounces add.
    v = np.sqrt(2 * G * h)
    late = 2 * v * (engine.delay + 0.5 * engine.flight_step) * np.arange(1, 1 + len(times))
    rest = engine.rest_speed**2 / (2 * G)
    assert (np.abs(heights - truth) <= rest + late + engine.gap).all(), heights - truth


@pytest.mark.parametrize("shape", [Box((0.2, 0.2, 0.1)), Capsule(R, 0.2)], ids=lambda s: s.kind)
@engines(STEPPED)
def test_flat_landings_bounce_like_a_point(engine, shape):
    # All contacts of a flat landing share one normal velocity: no spin, and the peak is e² h.
    e, h = 0.7, 0.5
    lying, half = (UPRIGHT, 0.05) if isinstance(shape, Box) else (LYING_ALONG_X, R)
    t = np.sqrt(2 * h / G) * (1 + e)
    scene = make_scene(Body(shape, (0, 0, h + half), lying))
    x, q = engine.poses(scene, coefficients(e=e), [t])
    assert x[0, 0, 2] - half == pytest.approx(e**2 * h, abs=engine.gap + 1e-3)
    assert abs(q[0, 0] @ lying) == pytest.approx(1.0, abs=1e-6)


@engines(EVENT_DRIVEN, STEPPED)
def test_a_lone_body_moves_alike_whatever_its_density(engine):
    # All forces and impulses of contacts are proportional to its mass, which cancels. Another
    # density only rounds differently, and no rounding decides whether a corner slips or rolls.
    rng = np.random.default_rng(0)
    scenes = []
    for _ in range(10):
        velocity, spin = rng.normal(0.0, (1.0, 1.0, 0.5)), rng.normal(0.0, 0.1, 3)
        shape = Box((0.45, 0.6, 0.28))
        scenes.append(make_scene(Body(shape, (0, 0, 1.0), velocity=velocity, spin=spin)))
    paths = [
        engine.simulator.rollout(
            scenes, coefficients(0.41, 0.48, 0.04, 0.5, density), np.array([1.0, 2.0])
        ).positions
        for density in (500.0, 970.0)
    ]
    # What rounding may grow to while a box that lands nearly flat rattles from corner to corner.
    np.testing.assert_allclose(paths[1], paths[0], atol=1e-6)


def oblique(vt, vn, spin, mu, e):
    """Velocity and spin of a solid sphere after a bounce on the floor.

    J_n = (1 + e) m v_n; |J_t| = min(μ J_n, 2/7 m |s|), s = v_t - r ω; r ω' = r ω + 5/2 J_t / m.
    """
    slip = vt - R * spin
    push = np.sign(slip) * np.minimum(mu * (1 + e) * vn, 2 / 7 * np.abs(slip))
    return vt - push, e * vn, spin + 2.5 * push / R


@engines(EVENT_DRIVEN, STEPPED)
@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=10)
def test_oblique_bounces(engine, seed):
    # Position half way to the peak and at the peak of the bounce, and the spin, in closed form, for
    # balls that slip through the impact and for balls that stick.
    rng = np.random.default_rng(seed)
    n = 40
    vt, vn, spin = rng.uniform(0, 8, n), rng.uniform(1, 6, n), rng.uniform(-80, 80, n)
    mu, e = rng.uniform(0, 1, n), rng.uniform(0.3, 1, n)
    height = rng.uniform(0.01, 0.05, n)
    at_start = np.sqrt(vn**2 - 2 * G * height)
    t_hit = (vn - at_start) / G
    after_t, after_n, after_spin = oblique(vt, vn, spin, mu, e)
    up = after_n / G
    scenes = [
        make_scene(
            Body(
                Sphere(R), (0, 0, R + height[k]), UPRIGHT, (vt[k], 0, -at_start[k]), (0, spin[k], 0)
            )
        )
        for k in range(n)
    ]
    thetas = [coefficients(mu[k], e=e[k]) for k in range(n)]
    rows = np.stack([t_hit + 0.5 * up, t_hit + 0.51 * up, t_hit + up], axis=1)
    rollout = engine.simulator.rollout_batch(pack_worlds(scenes, thetas), rows)
    # A contact found within `gap` comes early or late by gap / v_n.
    off = 2 * engine.gap * (1 + (vt + R * np.abs(spin)) / vn + 1 / e)
    x = rollout.positions[:, 0]
    assert (np.abs(x[:, 0, 0] - vt * t_hit - 0.5 * after_t * up) <= off).all()
    assert (np.abs(x[:, 2, 0] - vt * t_hit - after_t * up) <= off).all()
    assert (np.abs(x[:, 2, 2] - R - 0.5 * after_n * up) <= off).all()
    for k in range(n):
        gap = rows[k, 1] - rows[k, 0]
        turned = motion_between(x[k : k + 1, :2], rollout.orientations[k, :1, :2], gap).spin[0]
        # The same gap changes v_n by g gap / v_n, and the spin by 5/(2 r) μ (1 + e) times that.
        change = 2.5 / R * 4 * G * engine.gap / vn[k]
        np.testing.assert_allclose(turned, (0, after_spin[k], 0), atol=1e-6 + change)


@pytest.mark.parametrize(("spin", "mu"), [(40.0, 0.1), (-60.0, 0.2), (10.0, 0.9), (0.0, 0.0)])
@engines(BULLET)
def test_oblique_bounce_of_the_witness(engine, spin, mu):
    # As above for one bounce in each regime; an impact late by τ shifts the path by |v| τ.
    vt, vn, e = 2.0, 3.0, 0.6
    after_t, after_n, _ = oblique(vt, vn, spin, mu, e)
    scene = make_scene(Body(Sphere(R), (0, 0, R), UPRIGHT, (vt, 0, -vn), (0, spin, 0)))
    t = after_n / G
    x = engine.path(scene, coefficients(mu, e=e), [t])[0, 0]
    off = 2 * engine.delay * (vn + vt)
    np.testing.assert_allclose(x, (after_t * t, 0, R + 0.5 * after_n * t), atol=off)


@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("ratio", [0.5, 1.0, 2.0])
@engines()
def test_two_balls_collide(engine, ratio, e):
    # Without friction and gravity: v1' = (1 + e) m2 / (m1 + m2) (v·n) n and v2' = v - (1 + e) m1 /
    # (m1 + m2) (v·n) n, n the line of centres at the touch, which is 0.3 of the radii off axis.
    r1, r2 = R, R * ratio
    reach = r1 + r2
    v = np.array([2.0, 0, 0])
    n = np.array([np.sqrt(1 - 0.3**2), -0.3, 0])
    t_hit = 0.1037
    scene = make_scene(
        Body(Sphere(r1), (0, 0, 0)),
        Body(Sphere(r2), -n * reach - v * t_hit, UPRIGHT, v),
        planes=(),
        gravity=(0, 0, 0),
    )
    x = engine.path(scene, coefficients(0.0, e=e), [t_hit + 0.1, t_hit + 0.3])
    v1, v2 = (x[:, 1] - x[:, 0]) / 0.2
    m1, m2 = r1**3, r2**3
    # A touch taken for one τ late, or `gap` m early, turns the line of centres by v_t τ / reach.
    off = 2 * (np.linalg.norm(v) * engine.delay + engine.gap) / reach * np.linalg.norm(v)
    np.testing.assert_allclose(v1, (1 + e) * m2 / (m1 + m2) * (v @ n) * n, atol=off)
    np.testing.assert_allclose(v2, v - (1 + e) * m1 / (m1 + m2) * (v @ n) * n, atol=off)


SPHERE, BOX, CAPSULE = Sphere(0.06), Box((0.1, 0.14, 0.2)), Capsule(0.05, 0.15)
PAIRS = [
    (SPHERE, SPHERE),
    (SPHERE, BOX),
    (SPHERE, CAPSULE),
    (BOX, BOX),
    (BOX, CAPSULE),
    (CAPSULE, CAPSULE),
]


def flying_pair(rng, first, second):
    """Two spinning bodies in free space, one of which flies at the other and meets it."""
    direction = rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    apart = first.bounding_radius + second.bounding_radius + 0.1
    velocity = -2.0 * direction + 0.2 * rng.normal(size=3)
    spins = rng.normal(size=(2, 3)) * 3.0
    return make_scene(
        Body(first, (0, 0, 0), random_quaternion(rng), (0, 0, 0), spins[0]),
        Body(second, apart * direction, random_quaternion(rng), velocity, spins[1]),
        planes=(),
        gravity=(0, 0, 0),
    )


@pytest.mark.parametrize("mu", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("shapes", PAIRS, ids=lambda pair: "-".join(s.kind for s in pair))
@engines(STEPPED)
def test_free_collisions_keep_momentum(engine, shapes, mu):
    # Σ m v and Σ (x × m v + I ω) stand still, energy never grows, and at e = 1 without friction it
    # stays.
    rng = np.random.default_rng(7)
    scenes = [flying_pair(rng, *shapes) for _ in range(24)]
    e = 1.0 if mu == 0.0 else 0.6
    theta = coefficients(mu, e=e)
    gap = 0.01
    rollout = engine.simulator.rollout(scenes, theta, [0.6, 0.6 + gap])
    hits = 0
    for k, scene in enumerate(scenes):
        before = first_motion(scene)
        after = motion_between(rollout.positions[k], rollout.orientations[k], gap)
        hits += np.linalg.norm(after.velocity[0]) > 0.1
        p0, l0 = before.momentum(scene, theta)
        p1, l1 = after.momentum(scene, theta)
        np.testing.assert_allclose(p1, p0, atol=1e-9 * np.linalg.norm(p0))
        # A spin read from two orientations is off by (|ω| gap)² / 12, |ω| up to 40 rad/s here.
        fastest = np.linalg.norm(after.spin, axis=1).max()
        reading = (fastest * gap) ** 2 / 12 + 1e-6
        own = max(s.inertia(500.0).max() for s in shapes) * fastest
        np.testing.assert_allclose(l1, l0, atol=2 * reading * own + 1e-9 * np.linalg.norm(l0))
        e0, e1 = before.energy(scene, theta), after.energy(scene, theta)
        assert e1 <= e0 * (1 + 2 * reading)
    assert hits >= 16


@engines(STEPPED, BULLET)
def test_a_fast_ball_does_not_pass_a_thin_wall(engine):
    # 10 cm across, 20 m/s, a static box 1 cm thick: 20 cm a step of 10 ms. It comes back at e v.
    v0, e = 20.0, 0.5
    wall = ((1.0, 0, 0), (0.01, 2, 2))
    scene = make_scene(
        Body(Sphere(R), (0, 0, 0), UPRIGHT, (v0, 0, 0)), planes=(), boxes=[wall], gravity=(0, 0, 0)
    )
    x = engine.path(scene, coefficients(e=e), [0.1, 0.2])[0, :, 0]
    t_hit = (1.0 - 0.005 - R) / v0
    assert (x[0] - x[1]) / 0.1 == pytest.approx(e * v0, rel=1e-6)
    back = 0.995 - R - e * v0 * (0.1 - t_hit)
    assert x[0] == pytest.approx(back, abs=2 * v0 * engine.delay + engine.gap)


THIN = Plane("sheet", "ground", (0, 0, 1), 0.0, [(-9, -9, 0), (9, -9, 0), (9, 9, 0), (-9, 9, 0)])
FAST = {
    "small sphere": Body(Sphere(0.005), (0, 0, 1.0), UPRIGHT, (3.0, 1.0, -50.0)),
    "small box": Body(Box((0.02, 0.03, 0.01)), (0, 0, 1.0), UPRIGHT, (3, 1, -30), (20, 10, 5)),
    "small capsule": Body(Capsule(0.005, 0.03), (0, 0, 1.0), UPRIGHT, (3, 1, -30), (20, 10, 5)),
}


@pytest.mark.parametrize("body", FAST.values(), ids=FAST.keys())
@pytest.mark.parametrize("ground", ["sheet", "box"])
@engines(STEPPED)
def test_nothing_small_and_fast_passes_a_thin_ground(engine, body, ground):
    # At 0.3 to 0.5 m a step onto a sheet without thickness, or a box of 1 cm: the centre stays an
    # inradius of 5 mm above it, but for what a contact that presses may sink.
    planes, boxes = ((THIN,), ()) if ground == "sheet" else ((), [((0, 0, -0.005), (18, 18, 0.01))])
    scene = make_scene(body, planes=planes, boxes=boxes, gravity=(0, 0, -G))
    path = engine.path(scene, coefficients(e=0.3), np.arange(1, 31) * 0.01)[0]
    assert path[:, 2].min() > 0.005 - 5e-5


HALF = Plane("half", "ground", (0, 0, 1), 0.0, [(-9, -9, 0), (0, -9, 0), (0, 9, 0), (-9, 9, 0)])
"""The half x < 0 of the plane z = 0."""


@pytest.mark.parametrize("height", [0.1, 0.5, 0.9])
@pytest.mark.parametrize(
    ("engine", "shape", "turn"),
    [
        (EVENT_DRIVEN, Sphere(R), UPRIGHT),
        (STEPPED, Sphere(R), UPRIGHT),
        (STEPPED, Capsule(R, 0.2), LYING_ALONG_Y),
    ],
    ids=str,
)
def test_the_edge_of_a_bounded_plane_pushes_along_the_contact(engine, shape, turn, height):
    # Its axis at h over the plane, it meets the edge where the normal to the axis is
    # n = (√(1 - h² / r²), 0, h / r), and without friction, e = 1, leaves at v - 2 (v · n) n.
    n = np.array([np.sqrt(1 - height**2), 0.0, height])
    body = Body(shape, (0.3, 0, height * R), turn, (-1.0, 0, 0))
    scene = make_scene(body, planes=[HALF], gravity=(0, 0, 0))
    after = engine.motion(scene, coefficients(0.0, e=1.0), 0.5)
    expected = np.array([-1.0, 0, 0]) + 2 * n[0] * n
    np.testing.assert_allclose(after.velocity[0], expected, atol=1e-5)


def test_the_edge_of_a_bounded_plane_pushes_a_box_along_its_face():
    # Level with the edge the impulse passes through its centre: it leaves at -e v.
    box = Body(Box((0.1, 0.1, 0.1)), (0.3, 0, 1e-7), UPRIGHT, (-1.0, 0, 0))
    scene = make_scene(box, planes=[HALF], gravity=(0, 0, 0))
    after = STEPPED.motion(scene, coefficients(0.0, e=0.6), 0.5)
    np.testing.assert_allclose(after.velocity[0], [0.6, 0, 0], atol=1e-5)
    np.testing.assert_allclose(after.spin[0], 0.0, atol=1e-4)


@pytest.mark.parametrize(
    "shapes",
    [
        (Sphere(0.02), Sphere(0.02)),
        (Sphere(0.02), Box((0.02, 0.4, 0.4))),
        (Capsule(0.01, 0.3), Box((0.02, 0.4, 0.4))),
    ],
    ids=lambda pair: "-".join(s.kind for s in pair),
)
@engines(STEPPED)
def test_moving_objects_do_not_pass_one_another(engine, shapes):
    # Closing at 30 m/s, 30 cm a step: the first stays on its side of the second.
    first, second = shapes
    scene = make_scene(
        Body(first, (-0.73, 0, 0), UPRIGHT, (15.0, 0, 0)),
        Body(second, (0.73, 0, 0), UPRIGHT, (-15.0, 0, 0)),
        planes=(),
        gravity=(0, 0, 0),
    )
    x = engine.path(scene, coefficients(e=0.5), np.arange(1, 21) * 0.01)[:, :, 0]
    assert (x[1] - x[0] > 0).all()
    v1, v2 = (x[:, -1] - x[:, -2]) / 0.01
    assert v2 - v1 == pytest.approx(0.5 * 30.0, rel=1e-3)
