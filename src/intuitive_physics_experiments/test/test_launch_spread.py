"""Shots with the same settings: the predicted spread is that of the launcher."""

from __future__ import annotations

import numpy as np
import pytest

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.materials import StaticParameters, parameter_count
from intuitive_physics.observation import Observation, ObservedObject
from intuitive_physics.scene import Environment, Plane, Scene, SceneObject
from intuitive_physics.shapes import Sphere
from intuitive_physics.simulation import make_simulator
from intuitive_physics.state import ObjectState
from intuitive_physics.trajectory import Trajectory
from intuitive_physics_experiments.calibration.launch_spread import QUANTITIES, launch_spread
from intuitive_physics_experiments.flight_fits import fit_initial_state
from intuitive_physics_predictor.parameter_uncertainty import UncertainParameters

ENGINE = make_simulator("event_driven")
TABLE = Environment([Plane("table", "table", (0, 0, 1), 0.74)])
BALL = SceneObject("ball", "ball", Sphere(0.02))
THETA = StaticParameters.uniform(("ball", "table"), restitution=0.9)
SPREAD = np.array([0.004, 0.004, 0.004, 0.05, 0.05, 0.05])  # m and m/s, of the launcher


def launch(rng: np.random.Generator) -> Observation:
    times = np.arange(170) / 180
    start = np.array([0.1, 0.0, 1.15, 3.2, 0.0, 0.5]) + SPREAD * rng.standard_normal(6)
    state = ObjectState(start[:3], linear_velocity=start[3:])
    positions = ENGINE.rollout(
        [Scene(TABLE, (BALL,), (state,))], THETA, times, orientations=False
    ).positions[0, 0]
    positions += rng.normal(0.0, 1e-3, positions.shape)
    fitted = fit_initial_state(times[:40], positions[:40], TABLE.gravity)
    observed = ObservedObject(BALL, Trajectory(times, positions), fitted)
    return Observation(TABLE, (observed,), 0.0)


def known_parameters() -> UncertainParameters:
    size = parameter_count(2)
    exact = LearnedParameters(THETA, np.zeros(size), np.ones(size, bool), 1, 0.0, 9, "cma_es")
    return UncertainParameters(exact)


def test_the_predicted_spread_is_the_one_that_occurs():
    rng = np.random.default_rng(0)
    launches = [launch(rng) for _ in range(80)]
    spread = launch_spread(
        launches[:40], launches[40:], known_parameters(), seed=1, simulator=ENGINE
    )
    # Both are known from 40 launches, to 1 / sqrt(80) = 11 % each: within 4 of √2 · 11 %.
    np.testing.assert_allclose(spread.predicted, spread.seen, rtol=0.6)
    assert (np.abs(np.log(spread.predicted / spread.seen)) < 0.2).sum() >= 3
    assert (np.abs(spread.offset) < 4 * spread.seen * np.sqrt(2 / 40)).all()
    np.testing.assert_array_equal(spread.launches, 40)
    assert all(name in spread.to_markdown() for name in QUANTITIES)


def test_too_few_launches_are_refused():
    rng = np.random.default_rng(1)
    launches = [launch(rng) for _ in range(5)]
    with pytest.raises(InvalidInputError, match="expected at least 8 and 3"):
        launch_spread(launches[:3], launches[3:], known_parameters(), seed=1, simulator=ENGINE)
