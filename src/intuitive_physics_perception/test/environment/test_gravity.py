"""Up from an accelerometer at rest, and from nothing else."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from intuitive_physics.errors import InvalidInputError
from intuitive_physics_perception.environment.gravity import REST_TIME, RestingAccelerometer

RATE = 200.0
NOISE = 0.05
UP = np.array([0.1, -0.9, -0.4]) / np.linalg.norm([0.1, -0.9, -0.4])


def fed(accelerometer, rng, duration, *, start=0.0, up=UP, shake=0.0, turn=(0.0, 0.0, 0.0)):
    for time in start + np.arange(0.0, duration, 1.0 / RATE):
        swing = shake * np.sin(2 * np.pi * 3.0 * time) * np.array([1.0, 0.0, 0.0])
        accelerometer.add(time, 9.81 * up + swing + NOISE * rng.normal(size=3), turn)
    return accelerometer.up


def test_the_mean_at_rest_is_up(rng) -> None:
    up = fed(RestingAccelerometer(), rng, 2.0)
    # Each axis of the mean of 400 samples scatters by 0.05 / 20 / 9.81 = 0.015 degrees.
    assert np.degrees(np.arccos(up @ UP)) < 0.08
    assert np.linalg.norm(up) == pytest.approx(1.0)


def test_it_takes_some_time_of_rest(rng) -> None:
    accelerometer = RestingAccelerometer()
    assert fed(accelerometer, rng, 0.9 * REST_TIME) is None
    assert fed(accelerometer, rng, 0.2, start=0.9 * REST_TIME) is not None


@pytest.mark.parametrize("motion", [{"shake": 2.0}, {"turn": (0.0, 0.2, 0.0)}])
def test_a_sensor_that_moves_tells_nothing(rng, motion) -> None:
    accelerometer = RestingAccelerometer()
    assert fed(accelerometer, rng, 2.0, **motion) is None
    assert fed(accelerometer, rng, 2.0, start=2.0) is not None
    assert fed(accelerometer, rng, 1.0, start=4.0, **motion) is None


def test_a_sensor_that_was_tilted_has_a_new_up(rng) -> None:
    accelerometer = RestingAccelerometer()
    fed(accelerometer, rng, 1.0)
    tilted = np.array([0.0, -1.0, 0.0])
    assert fed(accelerometer, rng, 1.0, start=1.0, up=tilted) @ tilted > np.cos(np.radians(0.2))


def test_time_that_jumps_back_begins_anew(rng) -> None:
    accelerometer = RestingAccelerometer()
    fed(accelerometer, rng, 1.0, start=100.0)
    accelerometer.add(5.0, 9.81 * UP)
    assert accelerometer.up is None


@pytest.mark.parametrize(
    ("acceleration", "text"),
    [(UP, "is it in g"), (np.zeros(3), "gravity in it"), ([0.0, np.nan, 9.8], "finite")],
)
def test_what_is_no_acceleration_with_gravity_is_refused(acceleration, text) -> None:
    with pytest.raises(InvalidInputError, match=text):
        RestingAccelerometer().add(0.0, acceleration)


@settings(max_examples=100, deadline=None)
@given(
    st.lists(
        st.tuples(
            st.floats(),
            st.tuples(*[st.floats() | st.floats(-12.0, 12.0)] * 3),
            st.none() | st.tuples(*[st.floats()] * 3),
        ),
        max_size=30,
    )
)
def test_any_samples_give_a_unit_vector_nothing_or_one_error(samples) -> None:
    accelerometer = RestingAccelerometer()
    for sample in samples:
        try:
            accelerometer.add(*sample)
        except InvalidInputError:
            continue
        up = accelerometer.up
        assert up is None or np.linalg.norm(up) == pytest.approx(1.0)
