from __future__ import annotations

import itertools

import numpy as np
import pytest

from intuitive_physics.errors import InvalidInputError
from intuitive_physics_experiments.rendering.corner_room import (
    BALL_RADII,
    corner_camera,
    corner_environment,
    true_parameters,
)
from intuitive_physics_experiments.rendering.throws import make_throws


@pytest.fixture(scope="module")
def throws():
    return make_throws(
        6,
        corner_camera(),
        corner_environment(),
        true_parameters(),
        np.random.default_rng(0),
        first_start=1.0,
        duration=2.4,
        pause=0.6,
    )


def test_the_balls_take_turns_one_after_another(throws):
    assert [throw.material for throw in throws] == [*BALL_RADII, *BALL_RADII]
    for before, after in itertools.pairwise(throws):
        assert after.start_time - before.end_time == pytest.approx(0.6)


def test_each_ball_stays_in_view_and_in_the_room(throws):
    camera = corner_camera()
    for throw in throws:
        pixels = camera.project(throw.motion.positions)
        assert (pixels > 0).all()
        assert (pixels < [camera.width, camera.height]).all()
        for plane in corner_environment().planes:
            # At most a step of the fastest impact deep.
            assert plane.signed_distances(throw.motion.positions).min() > throw.radius - 0.002


def test_positions_between_samples_are_interpolated(throws):
    throw = throws[1]
    times = throw.start_time + (throw.motion.times[:-1] + throw.motion.times[1:]) / 2.0
    middle = (throw.motion.positions[:-1] + throw.motion.positions[1:]) / 2.0
    assert throw.positions_at(times) == pytest.approx(middle)
    with pytest.raises(InvalidInputError, match="reach"):
        throw.positions_at(np.array([throw.end_time + 0.1]))
