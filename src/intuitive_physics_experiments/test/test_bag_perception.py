"""Perception run over bags: depth images with camera info, and point clouds."""

from __future__ import annotations

import numpy as np
import pytest

from intuitive_physics.errors import InvalidInputError
from intuitive_physics_cli.evaluation.recording_perception import (
    find_frame_source,
    perceive_recording,
    read_frames,
)
from intuitive_physics_experiments.rendering.ground_truth import GroundTruth
from intuitive_physics_perception.settings import KnownObject, PerceptionSettings
from intuitive_physics_recordings.bag_reader import BagReader
from intuitive_physics_recordings.depth_bag_writer import CAMERA_INFO_TOPIC, DEPTH_TOPIC


def test_depth_images_are_guessed_with_their_camera(small_bag):
    with BagReader(small_bag) as bag:
        source = find_frame_source(bag)
        assert (source.topic, source.camera_info_topic) == (DEPTH_TOPIC, CAMERA_INFO_TOPIC)
        time, points = next(iter(read_frames(bag, source)))
        assert time == pytest.approx(bag.start_time * 1e-9)
    truth = GroundTruth.load(small_bag)
    world = points @ truth.camera.rotation.T + truth.camera.position
    is_measured = np.isfinite(points[..., 2])
    distances = [np.abs(p.signed_distances(world[is_measured])) for p in truth.environment.planes]
    assert np.median(np.min(distances, axis=0)) < 0.01


def test_a_throw_becomes_an_observation_near_the_truth(small_bag):
    truth = GroundTruth.load(small_bag)
    (throw,) = truth.throws
    settings = PerceptionSettings(known_objects=(KnownObject("foam", throw.radius, "foam"),))
    progress: list[tuple[int, int]] = []
    perceived = perceive_recording(
        small_bag,
        settings,
        np.random.default_rng(0),
        on_progress=lambda done, total: progress.append((done, total)),
    )
    assert progress[-1] == (perceived.source.frames, perceived.source.frames)
    assert perceived.model is not None
    assert len(perceived.model.environment.planes) == 3
    assert perceived.frames_with_spheres >= 28
    (observation,) = perceived.observations
    (ball,) = observation.objects
    assert ball.object.material == "foam"
    sensor = perceived.model.to_sensor(ball.trajectory.positions)
    world = sensor @ truth.camera.rotation.T + truth.camera.position
    times = ball.trajectory.times - truth.start_time * 1e-9
    inside = (times >= throw.start_time) & (times <= throw.end_time)
    errors = np.linalg.norm(world[inside] - throw.positions_at(times[inside]), axis=1)
    assert np.sqrt((errors**2).mean()) < 0.01


def test_a_topic_that_is_not_there_is_refused(small_bag):
    with BagReader(small_bag) as bag, pytest.raises(InvalidInputError, match="on /other"):
        find_frame_source(bag, "/other")
