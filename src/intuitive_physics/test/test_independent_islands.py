"""Independent islands, which advance several steps at once, still meet when they should."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from intuitive_physics.shapes import Box, Sphere

from .laws_scenes import STEPPED, Body, G, coefficients, make_scene

R = 0.05
LOW_FLOOR = (0.0, 0.0, 1.0, -100.0)


@given(
    apart=st.floats(0.2, 20.0),
    one=st.floats(0.0, 30.0),
    other=st.floats(0.5, 30.0),
    rising=st.floats(-5.0, 5.0),
)
def test_flying_balls_exchange_velocities_when_they_meet(apart, one, other, rising):
    # Equal masses, e = 1: at t = (d - 2 r) / (v₁ + v₂) they exchange velocities; both fall alike.
    meeting = (apart - 2.0 * R) / (one + other)
    times = np.linspace(0.0, 1.0, 12)[1:] * min(2.0 * meeting, 2.0)
    scene = make_scene(
        Body(Sphere(R), (0.0, 0.0, 0.0), velocity=(one, 0.0, rising)),
        Body(Sphere(R), (apart, 0.0, 0.0), velocity=(-other, 0.0, rising)),
        planes=[LOW_FLOOR],
    )
    path = STEPPED.path(scene, coefficients(mu=0.0, e=1.0), times)
    after = np.maximum(times - meeting, 0.0)
    expected = np.zeros_like(path)
    expected[0, :, 0] = one * (times - after) - other * after
    expected[1, :, 0] = apart - other * (times - after) + one * after
    expected[:, :, 2] = rising * times - 0.5 * G * times**2
    # An impact is found where the gap is below 1e-8 m; its normal leans by no more than that / r.
    np.testing.assert_allclose(path, expected, atol=1e-6 * (1.0 + (one + other) * times[-1] / R))


@given(apart=st.floats(0.15, 3.0), speed=st.floats(0.2, 5.0))
def test_a_ball_that_sleeps_is_woken_by_the_one_that_hits_it(apart, speed):
    # On a smooth level floor: v₁ t until t = (d - 2 r) / v, then the other one goes on with v.
    meeting = (apart - 2.0 * R) / speed
    times = np.linspace(0.0, 2.0, 12)[1:] * meeting
    scene = make_scene(
        Body(Sphere(R), (0.0, 0.0, R), velocity=(speed, 0.0, 0.0)),
        Body(Sphere(R), (apart, 0.0, R)),
    )
    path = STEPPED.path(scene, coefficients(mu=0.0, e=1.0), times)
    after = np.maximum(times - meeting, 0.0)
    np.testing.assert_allclose(path[0, :, 0], speed * (times - after), atol=1e-4)
    np.testing.assert_allclose(path[1, :, 0], apart + speed * after, atol=1e-4)


@given(
    spin=st.floats(20.0, 200.0),
    height=st.floats(R, 1.0),
    apart=st.floats(0.11, 1.5),
)
def test_a_spinning_ball_that_the_floor_drives_at_another_one_does_not_pass_it(spin, height, apart):
    # Dropped at rest but for its spin, its centre gains speed only from the floor's friction.
    times = np.linspace(0.02, 3.0, 150)
    scene = make_scene(
        Body(Sphere(R), (0.0, 0.0, height), spin=(0.0, spin, 0.0)),
        Body(Sphere(R), (apart, 0.0, R)),
    )
    path = STEPPED.path(scene, coefficients(mu=0.6), times)
    # What closes slower than g h / 2 is no impact: it may go on for a step h.
    overlap = 0.5 * G * STEPPED.step**2
    assert np.linalg.norm(path[1] - path[0], axis=1).min() > 2.0 * R - overlap
    # 2/7 r ω or more of rolling: it has been there, and has pushed.
    arrives = np.sqrt(2.0 * height / G) + 2.0 * apart / (2.0 / 7.0 * R * spin)
    assert arrives > times[-1] or path[1, -1, 0] > apart + 1e-3


@given(speed=st.floats(0.5, 5.0), count=st.integers(2, 4))
def test_balls_that_sleep_side_by_side_pass_on_the_blow(speed, count):
    # Equal masses, e = 1, without friction: the last of a row that touches leaves with the speed
    # of the first. (That sleep, and so touch, has a tenth of a second to come about.)
    apart = 0.1 * speed + 4.0 * R
    row = [Body(Sphere(R), (apart + 2.0 * R * k, 0.0, R)) for k in range(count)]
    scene = make_scene(Body(Sphere(R), (0.0, 0.0, R), velocity=(speed, 0.0, 0.0)), *row)
    meeting = (apart - 2.0 * R) / speed
    path = STEPPED.path(scene, coefficients(mu=0.0, e=1.0), [0.5 * meeting, 2.0 * meeting])
    np.testing.assert_allclose(path[1:, 0, 0], apart + 2.0 * R * np.arange(count), atol=1e-4)
    np.testing.assert_allclose(path[-1, 1, 0] - row[-1].position[0], meeting * speed, rtol=2e-2)


@given(
    place=st.tuples(*[st.floats(-0.4, 0.4)] * 2),
    velocity=st.tuples(*[st.floats(-3.0, 3.0)] * 3),
    spin=st.tuples(*[st.floats(-20.0, 20.0)] * 3),
)
def test_what_happens_far_away_changes_nothing(place, velocity, spin):
    pair = [
        Body(Box((0.2, 0.1, 0.1)), (*place, 0.6), velocity=velocity, spin=spin),
        Body(Sphere(R), (0.0, 0.0, R)),
    ]
    far = [
        Body(Box((0.1, 0.1, 0.1)), (40.0, 0.0, 0.5), velocity=(1.0, 0.0, 0.0)),
        Body(Sphere(R), (40.3, 0.0, R)),
    ]
    times = np.linspace(0.1, 1.5, 15)
    theta = coefficients(mu=0.4, e=0.5)
    alone = STEPPED.path(make_scene(*pair), theta, times)
    beside = STEPPED.path(make_scene(*pair, *far), theta, times)
    np.testing.assert_allclose(beside[:2], alone, atol=1e-12)
