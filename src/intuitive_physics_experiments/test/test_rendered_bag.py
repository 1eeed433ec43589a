"""Bags that are rendered, beside their ground truth."""

from __future__ import annotations

import shutil

import numpy as np
import pytest

from intuitive_physics.errors import InvalidInputError
from intuitive_physics_experiments.rendering.ground_truth import GroundTruth
from intuitive_physics_experiments.rendering.rendered_bag import (
    RenderSettings,
    render_bag,
    reuse_or_render_bag,
)
from intuitive_physics_recordings.bag_reader import BagReader
from intuitive_physics_recordings.depth_bag_writer import (
    DEPTH_TOPIC,
)


def test_a_rendered_bag_shows_the_ball_where_the_truth_has_it(small_bag):
    truth = GroundTruth.load(small_bag)
    (throw,) = truth.throws
    camera = truth.camera
    empty, shares = None, []
    with BagReader(small_bag) as bag:
        for message in bag.messages([DEPTH_TOPIC]):
            image = bag.decode(message).data.view("<u2").reshape(camera.height, camera.width)
            time = (message.time - truth.start_time) * 1e-9
            if empty is None:
                empty = image.astype(float)
            if not throw.start_time <= time <= throw.end_time:
                continue
            center = throw.positions_at(np.array([time]))[0]
            column, row = np.rint(camera.project(center)).astype(int)
            patch = image[row - 2 : row + 3, column - 2 : column + 3] / 1000.0
            expected = np.linalg.norm(center - camera.position) - throw.radius
            ray = np.linalg.norm(camera.rays()[row, column])
            shares.append(np.median(patch) * ray - expected)
    assert len(shares) == 31
    assert np.abs(shares).max() < 0.03


def test_ground_truth_round_trip(small_bag, tmp_path):
    truth = GroundTruth.load(small_bag)
    truth.save(tmp_path)
    again = GroundTruth.load(tmp_path)
    assert again.static_parameters.to_dict() == truth.static_parameters.to_dict()
    assert np.array_equal(again.throws[0].motion.positions, truth.throws[0].motion.positions)


@pytest.mark.parametrize("text", ["", "{", "[]", '{"format": "other"}'])
def test_damaged_ground_truth_is_refused(tmp_path, text):
    (tmp_path / "ground_truth.json").write_text(text)
    with pytest.raises(InvalidInputError):
        GroundTruth.load(tmp_path)


def test_same_settings_same_bag_and_it_is_reused(small_bag, tmp_path):
    wanted = RenderSettings(throws=1, seed=1, lead_in=0.5, throw_duration=1.0, pause=0.3)
    copy = tmp_path / small_bag.name
    render_bag(copy, wanted)
    for name in (f"{copy.name}.mcap", "metadata.yaml", "ground_truth.json"):
        assert (copy / name).read_bytes() == (small_bag / name).read_bytes()
    before = (copy / f"{copy.name}.mcap").stat().st_mtime_ns
    reuse_or_render_bag(copy, wanted)
    assert (copy / f"{copy.name}.mcap").stat().st_mtime_ns == before
    with pytest.raises(InvalidInputError, match="exists already"):
        render_bag(copy, wanted)


def test_nothing_is_left_of_a_render_that_failed(tmp_path):
    def interrupt(done: int, total: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        render_bag(tmp_path / "bag", RenderSettings(throws=1), interrupt)
    assert list(tmp_path.iterdir()) == []


def test_other_settings_render_again_but_foreign_folders_stay(tmp_path):
    foreign = tmp_path / "photos"
    foreign.mkdir()
    (foreign / "cat.jpg").write_text("miaow")
    with pytest.raises(InvalidInputError, match="ground truth"):
        reuse_or_render_bag(foreign, RenderSettings())
    assert (foreign / "cat.jpg").exists()
    shutil.rmtree(foreign)
