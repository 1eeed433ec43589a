"""A ball that lies on the floor from the start is found; what is as round on a wall is not."""

from __future__ import annotations

import numpy as np
import pytest

from intuitive_physics_perception.detection.detections import DetectedSphere
from intuitive_physics_perception.pipeline import PerceptionPipeline
from intuitive_physics_perception.settings import PerceptionSettings

RADIUS = 0.05
FRAMES = 12


def found_in(room, ball) -> int:
    """Frames after the environment was modelled, with the ball there, in which it is detected."""
    pipeline = PerceptionPipeline(
        PerceptionSettings(environment_frames=4), np.random.default_rng(4)
    )
    count = 0
    for k in range(4 + FRAMES):
        result = pipeline.process(room.points([(ball, RADIUS)]), 0.03 * k)
        if k < 4:
            continue
        places = [s.center for s in result.detections if isinstance(s, DetectedSphere)]
        assert len(places) <= 1
        count += sum(float(np.linalg.norm(place - ball)) < 0.3 * RADIUS for place in places)
    return count


@pytest.fixture
def from_above(make_room):
    """A camera 1.2 m over the floor that looks down by 30°, with the noise of a stereo camera."""
    return make_room(tilt=30.0, height=1.2, noise_constant=0.001, noise_quadratic=0.0025)


@pytest.mark.parametrize("away", [1.0, 1.4, 1.8, 2.2, 2.6])
def test_a_ball_that_lies_on_the_floor_from_the_start_is_found(from_above, away) -> None:
    assert found_in(from_above, np.array([away, 0.1, RADIUS])) >= FRAMES - 3


@pytest.mark.parametrize("place", [(1.4, 0.1, 0.0), (3.2, 0.1, 0.7)], ids=["floor", "wall"])
def test_half_a_ball_in_a_plane_is_none(from_above, place) -> None:
    assert found_in(from_above, np.array(place)) == 0


def test_a_ball_that_hangs_at_a_wall_from_the_start_is_none(from_above) -> None:
    """It may be a knob: the wall goes on round it and carries nothing."""
    assert found_in(from_above, np.array([3.2 - RADIUS, 0.1, 0.7])) == 0
