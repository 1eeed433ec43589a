"""Runs our perception over a rendered bag and holds every frame against the truth."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.perception.score import NEAR, Ball, Score, matched
from benchmarks.perception.truth import TrueBall, TrueRecording
from intuitive_physics.observation import ObservedObject
from intuitive_physics.shapes import Sphere
from intuitive_physics_perception.detection.detections import DetectedSphere
from intuitive_physics_perception.environment.environment_model import EnvironmentModel
from intuitive_physics_perception.frame_result import FrameResult
from intuitive_physics_perception.input.frame_decoder import FrameDecoder
from intuitive_physics_perception.pipeline import PerceptionPipeline
from intuitive_physics_perception.settings import PerceptionSettings
from intuitive_physics_recordings.bag_reader import BagReader
from intuitive_physics_recordings.depth_bag_writer import CAMERA_INFO_TOPIC, DEPTH_TOPIC

SETTLED = 0.1  # s for which a ball must have been followed before its velocity counts


@dataclass(frozen=True, eq=False)
class Frame:
    """One frame of a bag."""

    time: float  # s of its stamp
    points: NDArray[np.float32]  # (height, width, 3) m in the sensor's frame
    balls: list[TrueBall]  # what truly is there


@dataclass
class Timing:
    """Seconds of frames that have been perceived in a known environment."""

    # time of the one thread that does the work, by stage
    stages: dict[str, list[float]] = field(default_factory=lambda: defaultdict(list))
    total: list[float] = field(default_factory=list)  # the same, from message to states
    # by the clock on the wall, from message to states
    wall: list[float] = field(default_factory=list)
    # of the frames that ended an episode, the time its observations take after the states
    closing: list[float] = field(default_factory=list)


@dataclass
class Findings:
    """What perception made of all bags."""

    detections: Score = field(default_factory=Score)  # spheres of each frame alone
    states: Score = field(default_factory=Score)  # filtered, with the radius averaged so far
    # errors in m of the trajectories of observations, up to 2 m
    smoothed: list[float] = field(default_factory=list)
    # errors in m/s of the last state before the first bounce
    first_velocities: list[float] = field(default_factory=list)
    gravity: list[float] = field(default_factory=list)  # degrees, of each bag
    # plane_angles, plane_offsets: degrees and m, of each true plane that was found
    plane_angles: list[float] = field(default_factory=list)
    plane_offsets: list[float] = field(default_factory=list)
    # planes_missing, planes_false: how many planes were not found, and found where none is
    planes_missing: int = 0
    planes_false: int = 0
    timing: Timing = field(default_factory=Timing)  # of each frame


@dataclass(frozen=True, eq=False)
class PerceivedBag:
    """What the others need to be compared with ours."""

    model: EnvironmentModel  # the environment
    detections: dict[float, list[Ball]]  # balls of each frame alone, by its stamp
    seconds: dict[float, float]  # that each frame took, by its stamp


def perceive_bag(
    path: Path, recording: TrueRecording, settings: PerceptionSettings, findings: Findings
) -> PerceivedBag:
    """Perceive a bag and add what came of it to `findings`."""
    pipeline = PerceptionPipeline(settings, np.random.default_rng(0), clock=time.thread_time)
    velocities = _FirstVelocities()
    model: EnvironmentModel | None = None
    observed: list[ObservedObject] = []
    truth: dict[float, list[TrueBall]] = {}
    detections: dict[float, list[Ball]] = {}
    seconds: dict[float, float] = {}
    for frame, perceived in _perceived(path, recording, pipeline, findings.timing):
        truth[frame.time] = frame.balls
        observed += [seen for o in perceived.observations for seen in o.objects]
        if perceived.is_new_model:
            model = perceived.model
        elif perceived.model is not None:
            seconds[frame.time] = findings.timing.total[-1]
            detections[frame.time] = _add_frame(
                frame, perceived, perceived.model, findings, velocities
            )
    if model is None:
        raise RuntimeError(f"perception never knew the environment of {path}")
    observed += [seen for o in pipeline.finish() for seen in o.objects]
    for seen in observed:
        findings.smoothed += _trajectory_errors(seen, truth, model)
    findings.first_velocities += velocities.errors.values()
    _add_environment(model, recording, findings)
    return PerceivedBag(model, detections, seconds)


def some_frames(
    path: Path, recording: TrueRecording, stamps: Sequence[float] | None = None
) -> Iterator[Frame]:
    """Yield the frames of a bag with some stamps, s, in order of time; all where none are given."""
    wanted = None if stamps is None else set(stamps)
    with BagReader(path) as bag:
        decoder = _decoder(bag)
        for message in bag.messages([DEPTH_TOPIC]):
            image = bag.decode(message)
            stamp = _stamp(image)
            if wanted is None or stamp in wanted:
                balls = recording.balls_at(_since(stamp, recording))
                yield Frame(stamp, decoder.image_points(image), balls)


def _perceived(
    path: Path, recording: TrueRecording, pipeline: PerceptionPipeline, timing: Timing
) -> Iterator[tuple[Frame, FrameResult]]:
    with BagReader(path) as bag:
        decoder = _decoder(bag)
        for message in bag.messages([DEPTH_TOPIC]):
            image = bag.decode(message)
            stamp = _stamp(image)
            wall, start = time.perf_counter(), time.thread_time()
            points = decoder.image_points(image)
            converted = time.thread_time()
            perceived = pipeline.process(points, stamp)
            end = time.thread_time()
            if perceived.model is not None and not perceived.is_new_model:
                timing.wall.append(time.perf_counter() - wall)
                timing.total.append(end - start)
                timing.stages["points"].append(converted - start)
                for stage, seconds in perceived.diagnostics.seconds.items():
                    timing.stages[stage].append(seconds)
            if perceived.episodes:
                start = time.thread_time()
                _ = perceived.observations
                timing.closing.append(time.thread_time() - start)
            yield Frame(stamp, points, recording.balls_at(_since(stamp, recording))), perceived


def _add_frame(
    frame: Frame,
    perceived: FrameResult,
    model: EnvironmentModel,
    findings: Findings,
    velocities: _FirstVelocities,
) -> list[Ball]:
    """Score one frame; return the balls found in it alone."""
    detections: list[Ball] = [
        (model.to_sensor(s.center), s.radius)
        for s in perceived.detections
        if isinstance(s, DetectedSphere)
    ]
    findings.detections.add(detections, frame.balls)
    followed = [seen for seen in perceived.objects if isinstance(seen.object.shape, Sphere)]
    states: list[Ball] = [
        (model.to_sensor(seen.state.position), seen.object.shape.bounding_radius)
        for seen in followed
    ]
    findings.states.add(states, frame.balls)
    for k, n in matched(states, frame.balls):
        velocity = followed[k].state.linear_velocity @ model.rotation
        velocities.add(frame.time, frame.balls[n], velocity)
    return detections


class _FirstVelocities:
    """Keeps the error of each ball's last velocity before its first bounce.

    Balls of one recording only.
    """

    def __init__(self) -> None:
        self.errors: dict[int, float] = {}
        self._since: dict[int, float] = {}

    def add(self, stamp: float, ball: TrueBall, velocity: NDArray[np.float64]) -> None:
        """Take the velocity (3,) that was estimated for a ball."""
        since = self._since.setdefault(ball.throw, stamp)
        if ball.before_bounce is not None and stamp - since >= SETTLED:
            self.errors[ball.throw] = float(np.linalg.norm(velocity - ball.velocity))


def _trajectory_errors(
    seen: ObservedObject, truth: dict[float, list[TrueBall]], model: EnvironmentModel
) -> list[float]:
    """Distances from the truth, by time, of an observed trajectory's points up to `NEAR`."""
    places = model.to_sensor(seen.trajectory.positions)
    errors = []
    for stamp, place in zip(seen.trajectory.times, places, strict=True):
        balls = truth[float(stamp)]
        pairs = matched([(place, 0.0)], balls)
        if pairs and balls[pairs[0][1]].distance <= NEAR:
            errors.append(float(np.linalg.norm(place - balls[pairs[0][1]].position)))
    return errors


def _add_environment(model: EnvironmentModel, recording: TrueRecording, findings: Findings) -> None:
    camera = recording.truth.camera
    up = camera.rotation.T @ np.array([0.0, 0.0, 1.0])
    findings.gravity.append(_degrees(model.rotation[2], up))
    free = list(model.detected)
    for plane in recording.truth.environment.planes:
        normal = plane.normal @ camera.rotation
        offset = plane.offset - float(plane.normal @ camera.position)
        best = min(free, key=lambda found: _degrees(found.normal, normal), default=None)
        if best is None or _degrees(best.normal, normal) > 5.0:
            findings.planes_missing += 1
            continue
        free = [found for found in free if found is not best]
        findings.plane_angles.append(_degrees(best.normal, normal))
        findings.plane_offsets.append(abs(best.offset - offset))
    findings.planes_false += len(free)


def _degrees(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    """Angle between two unit vectors; the chord keeps small ones exact."""
    return float(np.degrees(2.0 * np.arcsin(min(0.5 * float(np.linalg.norm(a - b)), 1.0))))


def _decoder(bag: BagReader) -> FrameDecoder:
    """The node's own way from messages to points."""
    decoder = FrameDecoder()
    decoder.take_camera(bag.decode(next(iter(bag.messages([CAMERA_INFO_TOPIC])))))
    return decoder


def _stamp(message: Any) -> float:
    return message.header.stamp.sec + message.header.stamp.nanosec * 1e-9


def _since(stamp: float, recording: TrueRecording) -> float:
    return stamp - 1e-9 * recording.truth.start_time
