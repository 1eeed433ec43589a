"""Chances and times of events, against cases one can count."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from intuitive_physics.errors import InvalidInputError, UnknownNameError
from intuitive_physics.materials import StaticParameters
from intuitive_physics.regions import BallRegion, BoxRegion, HalfSpaceRegion
from intuitive_physics.scene import Environment, Scene, SceneObject
from intuitive_physics.shapes import Sphere
from intuitive_physics.state import ObjectState
from intuitive_physics_predictor.distribution import TrajectoryDistribution
from intuitive_physics_predictor.noisy_newton import predict
from intuitive_physics_predictor.queries import enters_region, falls_below, touches_object

UPRIGHT = (0.0, 0.0, 0.0, 1.0)


def straight_paths(speeds, times):
    """Samples that leave the origin along x at the given speeds, and an object that stays."""
    positions = np.zeros((len(speeds), 2, len(times), 3))
    positions[:, 0, :, 0] = np.outer(speeds, times)
    weights = np.full(len(speeds), 1 / len(speeds))
    return TrajectoryDistribution(("ball", "post"), np.asarray(times), positions, weights)


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


def test_falls_below_follows_gravity():
    # Free fall from 0 through -1 m takes sqrt(2 / 9.81) s, whichever way gravity points.
    times = np.linspace(0, 1, 1001)
    for gravity in ((0, 0, -9.81), (9.81, 0, 0)):
        positions = (0.5 * np.outer(times**2, gravity))[None, None]
        distribution = TrajectoryDistribution(("a",), times, positions, np.ones(1))
        forecast = falls_below(distribution, "a", -1.0, gravity)
        assert forecast.times[0] == pytest.approx(np.sqrt(2 / 9.81), abs=2e-3)


@given(st.floats(1.0, 6.0), st.floats(-0.2, 0.2), st.floats(0.0, 0.01))
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
    theta = StaticParameters.uniform(["m"], restitution=1.0)
    distribution = predict(
        scene, theta, np.arange(0, 1, 0.01), rng=np.random.default_rng(0), sample_count=1
    )
    forecast = touches_object(distribution, "a", "b", 0.1)
    assert forecast.probability == (1.0 if abs(offset) < 0.1 else 0.0)


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
        lambda d: touches_object(d, "ball", "ball", 0.1),
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
