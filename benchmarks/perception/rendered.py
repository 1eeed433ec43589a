"""Rendered bags: perception against the truth, and beside other libraries on some frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from time import thread_time

import numpy as np
from numpy.typing import NDArray

from benchmarks.command import Outcome, report_progress
from benchmarks.perception.peers import FrameByFrame, Open3dAndPyransac, Peer
from benchmarks.perception.perceive import (
    Frame,
    PerceptionRun,
    bag_frames,
    detected_balls,
    is_of_known_environment,
    rendered_bag,
    tracked_spheres,
)
from benchmarks.perception.report import (
    Comparison,
    Findings,
    accuracy_table,
    key_figures,
    misses,
    peers_table,
    timing_table,
)
from benchmarks.perception.scenes import SceneKind, random_truth
from benchmarks.perception.score import NEAR, Ball, matched
from benchmarks.perception.truth import TrueBall, TrueRecording
from intuitive_physics.observation import ObservedObject
from intuitive_physics_experiments.rendering.camera import UP
from intuitive_physics_perception.environment.environment_model import EnvironmentModel
from intuitive_physics_perception.frame_result import FrameResult

SEED = 5  # of the scenes, each of which has a generator of its own
OURS = "ours"  # name of our perception beside the others
SETTLED = 0.1  # s for which a ball must have been tracked before its velocity counts


@dataclass(frozen=True)
class Effort:
    """How much is measured."""

    scenes: int  # rendered bags; their kinds take turns
    throws: int  # in each bag
    peer_frames: int  # of each bag that the others get, too


FULL = Effort(scenes=20, throws=10, peer_frames=3)  # for the results that are kept
QUICK = Effort(scenes=3, throws=2, peer_frames=1)  # for a first look


def measure_rendered(quick: bool) -> Outcome:
    """Measure every rendered scene."""
    effort = QUICK if quick else FULL
    findings, comparison = Findings(), Comparison()
    for k in range(effort.scenes):
        kind = SceneKind(
            planes=1 + k % 3, balls_at_once=1 + k // 3 % 3, throws=effort.throws, crates=k % 4
        )
        report_progress(f"scene {k + 1} of {effort.scenes}: {kind}")
        rng = np.random.default_rng([SEED, k])
        _measure_scene(kind, rng, effort.peer_frames, findings, comparison)
    figures = key_figures(findings, comparison.milliseconds[Open3dAndPyransac.name])
    return Outcome(
        tables=[accuracy_table(findings), timing_table(findings), peers_table(comparison)],
        key_figures={name: float(f"{value:.4g}") for name, value in figures.items()},
        note=f"{effort.scenes} rendered bags of {effort.throws} throws: balls of 3, 5 and 7 cm "
        "radius at 1 to 3 m, one to three at once; one to three planes, none to three crates; the "
        "camera tilted by 15 to 40° and a little rolled; all its faults on.",
        complaints=[f"bar not reached: {miss}" for miss in misses(figures)],
    )


def _measure_scene(
    kind: SceneKind,
    rng: np.random.Generator,
    peer_frames: int,
    findings: Findings,
    comparison: Comparison,
) -> None:
    """Render one bag and let ours and the others perceive it."""
    recording = TrueRecording(random_truth(kind, rng))
    with rendered_bag(recording.truth, rng) as path:
        bag = _Bag(recording, findings)
        for frame in bag_frames(path, recording):
            bag.perceive(frame)
        model = bag.finish()
        peers: list[Peer] = [Open3dAndPyransac(), FrameByFrame(model.detected, rng)]
        chosen = _chosen(recording, list(bag.detections), peer_frames, rng)
        for frame in bag_frames(path, recording, chosen):
            seconds = bag.seconds[frame.time]
            comparison.add(OURS, bag.detections[frame.time], seconds, frame.balls)
            points = frame.points[np.isfinite(frame.points[:, :, 2])].astype(np.float64)
            for peer in peers:
                balls, seconds = peer.timed(points, kind.planes, len(frame.balls))
                comparison.add(peer.name, balls, seconds, frame.balls, peer.how)


def _chosen(
    recording: TrueRecording, stamps: Sequence[float], count: int, rng: np.random.Generator
) -> list[float]:
    """Stamps of random frames that show a ball."""
    start = 1e-9 * recording.truth.start_time
    throws = recording.truth.throws
    shown = [
        stamp
        for stamp in stamps
        if any(throw.start_time <= stamp - start <= throw.end_time for throw in throws)
    ]
    return sorted(rng.choice(shown, size=min(count, len(shown)), replace=False).tolist())


class _Bag:
    """Perceives the frames of a bag, and adds their errors to the findings."""

    def __init__(self, recording: TrueRecording, findings: Findings) -> None:
        self.run = PerceptionRun()
        self.detections: dict[float, list[Ball]] = {}  # of each frame alone, by its stamp
        self.seconds: dict[float, float] = {}  # of each frame, by its stamp
        self._recording = recording
        self._findings = findings
        self._truth: dict[float, list[TrueBall]] = {}
        self._observed: list[ObservedObject] = []
        self._tracked_since: dict[int, float] = {}  # stamp, by the number of the throw
        # m/s, of each ball's last state before its first bounce, by the number of the throw
        self._velocity_errors: dict[int, float] = {}

    def perceive(self, frame: Frame) -> None:
        """Perceive a frame and score it."""
        findings = self._findings
        result = self.run.process(frame.points, frame.time)
        is_known = is_of_known_environment(result)
        if is_known:
            total = frame.seconds + self.run.seconds[-1]
            findings.wall.append(frame.wall + self.run.wall[-1])
            findings.total.append(total)
            findings.stages["points"].append(frame.seconds)
            for stage, seconds in result.diagnostics.seconds.items():
                findings.stages[stage].append(seconds)
            self.seconds[frame.time] = total
        if result.episodes:
            start = thread_time()
            observations = result.observations
            findings.closing.append(thread_time() - start)
            self._observed += [item for o in observations for item in o.objects]
        self._truth[frame.time] = frame.balls
        if is_known and result.model is not None:
            self._score(frame, result, result.model)

    def _score(self, frame: Frame, result: FrameResult, model: EnvironmentModel) -> None:
        detections = detected_balls(result)
        self.detections[frame.time] = detections
        self._findings.detections.add(detections, frame.balls)
        tracked = tracked_spheres(result)
        states: list[Ball] = [
            (model.to_sensor(item.state.position), item.object.shape.bounding_radius)
            for item in tracked
        ]
        self._findings.states.add(states, frame.balls)
        for k, n in matched(states, frame.balls):
            ball = frame.balls[n]
            since = self._tracked_since.setdefault(ball.throw, frame.time)
            if ball.before_bounce is not None and frame.time - since >= SETTLED:
                velocity = tracked[k].state.linear_velocity @ model.rotation
                error = float(np.linalg.norm(velocity - ball.velocity))
                self._velocity_errors[ball.throw] = error

    def finish(self) -> EnvironmentModel:
        """Score the observations and the environment, and return it."""
        findings, model = self._findings, self.run.model
        self._observed += [item for o in self.run.pipeline.finish() for item in o.objects]
        for item in self._observed:
            findings.smoothed += _trajectory_errors(item, self._truth, model)
        findings.first_velocities += self._velocity_errors.values()
        _add_environment(model, self._recording, findings)
        return model


def _trajectory_errors(
    item: ObservedObject, truth: dict[float, list[TrueBall]], model: EnvironmentModel
) -> list[float]:
    """Errors in m of an observed trajectory's points up to `NEAR`."""
    places = model.to_sensor(item.trajectory.positions)
    errors = []
    for stamp, place in zip(item.trajectory.times, places, strict=True):
        balls = truth[float(stamp)]
        pairs = matched([(place, 0.0)], balls)
        if pairs and balls[pairs[0][1]].distance <= NEAR:
            errors.append(float(np.linalg.norm(place - balls[pairs[0][1]].position)))
    return errors


def _add_environment(model: EnvironmentModel, recording: TrueRecording, findings: Findings) -> None:
    camera = recording.truth.camera
    findings.gravity.append(_degrees(model.rotation[2], camera.rotation.T @ UP))
    free = list(model.detected)
    for plane in recording.truth.environment.planes:
        normal = plane.normal @ camera.rotation
        offset = plane.offset - float(plane.normal @ camera.position)
        best = min(free, key=lambda other: _degrees(other.normal, normal), default=None)
        if best is None or _degrees(best.normal, normal) > 5.0:
            findings.planes_missing += 1
            continue
        free = [other for other in free if other is not best]
        findings.plane_angles.append(_degrees(best.normal, normal))
        findings.plane_offsets.append(abs(best.offset - offset))
    findings.planes_false += len(free)


def _degrees(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    """Angle between two unit vectors (3,); the chord keeps small ones exact."""
    return float(np.degrees(2.0 * np.arcsin(min(0.5 * float(np.linalg.norm(a - b)), 1.0))))
