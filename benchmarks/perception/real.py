"""Perception on real depth frames, also with balls rendered into them, and on LiDAR scans."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.command import report_progress
from benchmarks.perception.real_scenes import (
    CLOSE_GAP,
    EDGE_FAULTS,
    FRAME_TIME,
    FREE_GAP,
    NO_EDGE_FAULTS,
    PlacedBall,
    RealScene,
    SceneCamera,
    load_scenes,
    place_ball,
    place_touching_balls,
    throw_ball,
)
from benchmarks.perception.score import Score
from benchmarks.perception.truth import TrueBall
from benchmarks.results.result import Cell, Column, Table
from intuitive_physics.shapes import Sphere
from intuitive_physics_experiments.rendering.depth_noise import DepthNoise
from intuitive_physics_perception.detection.detections import DetectedSphere
from intuitive_physics_perception.environment.environment_model import EnvironmentModel
from intuitive_physics_perception.frame_result import FrameResult
from intuitive_physics_perception.pipeline import PerceptionPipeline
from intuitive_physics_perception.scene import perceive_cloud
from intuitive_physics_perception.settings import PerceptionSettings

SEED = 18  # of the balls and the noise; each scene has a generator of its own
EMPTY_FRAMES = 60  # frames without a ball after those that the environment is modelled from
# Placements of balls of each kind in a scene, and frames in a row that show each
PLACEMENTS, FRAMES_EACH = 6, 5
THROWS, FLIGHT_FRAMES = 3, 12  # throws through a scene, and frames of each at most
# m of range from the sensor, for the normalised errors
BANDS = {"below_1.2": (0.0, 1.2), "1.2_2": (1.2, 2.0), "beyond": (2.0, np.inf)}
# Degrees by which the normal of a plausible support differs at most from the image's upward
# direction: about the image's horizontal axis, and about the optical axis
STEEPEST, MOST_ROLL = 65.0, 30.0

# m, of the exercise ball in the LiDAR scans with the error of a fit to 8 mm of noise
BALL_RADII_IN_SCANS = (0.24, 0.33)
# Readings on the ball of a scan at least: a plain RANSAC finds 95 in the sparsest one
FEWEST_ON_BALL = 80
# How balls come into a known scene: thrown ones are free, too
KINDS = ("free", "thrown", "close", "touching")
STANDING = "standing"  # a free ball that was there when the environment was modelled
STANDING_FRAMES = 10  # frames of it after that

# Balls of one frame and the camera's faults there
Placement = tuple[Sequence[PlacedBall], DepthNoise]


@dataclass
class RealFindings:
    """What perception made of some scenes."""

    scenes: int = 0  # how many
    # objects with the shape of a sphere that were published, in frames without a ball
    followed: int = 0
    plausible: int = 0  # scenes whose support could be one
    empty: Score = field(default_factory=Score)  # detections in frames without a ball
    # detections by kind of placement
    balls: dict[str, Score] = field(default_factory=lambda: defaultdict(Score))
    # (eᵀ C⁻¹ e) / 3 of the centres found in single frames, by band of range
    nees: dict[str, list[float]] = field(default_factory=lambda: defaultdict(list))
    seconds: list[float] = field(default_factory=list)  # on the processor, of each frame

    def recall(self, *kinds: str) -> float:
        """Part of the balls of some kinds that was found, NaN where there were none."""
        visible = sum(self.balls[kind].visible for kind in kinds)
        return sum(self.balls[kind].found for kind in kinds) / visible if visible else float("nan")

    def add(self, other: RealFindings) -> None:
        """Take what was found in other scenes, too."""
        self.scenes += other.scenes
        self.followed += other.followed
        self.plausible += other.plausible
        self.seconds += other.seconds
        for own, score in [(self.empty, other.empty)] + [
            (self.balls[kind], score) for kind, score in other.balls.items()
        ]:
            own.frames += score.frames
            own.visible += score.visible
            own.found += score.found
            own.false += score.false
            own.hits += score.hits
        for band, values in other.nees.items():
            self.nees[band] += values

    def figures(self) -> dict[str, Any]:
        """Return the key figures, null where nothing was measured."""
        return {
            "false_followed_per_scene": _rounded(self.followed / self.scenes),
            "false_per_1000_frames": _rounded(self.empty.false_positives_per_1000),
            "recall_free": _rounded(self.recall("free", "thrown", STANDING)),
            "recall_close": _rounded(self.recall("close")),
            "recall_touching": _rounded(self.recall("touching")),
            "support_plausible": _rounded(self.plausible / self.scenes),
            "nees": {
                band: _rounded(float(np.mean(self.nees[band])) if self.nees[band] else np.nan)
                for band in BANDS
            },
        }


def measure_real_scenes(folder: Path, quick: bool) -> tuple[dict[str, Any], list[Table]]:
    """Return key figures and table of all scenes of a folder; nothing where there are none."""
    scenes = load_scenes(folder)[:: 3 if quick else 1]
    if not scenes:
        report_progress(f"real scenes left out: {folder} has no scene (.npz)")
        return {}, []
    halves = {True: RealFindings(), False: RealFindings()}
    for k, scene in enumerate(scenes):
        report_progress(f"real scene {k + 1} of {len(scenes)}: {scene.name}")
        halves[scene.tuning].add(perceive_scene(scene))
    both = RealFindings()
    for half in halves.values():
        both.add(half)
    named = {"all": both, "tuning": halves[True], "held back": halves[False]}
    return {"real": both.figures()}, [scenes_table(named)]


def perceive_scene(scene: RealScene) -> RealFindings:
    """Look at one scene without a ball and with balls of each kind."""
    seed = int.from_bytes(scene.name.encode(), "big")
    rng = np.random.default_rng([SEED, seed])
    findings = RealFindings(scenes=1)
    session = Session(scene, rng, findings.seconds)
    findings.plausible = int(session.model is not None and _is_plausible(session.model))
    followed = set()
    for _ in range(EMPTY_FRAMES):
        result, _ = session.look()
        findings.empty.add([(s.center, s.radius) for s in _spheres(result)], [])
        followed |= {
            seen.object.id for seen in result.objects if isinstance(seen.object.shape, Sphere)
        }
    findings.followed = len(followed)
    for kind in KINDS:
        for balls, noise in _placements(scene, kind, rng):
            _add_frame(*session.look(balls, noise), findings.balls[kind], findings.nees)
    ball = place_ball(scene, FREE_GAP, rng)
    if ball is not None:
        session = Session(scene, rng, findings.seconds, [ball])
        for _ in range(STANDING_FRAMES):
            _add_frame(*session.look([ball]), findings.balls[STANDING], findings.nees)
    return findings


def _placements(scene: RealScene, kind: str, rng: np.random.Generator) -> list[Placement]:
    """Balls by frame, the faults at edges at every second placement."""
    frames: list[Placement] = []
    for k in range(THROWS if kind == "thrown" else PLACEMENTS):
        noise = EDGE_FAULTS if k % 2 else NO_EDGE_FAULTS
        if kind == "thrown":
            places = [[ball] for ball in throw_ball(scene, rng, FLIGHT_FRAMES)]
        elif kind == "touching":
            places = [place_touching_balls(scene, rng)] * FRAMES_EACH
        else:
            ball = place_ball(scene, FREE_GAP if kind == "free" else CLOSE_GAP, rng)
            places = [[ball] if ball else []] * FRAMES_EACH
        frames += [(balls, noise) for balls in places if balls]
    return frames


class Session:
    """Perception of one scene, whose environment it models at once."""

    def __init__(
        self,
        scene: RealScene,
        rng: np.random.Generator,
        seconds: list[float],
        balls: Sequence[PlacedBall] = (),
    ) -> None:
        settings = PerceptionSettings()
        self._seconds = seconds
        self._time = 0.0
        self._cameras = {
            noise: SceneCamera(scene, noise, rng) for noise in (NO_EDGE_FAULTS, EDGE_FAULTS)
        }
        self._pipeline = PerceptionPipeline(settings, np.random.default_rng(0))
        self.model: EnvironmentModel | None = None
        for _ in range(settings.environment_frames):
            self.model = self.look(balls)[0].model

    def look(
        self, balls: Sequence[PlacedBall] = (), noise: DepthNoise = NO_EDGE_FAULTS
    ) -> tuple[FrameResult, list[TrueBall]]:
        """Perceive the next frame; return what was found and what is there."""
        points, truth = self._cameras[noise].read(balls)
        self._time += FRAME_TIME
        start = time.thread_time()
        result = self._pipeline.process(points, self._time)
        if result.model is not None and not result.is_new_model:
            self._seconds.append(time.thread_time() - start)
        return result, truth


def _add_frame(
    result: FrameResult,
    truth: list[TrueBall],
    score: Score,
    nees: dict[str, list[float]],
) -> None:
    """Score one frame with balls."""
    if result.model is None:
        score.add([], truth)
        return
    model, spheres = result.model, _spheres(result)
    found = [(model.to_sensor(s.center), s.radius) for s in spheres]
    for k, n in score.add(found, truth):
        error = found[k][0] - truth[n].position
        covariance = model.rotation.T @ spheres[k].covariance[:3, :3] @ model.rotation
        for band, (nearest, farthest) in BANDS.items():
            if nearest <= truth[n].distance < farthest:
                nees[band].append(float(error @ np.linalg.solve(covariance, error)) / 3.0)


def _spheres(result: FrameResult) -> list[DetectedSphere]:
    return [found for found in result.detections if isinstance(found, DetectedSphere)]


def _is_plausible(model: EnvironmentModel) -> bool:
    """Whether the support faces up in the image of a camera that is held about upright."""
    x, y, z = model.detected[0].normal
    roll = np.degrees(np.arctan2(abs(x), -y))
    pitch = np.degrees(np.arctan2(abs(z), np.hypot(x, y)))
    return bool(roll <= MOST_ROLL and pitch <= STEEPEST)


def measure_clouds(folder: Path) -> tuple[dict[str, Any], list[Table]]:
    """Return key figures and table of the LiDAR scans of a folder, each of which shows one ball."""
    paths = sorted(folder.glob("lidar_ball_*.npz"))
    if not paths:
        report_progress(f"LiDAR scans left out: {folder} has no lidar_ball_*.npz")
        return {}, []
    rows: list[list[Cell]] = []
    found = false = 0
    for path in paths:
        report_progress(f"LiDAR scan {path.stem}")
        with np.load(path) as data:
            points = np.asarray(data["xyz"], dtype=np.float64)
        environment, spheres = perceive_cloud(
            points, PerceptionSettings(), np.random.default_rng(0)
        )
        balls = [s for s in spheres if _is_ball_of_scan(s)]
        found += bool(balls)
        false += len(spheres) - bool(balls)
        radius = f"{balls[0].radius:.3f}" if balls else "none"
        rows.append([path.stem, radius, len(spheres) - bool(balls), len(environment.planes)])
    table = Table(
        title="LiDAR scans with one ball",
        columns=[Column("scan"), Column("radius found", "m"), Column("false"), Column("planes")],
        rows=rows,
    )
    return {"lidar_found": f"{found} of {len(paths)}", "lidar_false": false}, [table]


def _is_ball_of_scan(sphere: DetectedSphere) -> bool:
    """Whether a sphere has the size of the scans' ball and enough readings."""
    least, most = BALL_RADII_IN_SCANS
    return least <= sphere.radius <= most and sphere.points >= FEWEST_ON_BALL


def scenes_table(named: dict[str, RealFindings]) -> Table:
    """Return the figures of all scenes, of those to tune on and of those held back."""
    rows: list[list[Cell]] = []
    for name, findings in named.items():
        if not findings.scenes:
            continue
        figures = findings.figures()
        nees = [figures["nees"][band] for band in BANDS]
        with_balls = [findings.balls[kind] for kind in (*KINDS, STANDING)]
        frames = sum(score.frames for score in with_balls)
        rows.append(
            [
                name,
                findings.scenes,
                *(value for key, value in figures.items() if key != "nees"),
                *nees,
                *(_rounded(findings.recall(kind)) for kind in ("thrown", STANDING)),
                _rounded(1000.0 * sum(s.false for s in with_balls) / max(frames, 1)),
                _rounded(1e3 * float(np.median(findings.seconds))),
            ]
        )
    return Table(
        title="Real scenes",
        columns=[
            Column("half"),
            Column("scenes"),
            Column("followed false balls a scene"),
            Column("false in 1,000 frames"),
            Column("recall free"),
            Column("close"),
            Column("touching"),
            Column("support plausible"),
            Column("NEES / 3 below 1.2 m"),
            Column("1.2 to 2 m"),
            Column("beyond"),
            Column("recall thrown"),
            Column("there from the start"),
            Column("false in 1,000 frames with balls"),
            Column("median CPU time", "ms"),
        ],
        rows=rows,
        remarks=[
            f"{EMPTY_FRAMES} frames without a ball in each scene; {PLACEMENTS} placements of each "
            f"kind for {FRAMES_EACH} frames, {THROWS} throws of {FLIGHT_FRAMES} frames at most.",
        ],
    )


def _rounded(value: float) -> float | None:
    return float(f"{value:.4g}") if np.isfinite(value) else None
