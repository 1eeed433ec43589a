"""Each closed form against `stepped`, which steps all contacts, and in worlds where others step."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from intuitive_physics.shapes import Box, Capsule, Sphere
from intuitive_physics.simulation.stepped.contacts import STICK_SPEED
from intuitive_physics.simulation.stepped.parts import PRECISION

from .laws_scenes import (
    EVENT_DRIVEN,
    FLOOR,
    ROUNDING,
    STEPPED,
    Body,
    G,
    coefficients,
    first_motion,
    make_scene,
    random_quaternion,
)

R, HALF = 0.05, 0.03
TIMES = np.linspace(0.1, 2.0, 20)

SLOPES = st.just(0.0) | st.floats(-0.15, 0.15)
"""On a level plane a rolling capsule takes many steps at once, on a slope one after the other."""

FAR_BOX = Body(Box((0.1, 0.2, 0.15)), (0.0, 50.0, 0.5), spin=(1.0, 2.0, 3.0))
"""What needs steps, where nothing else comes."""


def apart(body, theta, planes=(FLOOR,), times=TIMES):
    """Largest distance (m) of a body's paths in closed form and in steps, and the steps' path."""
    scene = make_scene(body, planes=planes)
    exact, stepped = (engine.path(scene, theta, times)[0] for engine in (EVENT_DRIVEN, STEPPED))
    return np.abs(exact - stepped).max(), stepped


def _starts_or_rests(slope, mu_r):
    """Whether it is clear which of both a slope lets something do that rolls."""
    return slope == 0.0 or abs(abs(np.tan(slope)) - mu_r) > 2e-3


@given(
    speed=st.floats(-3.0, 3.0),
    spin=st.floats(-40.0, 40.0),
    pivot=st.floats(-40.0, 40.0),
    mu_s=st.floats(0.0, 1.0),
    share=st.floats(0.0, 1.0),
    mu_r=st.floats(0.0, 0.1),
    slope=SLOPES,
)
def test_ball_that_slides_rolls_and_stops(speed, spin, pivot, mu_s, share, mu_r, slope):
    # A step begins to roll where the slip is below STICK_SPEED, and friction ends it within that
    # step: the speed is then wrong by STICK_SPEED at most, and stays so. A phase that ends within a
    # step is resolved at its end, with forces of at most g: g h² for each of slip, rolling, pivot.
    # Rolling friction begins with the step after the one in which slip ends, up to h late: the
    # speed is then wrong by μ_r g h / (1 + 2/5). In each step sweeps end where one changes no speed
    # by more than PRECISION g h.
    # A contact that grips too little to roll against its whole rolling torque passes on a part in
    # closed form, and slips in steps: so friction is enough for both.
    mu_d = mu_s * share
    assume(mu_d > (2.0 * abs(np.tan(slope)) + 5.0 * mu_r) / 7.0)
    assume(_starts_or_rests(slope, mu_r))
    h, normal = STEPPED.step, np.array([np.sin(slope), 0.0, np.cos(slope)])
    along = np.array([np.cos(slope), 0.0, -np.sin(slope)])
    turning = np.array([0.0, spin, 0.0]) + pivot * normal
    body = Body(Sphere(R), R * normal, velocity=speed * along, spin=turning)
    difference, _ = apart(body, coefficients(mu_d, mu_s, mu_r), [(*normal, 0.0)])
    wrong_speed = STICK_SPEED + mu_r * G * h / 1.4 + PRECISION * G * h
    assert difference < wrong_speed * TIMES[-1] + 3.0 * G * h * h


@given(
    speed=st.floats(-3.0, 3.0),
    share=st.floats(0.0, 1.5),
    mu_s=st.floats(0.0, 1.0),
    mu_r=st.floats(0.0, 0.05),
    slope=SLOPES,
    sideways=SLOPES,
)
def test_capsule_that_lies(speed, share, mu_s, mu_r, slope, sideways):
    # Its axis is b, its way along x; share 1 rolls. On a plane that falls to its side too, static
    # friction holds it along b, or it slides where that is too weak. Both are the same impulses, of
    # which sweeps leave PRECISION g h at each of two contacts. Where it ceases to slip, which is
    # STICK_SPEED early, the slip of its ends in a step or two turns its heading, so that it goes
    # astray along its way.
    assume(_starts_or_rests(slope, mu_r))
    normal = np.array([slope, sideways, 1.0]) / np.linalg.norm([slope, sideways, 1.0])
    along = np.cross([0.0, 1.0, 0.0], normal)
    along /= np.linalg.norm(along)
    axis = np.cross(normal, along)
    turn = Rotation.from_matrix(np.transpose([normal, along, axis]))
    spin = share * speed / R * axis
    body = Body(Capsule(R, 2.0 * HALF), R * normal, tuple(turn.as_quat()), speed * along, spin)
    difference, path = apart(body, coefficients(0.8 * mu_s, mu_s, mu_r), [(*normal, 0.0)])
    astray = 2.0 * STICK_SPEED * STEPPED.step / HALF * np.linalg.norm(np.ptp(path, axis=0))
    assert difference < 2.0 * PRECISION * G * STEPPED.step * TIMES[-1] + astray


@pytest.mark.parametrize("shape", [Sphere(R), Box((0.05, 0.08, 0.04)), Capsule(0.02, 0.05)])
def test_flight_is_the_same_alone_and_beside_others(shape):
    # Both ways carry a flying body by the same plan: equal to the bit but for the order of sums.
    rng = np.random.default_rng(5)
    body = Body(
        shape,
        (0.0, 0.0, 0.3),
        random_quaternion(rng),
        (1.0, 0.0, 2.0),
        (3.0, 1.0, 2.0),
    )
    alone, beside = (
        STEPPED.poses(make_scene(body, boxes=boxes), coefficients(), TIMES[:4])
        for boxes in ((), [((0, 0.25, 0.5), (9.0, 0.1, 1.0))])
    )
    for one, other in zip(alone, beside, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-12)


@given(seed=st.integers(0, 2**32), balls=st.integers(1, 3))
def test_spheres_keep_their_closed_form_where_others_step(seed, balls):
    # What steps far away cuts their phases at the ends of spans, and changes nothing. Balls that
    # meet grow rounding by their collisions.
    rng = np.random.default_rng(seed)
    bodies = [
        Body(
            Sphere(0.05 + 0.02 * k),
            (0.4 * k, rng.uniform(-0.02, 0.02), rng.uniform(0.15, 0.6)),
            velocity=rng.uniform(-1.0, 1.0, 3),
            spin=rng.uniform(-10.0, 10.0, 3),
        )
        for k in range(balls)
    ]
    theta = coefficients(0.4, 0.5, 0.01, e=0.6)
    alone = EVENT_DRIVEN.poses(make_scene(*bodies), theta, TIMES)
    beside = EVENT_DRIVEN.poses(make_scene(*bodies, FAR_BOX), theta, TIMES)
    allowed = ROUNDING if balls == 1 else 1e3 * ROUNDING
    for one, other in zip(alone, beside, strict=True):
        assert np.abs(one - other[:balls]).max() < allowed


def test_a_ball_that_a_box_has_hit_rolls_by_the_law():
    # Without restitution and friction the box m₁ pushes the ball m₂ along at m₁ v / (m₁ + m₂), both
    # at the same speed; friction with the floor, which only the ball feels, is none while it slips
    # not. Once the box, which rubs, is left behind, the ball slows down by μ_r g / (1 + 2/5).
    theta = coefficients(0.4, 0.5, 0.02, e=0.3)
    ball = Body(Sphere(R), (0.0, 0.0, R))
    box = Body(Box((0.2, 0.2, 0.1)), (-0.35, 0.0, 0.05), velocity=(3.0, 0.0, 0.0))
    times = np.linspace(0.0, 1.6, 161)
    path = EVENT_DRIVEN.path(make_scene(ball, box), theta, times)
    x = path[0, :, 0]
    assert x[5] == 0.0
    assert x[-1] > 0.3
    rolls = (times > 0.8) & (times < 1.2)
    slowing = np.polyfit(times[rolls], x[rolls], 2)[0]
    assert -2.0 * slowing == pytest.approx(0.02 * G / 1.4, rel=1e-6)


def test_a_pile_of_balls_that_a_box_scatters_loses_energy_and_ends():
    # Balls rest on balls in closed form, are stepped while the box is among them, and are taken
    # over again. No contact gives energy; what a step leaves overlapped is lifted, by 2e-5 m a ball
    # and take-over.
    theta = coefficients(0.4, 0.5, 0.2, e=0.3)
    base = [Body(Sphere(R), (2.0 * R * k, 0.0, R)) for k in range(3)]
    upper = [Body(Sphere(R), (R * (2 * k + 1), 0.0, R * (1.0 + np.sqrt(3.0)))) for k in range(2)]
    box = Body(Box((0.15, 0.15, 0.15)), (-0.6, 0.01, 0.2), velocity=(3.0, 0.0, 1.0))
    scene = make_scene(*base, *upper, box)
    start = first_motion(scene).energy(scene, theta)
    mass = sum(body.shape.mass(500.0) for body in (*base, *upper, box))
    for t in (0.1, 0.2, 0.3, 0.5, 1.0, 2.0):
        energy = EVENT_DRIVEN.motion(scene, theta, t, gap=1e-4).energy(scene, theta)
        assert energy < start + mass * G * 6 * 2e-5
    late = EVENT_DRIVEN.path(scene, theta, [12.0, 13.0])
    np.testing.assert_array_equal(late[:, 0], late[:, 1])
