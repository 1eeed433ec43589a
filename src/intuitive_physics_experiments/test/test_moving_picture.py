"""The moving picture has every frame of the throw, and in it what was predicted by then."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image, ImageColor

from intuitive_physics.trajectory import Trajectory
from intuitive_physics_cli.report.figure_style import OBSERVED, PREDICTED
from intuitive_physics_experiments.demo.demo_result import PerceivedFrame
from intuitive_physics_experiments.demo.moving_picture import PredictedPaths, write_moving_picture
from intuitive_physics_experiments.rendering.corner_room import corner_camera

BEGIN, STEP = 1000.0, 1.0 / 30.0  # s, stamp of the throw's first frame and time between two


class Truth:
    """What of the ground truth the picture needs."""

    camera = corner_camera()


@pytest.fixture
def pictures(tmp_path):
    """The frames (height, width, 3) of a throw of 19 frames, predicted once, after the tenth."""
    camera = Truth.camera
    perceived = PerceivedFrame(camera.rotation, camera.position, Truth())
    times = BEGIN + STEP * np.arange(19)
    since = (times - BEGIN)[:, None]
    places = np.array([0.2, 0.2, 0.5]) + since * [1.0, 0.7, 1.0] - 4.905 * since**2 * [0, 0, 1]
    depth = np.full((camera.height, camera.width), 2000, np.uint16)
    depth[:10, :10] = 0
    frames = [(BEGIN + STEP * k, depth) for k in range(-30, 40)]
    made = times[9]
    paths = np.stack([places[9:], places[9:] + 0.1])
    predictions = [PredictedPaths(made, times[9:] - made, paths)]
    file = tmp_path / "throw.gif"
    write_moving_picture(file, frames, perceived, Trajectory(times, places), 0.05, predictions)
    pictures_read = []
    with Image.open(file) as animated:
        assert animated.info["loop"] == 0
        for number in range(animated.n_frames):
            animated.seek(number)
            pictures_read.append(np.asarray(animated.convert("RGB")))
    return pictures_read


def count(picture: np.ndarray, color: str) -> int:
    return int((picture == ImageColor.getrgb(color)).all(axis=-1).sum())


def test_it_has_the_frames_of_the_throw_and_one_before(pictures):
    # Frames that are equal are stored as one that is shown longer.
    assert len(pictures) == 19 + 1
    assert {picture.shape for picture in pictures} == {(360, 480, 3)}


def test_what_was_seen_and_predicted_is_drawn_from_its_time_on(pictures):
    first = len(pictures) - 19
    observed = [count(picture, OBSERVED) for picture in pictures]
    ahead = [count(picture, PREDICTED) for picture in pictures]
    assert max(observed[:first]) == 0 < min(observed[first:])
    assert observed[-1] > 5 * observed[first]
    assert max(ahead[: first + 9]) == 0 < min(ahead[first + 9 : -2])
    # The way that is ahead becomes shorter.
    assert ahead[first + 9] > 2 * ahead[-4]
