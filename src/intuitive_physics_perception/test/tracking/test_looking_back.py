"""Where a ball must have been before it was seen."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from intuitive_physics_perception.tracking.looking_back import earlier_place
from intuitive_physics_perception.tracking.motion_fits import HAND_ACCELERATION

from ..conftest import FLOOR, seen_sphere

RADIUS = 0.05


def seen_along(rng, times, places, noise):
    """Detections with their times, s, of a ball at places (n, 3) m."""
    seen = [seen_sphere(rng, place, RADIUS, noise) for place in places]
    return list(zip(times.tolist(), seen, strict=True))


def flight(times: np.ndarray, velocity) -> np.ndarray:
    return [0.0, 0.0, 1.0] + np.outer(times, velocity) + 0.5 * np.outer(times**2, FLOOR.gravity)


@pytest.mark.parametrize("rate", [30, 60, 90])
def test_a_flight_leads_back_to_where_it_was(rate) -> None:
    """A fall bends a line by 1.8 cm in 60 ms. A flight has the errors of its detections."""
    rng, off, bends = np.random.default_rng(rate), [], []
    for _ in range(200):
        velocity, noise = rng.normal(0.0, 1.0, size=3), rng.uniform(0.0005, 0.002)
        times = 0.06 + np.arange(0.0, 0.11, 1.0 / rate)
        later = seen_along(rng, times, flight(times, velocity), noise)
        before = earlier_place(later, 0.0, FLOOR.gravity)
        noise_alone = before.spread - before.bend**2 * np.eye(3)
        error = before.place - [0.0, 0.0, 1.0]
        off.append(error @ np.linalg.solve(noise_alone, error))
        bends.append(before.bend)
    # The hand may have held it until it was seen; noise hides a flight seldom.
    flown = np.isclose(bends, 0.5 * HAND_ACCELERATION * 0.06**2)
    assert flown.mean() > 0.95
    # χ² with three degrees of freedom, and a variance that grows with the misfit.
    assert np.mean(np.array(off)[flown]) < 3.0 + 3.0 * np.sqrt(6.0 / 200)


@given(st.floats(-3.0, 3.0), st.floats(0.01, 0.05), st.integers(15, 90))
def test_what_does_not_fly_moved_straight(speed, gap, rate) -> None:
    """Without a fall a place is on the line through the next two."""
    times = gap + np.arange(6) / rate
    places = np.outer(times, [speed, 0.0, 0.0]) + [0.0, 0.0, 1.0]
    later = seen_along(np.random.default_rng(0), times, places, 1e-6)
    before = earlier_place(later, 0.0, FLOOR.gravity)
    assert before.place == pytest.approx([0.0, 0.0, 1.0], abs=1e-4)
    assert before.velocity == pytest.approx([speed, 0.0, 0.0], abs=1e-3)


def test_one_place_shows_no_velocity() -> None:
    later = seen_along(np.random.default_rng(0), np.array([0.1]), np.zeros((1, 3)), 0.001)
    assert earlier_place(later, 0.0, FLOOR.gravity) is None
