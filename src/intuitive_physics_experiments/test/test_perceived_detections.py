"""What perception says of the errors of its detections, held against the truth of a recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from intuitive_physics.messages.geometry import seconds_from_stamp
from intuitive_physics.observation import Detections, Observation
from intuitive_physics_experiments.rendering.ground_truth import GroundTruth
from intuitive_physics_experiments.rendering.rendered_bag import RenderSettings, render_bag
from intuitive_physics_perception.detection.fitted_sphere import EDGE_GROWTH
from intuitive_physics_perception.environment.environment_model import EnvironmentModel
from intuitive_physics_perception.input.frame_decoder import FrameDecoder
from intuitive_physics_perception.pipeline import PerceptionPipeline
from intuitive_physics_perception.settings import PerceptionSettings
from intuitive_physics_recordings.bag_reader import BagReader
from intuitive_physics_recordings.depth_bag_writer import CAMERA_INFO_TOPIC, DEPTH_TOPIC

pytestmark = pytest.mark.long

THROWS = 3
RENDERED = RenderSettings(throws=THROWS, seed=2, lead_in=0.5, throw_duration=1.4, pause=0.35)


@dataclass(frozen=True, eq=False)
class Perceived:
    observations: Sequence[Observation]
    model: EnvironmentModel

    @property
    def tracks(self) -> list[Detections]:
        detections_of_all = [
            observed.detections
            for observation in self.observations
            for observed in observation.objects
        ]
        return [detections for detections in detections_of_all if detections is not None]


def perceive(bag: Path, seed: int, first: int = 0, dropped: float = 0.0) -> Perceived:
    """Perceive a bag from a frame on, as a node does that drops a part of the frames."""
    rng = np.random.default_rng(seed)
    pipeline, decoder = PerceptionPipeline(PerceptionSettings(), rng), FrameDecoder()
    observations, model = [], None
    with BagReader(bag) as reader:
        decoder.take_camera(reader.decode(next(iter(reader.messages([CAMERA_INFO_TOPIC])))))
        for k, message in enumerate(reader.messages([DEPTH_TOPIC])):
            if k < first or (k > first + 10 and rng.random() < dropped):
                continue
            image = reader.decode(message)
            points = decoder.image_points(image)
            result = pipeline.process(points, seconds_from_stamp(image.header.stamp))
            observations += result.observations
            model = result.model or model
    assert model is not None
    return Perceived([*observations, *pipeline.finish()], model)


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    path = tmp_path_factory.mktemp("bags") / "throws"
    render_bag(path, RENDERED)
    return path


@pytest.fixture(scope="module")
def perceived(bag):
    return perceive(bag, seed=0)


@pytest.fixture(scope="module")
def errors(bag, perceived):
    """Errors (n, 3) in m of the detections of each track, in the environment's frame."""
    truth, model = GroundTruth.load(bag), perceived.model

    all_errors = []
    for throw, track in zip(truth.throws, perceived.tracks, strict=True):
        since = np.clip(track.times - 1e-9 * truth.start_time, throw.start_time, throw.end_time)
        true_positions = (throw.positions_at(since) - truth.camera.position) @ truth.camera.rotation
        all_errors.append(track.positions - model.to_environment(true_positions))
    return all_errors


def mean_squares(off: NDArray[np.float64], covariances: NDArray[np.float64]) -> NDArray[np.float64]:
    """Squared errors (n, 3) in covariances (n, 3, 3), divided by their 3 components."""
    return np.einsum("ni,ni->n", off, np.linalg.solve(covariances, off[:, :, None])[:, :, 0]) / 3.0


def test_every_throw_has_its_detections(perceived):
    assert len(perceived.tracks) == THROWS
    for observation in perceived.observations:
        for observed in observation.objects:
            assert observed.detections is not None
            assert len(observed.detections) >= 20
            assert set(observed.detections.times) <= set(observed.trajectory.times)
            assert observed.detections.times[0] >= observation.start_time


def test_errors_of_their_own_are_as_large_as_the_covariances_say(perceived, errors):
    """About the common error of a track, squared errors in variances are one on average.

    120 errors of 3 components are known to 7 %; readings beyond the outline count as independent
    and are not quite, which makes up to 1.3 across the line of sight.
    """
    squares = [
        mean_squares(off - off.mean(axis=0), track.covariances) * len(off) / (len(off) - 1)
        for track, off in zip(perceived.tracks, errors, strict=True)
    ]
    assert 0.75 < np.concatenate(squares).mean() < 1.5
    assert all(0.6 < track_squares.mean() < 1.9 for track_squares in squares)


def test_the_common_error_is_within_the_bias(bag, perceived, errors):
    """The rendered camera has no error of calibration, so it is less than the bias allows for.

    Edges that grow by g pixels make a radius, and with it the way from the surface to the centre,
    larger by g z / f. No component of the bias is known exactly.
    """
    camera = GroundTruth.load(bag).camera
    eye = perceived.model.to_environment(np.zeros((1, 3)))
    farthest = max(
        float(np.linalg.norm(track.positions - eye, axis=1).max()) for track in perceived.tracks
    )
    most = EDGE_GROWTH * farthest / camera.focal_length
    means = np.stack([off.mean(axis=0) for off in errors])
    spread = np.stack([t.bias + t.covariances.mean(axis=0) / len(t) for t in perceived.tracks])
    assert mean_squares(means, spread).mean() < 1.5
    for track in perceived.tracks:
        deviations = np.sqrt(np.linalg.eigvalsh(track.bias))
        assert (deviations > 0.0).all()
        assert (deviations < most).all()


def test_errors_of_successive_frames_are_independent(perceived, errors):
    """Their correlation is zero within three standard deviations of what n errors tell."""
    scaled = [
        np.linalg.solve(np.linalg.cholesky(t.covariances), (off - off.mean(axis=0))[:, :, None])
        for t, off in zip(perceived.tracks, errors, strict=True)
    ]
    products = np.concatenate([(track[1:] * track[:-1]).ravel() for track in scaled])
    squares = np.concatenate([np.square(track).ravel() for track in scaled])
    assert abs(products.mean() / squares.mean()) < 3.0 / np.sqrt(products.size) + 0.05


def test_a_bag_that_is_played_again_adds_no_motion(bag, perceived):
    """Other random choices, a later first frame and dropped frames: each throw is recognised."""
    again = perceive(bag, seed=1, first=3, dropped=0.25)
    assert len(again.observations) == THROWS
    for i, observation in enumerate(again.observations):
        assert [observation.same_motion(first) for first in perceived.observations] == [
            k == i for k in range(THROWS)
        ]
    exactly = perceive(bag, seed=0)
    assert [one.id for one in exactly.observations] == [one.id for one in perceived.observations]
