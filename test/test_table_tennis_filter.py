"""The filter of table-tennis robots, on flights of its own model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.peers.table_tennis_filter import (
    FilterParameters,
    TableTennisFilter,
    filter_prediction,
    fit_filter,
)

from intuitive_physics_experiments.recorded_sets.flight_estimation import BallModel

TIMES = np.arange(60) / 144.0
UNKNOWNS = np.array(
    [0.0, 0.9, 0.4, 0.1, -7.0, 0.5, 150.0, 20.0, 0.0, 0.5, 0.25, 0.28, 0.95, 0.23, -0.0045, 0.0066]
)
"""A ball of our simulator: position, velocity, spin, coefficients."""


PARAMETERS = FilterParameters(
    drag=0.55, magnus=0.4, noise=6e-4, noise_along=8e-4, acceleration=0.1, spin_deviation=150.0
)
"""Of a filter that has nearly the same air and is told the noise."""


def seen(count: int, noise: float) -> np.ndarray:
    path = BallModel().positions(UNKNOWNS[None], TIMES[:count])[0]
    return path + noise * np.random.default_rng(1).normal(size=path.shape)


def test_a_drag_flight_is_filtered() -> None:
    positions = seen(40, 5e-4)
    found = TableTennisFilter(PARAMETERS, TIMES[:40], positions)
    true = seen(40, 0.0)
    assert np.linalg.norm(found.state[:3] - true[-1]) < 2e-3
    speed = (true[-1] - true[-2]) * 144.0
    assert np.linalg.norm(found.state[3:6] - speed) < 0.1
    # Topspin about x bends the flight down.
    assert found.state[6] > 3.0 * np.sqrt(found.covariance[6, 6])


def test_an_outlier_is_left_out() -> None:
    positions = seen(40, 5e-4)
    positions[30] += 0.3
    found = TableTennisFilter(PARAMETERS, TIMES[:40], positions)
    assert np.linalg.norm(found.state[:3] - seen(40, 0.0)[-1]) < 2e-3


@pytest.mark.parametrize("friction", [None, 0.25])
def test_a_bounce_obeys_restitution_and_takes_slip_away(friction: float | None) -> None:
    parameters = FilterParameters(
        drag=0.0, magnus=0.0, height=0.0, slope=0.0, restitution=0.9, share=0.4, friction=friction
    )
    times = np.arange(10) / 144.0
    start, velocity = np.array([0.0, 0.0, 0.2]), np.array([0.0, -2.0, -2.0])
    fallen = 0.5 * 9.81 * times[:, None] ** 2 * np.array([0.0, 0.0, 1.0])
    positions = start + velocity * times[:, None] - fallen
    asked = np.array([0.2, 0.2001])
    places = filter_prediction(parameters, times, positions, asked)
    after = (places[1] - places[0]) / 1e-4
    # Without friction's limit a ball that does not spin keeps 3/5 of its speed: it rolls.
    assert after[1] == pytest.approx(-1.2, abs=0.05)
    touch = (-2.0 + np.sqrt(4.0 + 2.0 * 9.81 * 0.2)) / 9.81
    rebound = 0.9 * (2.0 + 9.81 * touch)
    assert after[2] == pytest.approx(rebound - 9.81 * (0.2 - touch), abs=0.1)


def test_fitting_finds_the_drag() -> None:
    times = TIMES[:45]
    positions = seen(45, 0.0)

    def cost(parameters: FilterParameters) -> float:
        places = filter_prediction(parameters, times[:20], positions[:20], times[20:])
        return float(np.linalg.norm(places - positions[20:], axis=1).mean())

    start = replace(PARAMETERS, drag=0.2)
    assert cost(fit_filter(start, cost, 60)) < 0.7 * cost(start)
