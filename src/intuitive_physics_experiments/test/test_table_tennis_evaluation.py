"""Drag is found where it is known, and predictions ahead are right where the model is."""

from __future__ import annotations

import numpy as np
import pytest

from intuitive_physics.scene import Environment, Plane, Scene, SceneObject
from intuitive_physics.shapes import Sphere
from intuitive_physics.simulation import make_simulator
from intuitive_physics.state import ObjectState
from intuitive_physics_experiments.recorded_sets.table_tennis import (
    BALL_RADIUS,
    LAUNCH_BOUNCE_HEIGHT,
    AirCoefficients,
    ball_parameters,
    launch_observations,
)
from intuitive_physics_experiments.recorded_sets.table_tennis_evaluation import (
    learn_drag,
    look_ahead,
)

DRAG = 0.45
TRUE = ball_parameters().with_pair("ball", "table", restitution=0.9, dynamic_friction=0.2)


@pytest.fixture(scope="module")
def arrays():
    """Eight launches through air, seen for 1.3 s with noise of 1 mm."""
    rng = np.random.default_rng(4)
    ball = SceneObject("ball", "ball", Sphere(BALL_RADIUS), DRAG)
    table = LAUNCH_BOUNCE_HEIGHT - BALL_RADIUS
    environment = Environment([Plane("table", "table", (0.0, 0.0, 1.0), table)])
    times = np.arange(234) / 180.0
    scenes = [
        Scene(
            environment,
            (ball,),
            (ObjectState((3.0, 0.0, 1.1), linear_velocity=rng.normal((-4.0, 0.0, 3.0), 0.2)),),
        )
        for _ in range(8)
    ]
    paths = make_simulator("stepped").rollout(scenes, TRUE, times).positions[:, 0]
    noisy = paths + rng.normal(0.0, 0.001, paths.shape)
    return {
        "time": np.tile(times, 8),
        "position": noisy.reshape(-1, 3),
        "offsets": np.arange(9) * times.size,
        "radius": np.array(BALL_RADIUS),
    }


def test_drag_is_found_from_flight(arrays):
    # 1 mm over 0.7 s of flight at 4 m/s, where drag moves the ball by 10 cm, determine it to 1 %.
    drag = learn_drag(lambda air: launch_observations(arrays, air), 0.0, 0.75, seed=0)
    assert drag == pytest.approx(DRAG, abs=0.02)


def test_the_look_ahead_is_as_long_as_was_seen(arrays):
    observations = launch_observations(arrays, AirCoefficients(DRAG))
    ahead = look_ahead(observations, TRUE, ball_parameters())
    assert ahead is not None
    assert ahead.ahead == pytest.approx(1.0)
    learned, default, flight = (
        ahead.errors[name].mean()
        for name in ("learned parameters", "default parameters", "free flight")
    )
    # A velocity from 36 points over 0.2 s of 1 mm noise is off by 3 mm/s on each axis.
    assert learned < 0.02
    assert 5.0 * learned < default < flight
    assert ahead.spread > 0.1


def test_balls_that_bounce_at_once_are_not_looked_at(launch_arrays):
    arrays = launch_arrays(2)
    late = {**arrays, "offsets": np.array([0, 160])}
    late["time"], late["position"] = arrays["time"][:160], arrays["position"][:160]
    (observation,) = launch_observations(late)
    assert look_ahead([observation], TRUE, TRUE) is not None
    assert look_ahead([], TRUE, TRUE) is None
