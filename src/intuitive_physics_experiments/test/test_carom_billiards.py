from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from intuitive_physics.errors import InvalidInputError
from intuitive_physics_experiments.recorded_sets.carom_billiards import DURATION, carom_observations
from intuitive_physics_recordings.npz_file import load_arrays

RADIUS, TABLE = 0.03, (1.4, 2.8)
DECELERATION = 0.3
SPEED = 2.0


def shot(**changes: Any) -> dict[str, Any]:
    """A cue ball that slows down along y for 1.2 s, two balls that rest; its first row is early."""
    times = np.concatenate([[0.0], 0.01 + np.arange(60) / 50.0])
    since = np.maximum(times - 0.01, 0.0)
    cue = np.column_stack(
        [np.full_like(times, 0.7), 0.5 + SPEED * since - 0.5 * DECELERATION * since**2]
    )
    cue[0, 1] -= 0.004
    resting = [np.tile(place, (times.size, 1)) for place in ((0.2, 0.5), (1.2, 0.5))]
    rows = [
        np.column_stack([np.zeros_like(times), np.full_like(times, ball), times, path])
        for ball, path in enumerate([resting[0], cue, resting[1]])
    ]
    arrays = {
        "shot_ball_t_x_y": np.concatenate(rows),
        "ball_radius": np.array(RADIUS),
        "table": np.array(TABLE),
    }
    return {**arrays, **changes}


def test_a_shot_becomes_an_observation_of_three_balls():
    (observation,) = carom_observations(shot())
    assert observation.materials == ("ball", "cloth", "cushion")
    assert observation.start_time == pytest.approx(0.01)
    left, cue, right = observation.objects
    assert cue.initial_state.position == pytest.approx([0.7, 0.5, RADIUS], abs=1e-3)
    # The mean velocity of the rows it is fitted to, of 0.1 s, lags by half of what they lose.
    assert cue.initial_state.linear_velocity == pytest.approx(
        [0.0, SPEED, 0.0], abs=0.051 * DECELERATION
    )
    for ball in (left, right):
        assert not ball.initial_state.linear_velocity.any()
    assert cue.trajectory.times[-1] <= DURATION
    assert (cue.trajectory.positions[:, 2] == RADIUS).all()


def test_only_rows_before_the_first_contact_tell_the_velocity():
    arrays = shot()
    rows = arrays["shot_ball_t_x_y"]
    # The ball comes back from a cushion at y = 0 in its fifth row.
    path = np.abs(0.08 - 1.0 * (rows[61:122, 2] - 0.01)) + RADIUS
    rows[61:122, 4] = path
    (observation,) = carom_observations(arrays)
    assert observation.objects[1].initial_state.linear_velocity == pytest.approx(
        [0.0, -1.0, 0.0], abs=1e-6
    )


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"ball_radius": np.array(0.0)}, "above zero"),
        ({"ball_radius": np.array(0.4)}, "expected room"),
        ({"table": np.ones(3)}, "shape"),
        ({"shot_ball_t_x_y": np.zeros((4, 4))}, "shape"),
        ({"shot_ball_t_x_y": np.full((4, 5), np.nan)}, "not finite"),
        ({"shot_ball_t_x_y": shot()["shot_ball_t_x_y"][:-1]}, "different times"),
    ],
)
def test_what_a_shot_cannot_have_is_named(changes, message):
    with pytest.raises(InvalidInputError, match=message):
        carom_observations(shot(**changes))


@settings(max_examples=60)
@given(places=hnp.arrays(np.float64, (183, 2), elements=st.floats(width=32, allow_nan=False)))
def test_any_numbers_are_loaded_or_refused(places):
    arrays = shot()
    arrays["shot_ball_t_x_y"][:, 3:] = places
    try:
        observations = carom_observations(arrays)
    except InvalidInputError:
        return
    assert len(observations) <= 1


@pytest.mark.needs("recordings")
def test_recorded_shots(recording):
    observations = carom_observations(load_arrays(recording("carom_billiards.npz")))
    assert len(observations) == 20
    for observation in observations:
        speeds = [
            np.linalg.norm(ball.initial_state.linear_velocity) for ball in observation.objects
        ]
        # One ball is struck, at a speed a player can give it.
        assert sorted(speed > 0.0 for speed in speeds) == [False, False, True]
        assert 1.0 < max(speeds) < 8.0
