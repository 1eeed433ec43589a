"""A ball of which each reading has its own time is followed at these times."""

from __future__ import annotations

import numpy as np
import pytest

from intuitive_physics_perception.input.depth import points_from_depth
from intuitive_physics_perception.input.reading_times import times_of_rows
from intuitive_physics_perception.pipeline import PerceptionPipeline
from intuitive_physics_perception.settings import PerceptionSettings

RADIUS, FRAMES = 0.07, 4
START, VELOCITY = np.array([1.5, -0.7, 0.6]), np.array([0.3, 3.0, 1.5])


def flight(time):
    """p0 + v t - g t²/2, (n, 3) m at times (n,) s."""
    t = np.asarray(time)[..., None]
    return START + VELOCITY * t - np.array([0.0, 0.0, 0.5 * 9.81]) * t**2


def rolling_frame(room, time: float, row_time: float):
    """Readings of a shutter that exposes row after row: of each row, the ball where it was then."""
    offsets = times_of_rows(room.height_pixels, room.width, row_time)
    depths, bands = [], np.array_split(np.arange(room.height_pixels), 60)
    for rows in bands:
        flown = float(time + offsets[rows].mean())
        balls = [(flight(flown), RADIUS)] if flown >= 0.0 else []
        depths.append(room.depth(balls)[rows])
    return points_from_depth(np.concatenate(depths), room._pixel_rays), offsets


@pytest.mark.parametrize("row_time", [6e-5, -6e-5])
def test_a_detection_has_the_time_of_its_rows(make_small_room, row_time) -> None:
    """14 ms from the first row to the last, in which the ball moves by 4 cm. Against the place at
    the detections' times the error is noise; against that at the stamps it is v times the delay."""
    room = make_small_room(tilt=10.0, seed=3)
    pipeline = PerceptionPipeline(
        PerceptionSettings(environment_frames=FRAMES), np.random.default_rng(0)
    )
    with_times, states = [], []
    for k in range(FRAMES + 9):
        time = (k - FRAMES) / 15.0
        points, offsets = rolling_frame(room, time, row_time)
        result = pipeline.process(points, time, offsets=offsets)
        for detection in result.detections:
            with_times.append((time + detection.delay, time, detection.center))
        for item in result.objects:
            states.append((result.time, item.state.position))
            if item.detection is not None:
                assert item.detection.times[0] == pytest.approx(result.time, abs=1e-6)
    times, stamps, places = (np.array(column) for column in zip(*with_times, strict=True))
    assert len(times) >= 5
    assert sum(time > 0.1 for time, _ in states) >= 3
    error = np.linalg.norm(places - flight(times), axis=1)
    assert error.max() < 0.012
    assert np.linalg.norm(places - flight(stamps), axis=1).mean() > 0.015
    for time, position in states:
        # Unseen it comes to the floor.
        if time < 0.5:
            assert position == pytest.approx(flight(time), abs=0.02)
    (observation,) = pipeline.finish()
    seen = observation.objects[0].detections
    assert np.linalg.norm(seen.positions - flight(seen.times), axis=1).max() < 0.012
