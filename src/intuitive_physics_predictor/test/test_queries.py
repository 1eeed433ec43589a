"""Chances and times of events, against cases one can count."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from intuitive_physics.errors import InvalidInputError, UnknownNameError
from intuitive_physics.materials import StaticParameters
from intuitive_physics.regions import BallRegion, BoxRegion, HalfSpaceRegion
from intuitive_physics.scene import Environment, Plane, Scene, SceneObject, StaticBox
from intuitive_physics.shapes import Box, Capsule, Sphere
from intuitive_physics.state import ObjectState
from intuitive_physics_predictor.distribution import TrajectoryDistribution
from intuitive_physics_predictor.noisy_newton import predict
from intuitive_physics_predictor.queries.events import (
    comes_to_rest,
    enters_region,
    falls_below,
    joined_forecasts,
    touches,
)

UPRIGHT = (0.0, 0.0, 0.0, 1.0)


def straight_paths(speeds, times):
    """Samples that leave the origin along x at the given speeds, and an object that stays."""
    positions = np.zeros((len(speeds), 2, len(times), 3))
    positions[:, 0, :, 0] = np.outer(speeds, times)
    weights = np.full(len(speeds), 1 / len(speeds))
    return TrajectoryDistribution(("ball", "post"), np.asarray(times), positions, weights)


POSTS = Scene(
    Environment(),
    (SceneObject("ball", "m", Sphere(0.1)), SceneObject("post", "m", Sphere(0.1))),
    (ObjectState((0, 0, 0)), ObjectState((1, 0, 0))),
)


def test_chance_and_time_of_entering():
    # Four samples at 1, 2, 3, 4 m/s: x > 2.5 m within a second for the two fastest, at
    # 2.5 / 3 and 2.5 / 4 s, seen at the next output time.
    times = np.linspace(0, 1, 101)
    forecast = enters_region(
        straight_paths([1, 2, 3, 4], times), "ball", HalfSpaceRegion((-1, 0, 0), -2.5)
    )
    assert forecast.probability == pytest.approx(0.5)
    np.testing.assert_allclose(forecast.times, [2.5 / 4, 2.5 / 3], atol=0.01)
    assert forecast.weights.sum() == pytest.approx(forecast.probability)


@given(st.lists(st.floats(0.0, 10.0), min_size=1, max_size=20), st.integers(1, 100))
@settings(max_examples=50)
def test_parts_of_the_samples_together_answer_as_all_of_them(speeds, numbers):
    whole = straight_paths(speeds, np.linspace(0, 1, 5))
    region = HalfSpaceRegion((-1, 0, 0), -2.5)
    expected = enters_region(whole, "ball", region)
    parts = list(whole.parts(numbers))
    assert sum(part.weights.size for part in parts) == len(speeds)
    assert max(part.positions.size for part in parts) <= max(numbers, whole.positions[0].size)
    joined = joined_forecasts([enters_region(part, "ball", region) for part in parts])
    assert joined.probability == expected.probability
    np.testing.assert_array_equal(joined.times, expected.times)
    np.testing.assert_array_equal(joined.weights, expected.weights)


def test_falls_below_follows_gravity():
    # Free fall from 0 through -1 m takes sqrt(2 / 9.81) s, whichever way gravity points.
    times = np.linspace(0, 1, 1001)
    for gravity in ((0, 0, -9.81), (9.81, 0, 0)):
        positions = (0.5 * np.outer(times**2, gravity))[None, None]
        distribution = TrajectoryDistribution(("a",), times, positions, np.ones(1))
        forecast = falls_below(distribution, "a", -1.0, gravity)
        assert forecast.times[0] == pytest.approx(np.sqrt(2 / 9.81), abs=2e-3)


def test_a_fast_object_does_not_jump_over_a_region():
    # At 4 m/s and 10 ms it is seen every 4 cm; the ball of 1 cm lies between two of these points.
    times = np.linspace(0, 1, 101)
    forecast = enters_region(straight_paths([4.0], times), "ball", BallRegion((1.02, 0, 0), 0.01))
    assert forecast.probability == 1.0
    assert forecast.times[0] == pytest.approx(1.01 / 4.0, abs=0.0013)


def predicted(scene, seconds=1.0, time_step=0.01, **theta):
    """The one future of exactly known states, with orientations."""
    return predict(
        scene,
        StaticParameters.uniform(scene.materials, **theta),
        np.arange(0, seconds, time_step),
        rng=np.random.default_rng(0),
        sample_count=1,
        orientations=True,
    )


@given(st.floats(1.0, 6.0), st.floats(-0.2, 0.2), st.floats(0.0, 0.01))
@settings(max_examples=50)
def test_a_bounce_between_output_times_is_a_touch(speed, offset, start):
    # Two spheres of 5 cm meet where their paths pass within 10 cm, though at the 10 ms output
    # times before and after the bounce they are apart.
    if abs(abs(offset) - 0.1) < 0.002:
        return
    scene = Scene(
        Environment([], gravity=(0, 0, 0)),
        (SceneObject("a", "m", Sphere(0.05)), SceneObject("b", "m", Sphere(0.05))),
        (
            ObjectState((-0.5 - start, offset, 0), UPRIGHT, (speed, 0, 0)),
            ObjectState((0, 0, 0)),
        ),
    )
    forecast = touches(predicted(scene, restitution=1.0), scene, "a", "b")
    assert forecast.probability == (1.0 if abs(offset) < 0.1 else 0.0)


FLOOR = Plane("floor", "wood", (0, 0, 1), 0.0)
WALL = Plane("wall", "wood", (-1, 0, 0), -1.0)
CRATE = StaticBox("crate", "wood", (0.0, 1.0, 0.1), UPRIGHT, (0.2, 0.2, 0.2))


@given(
    st.sampled_from([Sphere(0.05), Box((0.1, 0.2, 0.06)), Capsule(0.03, 0.1)]),
    st.floats(0.15, 1.0),
    st.floats(-3.0, 3.0),
)
@settings(max_examples=30)
def test_a_bounce_off_the_floor_is_a_touch_at_its_time(shape, height, spin):
    # The bottom of what falls from rest without turning meets the floor after sqrt(2 h / g). What
    # turns does so earlier or later by what its corners reach farther down.
    scene = Scene(
        Environment([FLOOR, WALL]),
        (SceneObject("a", "m", shape),),
        (ObjectState((0, 0, height), UPRIGHT, (0, 0, 0), (spin, 0, 0)),),
    )
    distribution = predicted(scene, restitution=0.6)
    forecast = touches(distribution, scene, "a", "floor")
    assert forecast.probability == 1.0
    earliest = np.sqrt(2 * (height - shape.bounding_radius) / 9.81)
    assert earliest - 1e-3 <= forecast.times[0] <= np.sqrt(2 * height / 9.81) + 0.011
    assert touches(distribution, scene, "a", "wall").probability == 0.0


@pytest.mark.parametrize(("y_speed", "chance"), [(3.0, 1.0), (0.0, 0.0), (-3.0, 0.0)])
def test_a_static_box_is_touched_by_its_name(y_speed, chance):
    scene = Scene(
        Environment([FLOOR], [CRATE]),
        (SceneObject("a", "m", Sphere(0.05)),),
        (ObjectState((0, 0, 0.1), UPRIGHT, (0, y_speed, 0)),),
    )
    assert touches(predicted(scene), scene, "a", "crate").probability == chance


def test_a_table_is_touched_until_one_is_off_its_edge():
    # A ball rolls off the edge of a sheet at x = 1 and falls: before, it touches it all the time.
    sheet = Plane(
        "sheet", "wood", (0, 0, 1), 0.5, [(-1, -1, 0.5), (1, -1, 0.5), (1, 1, 0.5), (-1, 1, 0.5)]
    )
    states = ((0.0, 0.55, 1.0), (1.5, 0.8, 0.0))
    for x, z, chance in states:
        scene = Scene(
            Environment([sheet]),
            (SceneObject("a", "m", Sphere(0.05)),),
            (ObjectState((x, 0, z), UPRIGHT, (1.0, 0, 0)),),
        )
        assert touches(predicted(scene), scene, "a", "sheet").probability == chance


def test_a_ball_that_rolls_comes_to_rest_when_it_should():
    # Rolling resistance decelerates by 5/7 of μ_r g: v² / (2 a) far, v / a long.
    scene = Scene(
        Environment([FLOOR]),
        (SceneObject("a", "m", Sphere(0.05)),),
        (ObjectState((0, 0, 0.05), UPRIGHT, (0.5, 0, 0), (0, 10.0, 0)),),
    )
    distribution = predicted(scene, 3.0, rolling_friction=0.05)
    stops = np.linalg.norm(np.diff(distribution.of("a")[0], axis=0), axis=1).nonzero()[0][-1]
    forecast = comes_to_rest(distribution, scene, "a")
    assert forecast.probability == 1.0
    # Within 1 mm of its end it is sqrt(2 · 1 mm / a) before, a = v / t.
    early = np.sqrt(2e-3 * distribution.times[stops] / 0.5)
    assert (
        distribution.times[stops] - early - 0.02
        < forecast.times[0]
        < distribution.times[stops] + 0.02
    )


def test_the_top_of_a_throw_is_no_rest_nor_is_what_ends_with_the_horizon():
    times = np.arange(0, 1.01, 0.01)
    scene = Scene(
        Environment(), (SceneObject("ball", "m", Sphere(0.1)),), (ObjectState((0, 0, 0)),)
    )
    for heights in (4.9 * times * (1 - times), np.maximum(0.0, 0.9 - times)):
        positions = np.zeros((1, 1, times.size, 3))
        positions[0, 0, :, 2] = heights
        distribution = TrajectoryDistribution(("ball",), times, positions, np.ones(1))
        assert comes_to_rest(distribution, scene, "ball").probability == 0.0
    positions[0, 0, :, 2] = np.maximum(0.0, 0.7 - times)
    rests = comes_to_rest(
        TrajectoryDistribution(("ball",), times, positions, np.ones(1)), scene, "ball"
    )
    assert rests.times[0] == pytest.approx(0.7, abs=0.011)


def test_a_box_that_turns_on_the_spot_is_not_at_rest():
    times = np.arange(0, 1.01, 0.01)
    positions = np.zeros((1, 1, times.size, 3))
    angles = np.minimum(times, 0.5)
    turned = np.zeros((1, 1, times.size, 4))
    turned[0, 0, :, 2], turned[0, 0, :, 3] = np.sin(angles / 2), np.cos(angles / 2)
    distribution = TrajectoryDistribution(("b",), times, positions, np.ones(1), turned)
    for shape, begins in ((Box((0.1, 0.1, 0.1)), 0.5), (Sphere(0.1), 0.0)):
        scene = Scene(Environment(), (SceneObject("b", "m", shape),), (ObjectState((0, 0, 0)),))
        forecast = comes_to_rest(distribution, scene, "b")
        # 1 mm at 8.7 cm is 0.012 rad, which it turns in 0.012 s.
        assert forecast.times[0] == pytest.approx(begins, abs=0.022)


def test_regions_hold_what_they_should():
    points = np.array([[0, 0, 0], [0.9, 0, 0], [0, 0.9, 0], [2, 0, 0]], dtype=float)
    assert BallRegion((0, 0, 0), 1.0).contains(points).tolist() == [True, True, True, False]
    s = np.sqrt(0.5)
    turned = BoxRegion((0, 0, 0), (0, 0, s, s), (0.5, 2.0, 1.0))
    assert turned.contains(points).tolist() == [True, True, False, False]
    assert HalfSpaceRegion((2, 0, 0), 0.5).contains(points).tolist() == [True, False, True, False]


@pytest.mark.parametrize(
    "ask",
    [
        lambda d: enters_region(d, "cup", HalfSpaceRegion((0, 0, 1), 0)),
        lambda d: touches(d, POSTS, "ball", "ball"),
        lambda d: touches(d, POSTS, "ball", "wall"),
        lambda d: touches(d, POSTS, "ball", "post"),
        lambda d: falls_below(d, "ball", float("nan"), (0, 0, -1)),
        lambda d: falls_below(d, "ball", 0.0, (0, 0, 0)),
        lambda d: BallRegion((0, 0, 0), -1.0),
        lambda d: BoxRegion((0, 0, 0), (0, 0, 0, 1), (1, 0, 1)),
        lambda d: BoxRegion((0, 0, 0), (0, 0, 0, 3), (1, 1, 1)),
        lambda d: HalfSpaceRegion((0, 0, 0), 1),
    ],
)
def test_bad_questions_are_refused(ask):
    with pytest.raises((InvalidInputError, UnknownNameError), match="expected"):
        ask(straight_paths([1.0], [0.0, 1.0]))
