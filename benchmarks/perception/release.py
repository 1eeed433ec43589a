"""When observations of a thrown ball begin: against the moment at which a hand let it go."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.command import Outcome, report_progress
from benchmarks.perception.perceive import PerceptionRun
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
from intuitive_physics_perception.settings import PerceptionSettings

SEED = 41  # of the scenes, each of which has a generator of its own
SCENES, QUICK_SCENES = 12, 1
IN_TIME = 0.034  # s from the release within which an observation should begin: a frame at 30 Hz
EMPTY_TIME = 0.4  # s without a ball after each throw: a track ends


@dataclass(frozen=True)
class Release:
    """The beginning of the observation of a throw; None without an observation."""

    throw: HeldThrow
    # s from the release to the beginning of the observation, negative where that is early
    delay: float | None = None
    velocity_error: float | None = None  # m/s, of the first velocity

    @property
    def error(self) -> float:
        """Absolute error in s; the whole duration of a throw without an observation."""
        return self.throw.duration if self.delay is None else abs(self.delay)


def measure_release(quick: bool) -> Outcome:
    """Measure throws from a hand at several frame rates."""
    count = QUICK_SCENES if quick else SCENES
    releases: dict[int, list[Release]] = {rate: [] for rate in RATES}
    for k in range(count):
        report_progress(f"release scene {k + 1} of {count}")
        scene = random_scene(np.random.default_rng([SEED, k]))
        view = SceneView(scene)
        for rate in RATES:
            rng = np.random.default_rng([SEED, k, rate])
            releases[rate] += _perceive_throws(scene, view, rate, rng)
    figures = {str(rate): _milliseconds(group, 0.95) for rate, group in releases.items()}
    return Outcome([_table(releases)], {"release_error_ms": figures})


def _perceive_throws(
    scene: ReleaseScene, view: SceneView, rate: int, rng: np.random.Generator
) -> list[Release]:
    """Perceive all throws of a scene at a frame rate."""
    up = scene.camera.rotation.T @ UP
    run = PerceptionRun(PerceptionSettings(up_hint=(float(up[0]), float(up[1]), float(up[2]))))
    camera = NoisyDepthCamera(view.background, scene.camera.focal_length, CAMERA_NOISE, rng)
    rays = Intrinsics(scene.camera.width, scene.camera.height, scene.camera.matrix()).rays()
    frame = 0
    for _ in range(run.settings.environment_frames):
        run.process(points_from_depth(camera.read(), rays), frame / rate)
        frame += 1
    model = run.model
    releases = []
    for throw in scene.throws:
        # The frames' phase is random in time.
        start = (frame + rng.random()) / rate
        observations: list[Observation] = []
        while frame / rate - start < throw.duration + EMPTY_TIME:
            since = frame / rate - start
            part, region = (None, None)
            if 0.0 <= since <= throw.duration:
                part, region = view.with_throw(throw, since)
            result = run.process(points_from_depth(camera.read(part, region), rays), frame / rate)
            observations += result.observations
            frame += 1
        releases.append(_release(throw, start, observations, scene, model))
    return releases


def _release(
    throw: HeldThrow,
    start: float,
    observations: Sequence[Observation],
    scene: ReleaseScene,
    model: EnvironmentModel,
) -> Release:
    """Find the first observation of the thrown ball itself."""
    for observation in sorted(observations, key=lambda observation: observation.start_time):
        since = observation.start_time - start
        place = scene.camera.to_optical(throw.position(since))
        for item in observation.objects:
            state = item.initial_state
            if np.linalg.norm(model.to_sensor(state.position) - place) < throw.radius:
                velocity = throw.velocity(since) @ scene.camera.rotation
                error = np.linalg.norm(state.linear_velocity @ model.rotation - velocity)
                return Release(throw, since - throw.release, float(error))
    return Release(throw)


def _table(releases: dict[int, list[Release]]) -> Table:
    rows: list[list[Cell]] = []
    for rate, at_rate in releases.items():
        for name, hands in (("all", (False, True)), ("no", (False,)), ("yes", (True,))):
            group = [release for release in at_rate if release.throw.hand_is_seen in hands]
            errors = np.array([release.error for release in group])
            delays = [release.delay for release in group if release.delay is not None]
            velocities = [
                release.velocity_error for release in group if release.velocity_error is not None
            ]
            rows.append(
                [
                    rate,
                    name,
                    len(group),
                    _milliseconds(group, 0.5),
                    _milliseconds(group, 0.95),
                    float(np.mean(errors < IN_TIME)) if group else None,
                    sum(delay < -IN_TIME for delay in delays),
                    sum(delay > IN_TIME for delay in delays),
                    len(group) - len(delays),
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


def _milliseconds(releases: Sequence[Release], part: float) -> float | None:
    """Return a quantile of the errors, ms."""
    errors = [release.error for release in releases]
    return float(f"{1e3 * np.quantile(errors, part):.4g}") if errors else None
