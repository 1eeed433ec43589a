"""When observations of a thrown ball begin: against the moment at which a hand let it go."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.command import report_progress
from benchmarks.perception.release_scenes import (
    CAMERA_NOISE,
    RATES,
    HeldThrow,
    ReleaseScene,
    SceneView,
    random_scene,
)
from benchmarks.perception.score import rms
from benchmarks.results.result import Cell, Column, Table
from intuitive_physics.observation import Observation
from intuitive_physics_experiments.rendering.camera import UP
from intuitive_physics_experiments.rendering.depth_noise import NoisyDepthCamera
from intuitive_physics_perception.environment.environment_model import EnvironmentModel
from intuitive_physics_perception.input.camera import Intrinsics
from intuitive_physics_perception.input.depth import points_from_depth
from intuitive_physics_perception.pipeline import PerceptionPipeline
from intuitive_physics_perception.settings import PerceptionSettings

SEED = 41  # of the scenes, each of which has a generator of its own
SCENES, QUICK_SCENES = 12, 3  # scenes of a full measurement and of a first look
IN_TIME = 0.034  # s from the release within which an observation is to begin: one frame at 30 Hz
EMPTY_TIME = 0.4  # s without a ball after each throw: a track ends


@dataclass
class ReleaseErrors:
    """What became of the throws at one frame rate, by whether the hand is seen."""

    # s from the release to the beginning of the observation, negative where that is early
    early: dict[bool, list[float]] = field(default_factory=lambda: {False: [], True: []})
    # m/s, errors of the first velocity
    velocities: dict[bool, list[float]] = field(default_factory=lambda: {False: [], True: []})
    # throws without an observation
    missing: dict[bool, list[float]] = field(default_factory=lambda: {False: [], True: []})

    def errors(self, hands: Sequence[bool]) -> NDArray[np.float64]:
        """Return the absolute errors (n,) in s, a missing throw's its whole duration."""
        found = [abs(error) for hand in hands for error in self.early[hand]]
        return np.array(found + [time for hand in hands for time in self.missing[hand]])


def measure_release(quick: bool, seed: int = SEED) -> tuple[dict[str, Any], list[Table]]:
    """Return key figures and table of throws from a hand at several frame rates."""
    count = QUICK_SCENES if quick else SCENES
    found = {rate: ReleaseErrors() for rate in RATES}
    for k in range(count):
        report_progress(f"release scene {k + 1} of {count}")
        scene = random_scene(np.random.default_rng([seed, k]))
        view = SceneView(scene)
        for rate in RATES:
            measure_scene(scene, view, rate, np.random.default_rng([seed, k, rate]), found[rate])
    both = (False, True)
    figures = {str(rate): _milliseconds(found[rate].errors(both), 0.95) for rate in RATES}
    return {"release_error_ms": figures}, [release_table(found)]


def measure_scene(
    scene: ReleaseScene,
    view: SceneView,
    rate: int,
    rng: np.random.Generator,
    errors: ReleaseErrors,
) -> None:
    """Perceive all throws of a scene at a frame rate and add what came of them to `errors`."""
    up = scene.camera.rotation.T @ UP
    settings = PerceptionSettings(up_hint=(float(up[0]), float(up[1]), float(up[2])))
    pipeline = PerceptionPipeline(settings, np.random.default_rng(0))
    camera = NoisyDepthCamera(view.background, scene.camera.focal_length, CAMERA_NOISE, rng)
    rays = Intrinsics(scene.camera.width, scene.camera.height, scene.camera.matrix()).rays()
    frame, model = 0, None
    for _ in range(settings.environment_frames):
        model = pipeline.process(points_from_depth(camera.read(), rays), frame / rate).model
        frame += 1
    for throw in scene.throws:
        # The frames' phase is random in time.
        start = (frame + rng.random()) / rate
        observations: list[Observation] = []
        while frame / rate - start < throw.duration + EMPTY_TIME:
            since = frame / rate - start
            part, region = (None, None)
            if 0.0 <= since <= throw.duration:
                part, region = view.with_throw(throw, since)
            points = points_from_depth(camera.read(part, region), rays)
            result = pipeline.process(points, frame / rate)
            observations += result.observations
            frame += 1
        if model is None:
            raise RuntimeError("perception never knew the environment of a release scene")
        _add_throw(throw, start, observations, scene, model, errors)


def _add_throw(
    throw: HeldThrow,
    start: float,
    observations: Sequence[Observation],
    scene: ReleaseScene,
    model: EnvironmentModel,
    errors: ReleaseErrors,
) -> None:
    """Take the first observation of the thrown ball itself."""
    for observation in sorted(observations, key=lambda one: one.start_time):
        since = observation.start_time - start
        place = scene.camera.to_optical(throw.position(since))
        for seen in observation.objects:
            away = model.to_sensor(seen.initial_state.position) - place
            if np.linalg.norm(away) < throw.radius:
                velocity = throw.velocity(since) @ scene.camera.rotation
                found = seen.initial_state.linear_velocity @ model.rotation
                errors.early[throw.hand_is_seen].append(since - throw.release)
                errors.velocities[throw.hand_is_seen].append(
                    float(np.linalg.norm(found - velocity))
                )
                return
    errors.missing[throw.hand_is_seen].append(throw.duration)


def release_table(found: dict[int, ReleaseErrors]) -> Table:
    """Return errors by frame rate and by whether the hand is seen."""
    rows: list[list[Cell]] = []
    for rate, errors in found.items():
        for name, hands in (("all", (False, True)), ("no", (False,)), ("yes", (True,))):
            own = errors.errors(hands)
            early = [error for hand in hands for error in errors.early[hand]]
            velocities = [error for hand in hands for error in errors.velocities[hand]]
            rows.append(
                [
                    rate,
                    name,
                    len(own),
                    _milliseconds(own, 0.5),
                    _milliseconds(own, 0.95),
                    float(np.mean(own < IN_TIME)) if own.size else None,
                    sum(error < -IN_TIME for error in early),
                    sum(error > IN_TIME for error in early),
                    sum(len(errors.missing[hand]) for hand in hands),
                    float(np.median(velocities)) if velocities else None,
                    rms(velocities) if velocities else None,
                ]
            )
    return Table(
        title="Beginning of observations of balls thrown by a hand",
        note="Time from the true release, and error of the first velocity.",
        columns=[
            Column("frames a second", "1/s"),
            Column("hand seen"),
            Column("throws"),
            Column("median", "ms", ".1f"),
            Column("95 %", "ms", ".1f"),
            Column(f"within {1e3 * IN_TIME:g} ms", "", ".1%"),
            Column("earlier"),
            Column("later"),
            Column("missing"),
            Column("first velocity, median", "m/s", ".3f"),
            Column("RMS", "m/s", ".3f"),
        ],
        rows=rows,
        remarks=["A throw without an observation counts with its whole duration."],
    )


def _milliseconds(errors: NDArray[np.float64], part: float) -> float | None:
    return float(f"{1e3 * np.quantile(errors, part):.4g}") if errors.size else None
