"""Perception on real depth frames, also with balls rendered into them, and on LiDAR scans."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.command import Outcome, report_progress
from benchmarks.perception.perceive import (
    PerceptionRun,
    detected_balls,
    detected_spheres,
    tracked_spheres,
)
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
from intuitive_physics_experiments.rendering.depth_noise import DepthNoise
from intuitive_physics_perception.detection.detections import DetectedSphere
from intuitive_physics_perception.environment.environment_model import EnvironmentModel
from intuitive_physics_perception.frame_result import FrameResult
from intuitive_physics_perception.scene import perceive_cloud
from intuitive_physics_perception.settings import PerceptionSettings

SEED = 18  # of the balls and the noise; each scene has a generator of its own
EMPTY_FRAMES = 60  # without a ball after those that the environment is modelled from
PLACEMENTS, FRAMES_EACH = 6, 5  # of balls of each kind in a scene, and frames in a row of each
THROWS, FLIGHT_FRAMES = 3, 12  # through a scene, and frames of each at most
STANDING_FRAMES = 10  # of a ball that was there when the environment was modelled
# m of range from the sensor, for the normalised errors
BANDS = {"below_1.2": (0.0, 1.2), "1.2_2": (1.2, 2.0), "beyond": (2.0, np.inf)}
# Degrees by which the normal of a plausible support differs at most from the image's upward
# direction: about the image's horizontal axis, and about the optical axis
STEEPEST, MOST_ROLL = 65.0, 30.0
# m, of the exercise ball in the LiDAR scans with the error of a fit to 8 mm of noise
BALL_RADII_IN_SCANS = (0.24, 0.33)
FEWEST_ON_BALL = 80  # readings on the ball of a scan: a plain RANSAC finds 95 in the sparsest one
# How balls come into a known scene: thrown ones are free, too
KINDS = ("free", "thrown", "close", "touching")
STANDING = "standing"  # a free ball that was there when the environment was modelled


@dataclass
class Findings:
    """The results of perception in one scene."""

    is_plausible: bool = False  # whether the support could be one
    false_tracks: int = 0  # spheres that were published in frames without a ball
    empty: Score = field(default_factory=Score)  # detections in frames without a ball
    # Detections by kind of placement
    balls: dict[str, Score] = field(default_factory=lambda: defaultdict(Score))
    # (eᵀ C⁻¹ e) / 3 of the centres found in single frames, by band of range
    nees: dict[str, list[float]] = field(default_factory=lambda: defaultdict(list))
    seconds: list[float] = field(default_factory=list)  # of the thread, of each frame


def measure_real(scenes: Path, clouds: Path, quick: bool) -> Outcome:
    """Measure the scenes and the scans of two folders; nothing where there are none."""
    parts = [_measure_scenes(scenes, quick), _measure_clouds(clouds, quick)]
    return Outcome(
        [table for part in parts for table in part.tables],
        {key: value for part in parts for key, value in part.key_figures.items()},
    )


def _measure_scenes(folder: Path, quick: bool) -> Outcome:
    scenes = load_scenes(folder)[:: 13 if quick else 1]
    if not scenes:
        report_progress(f"real scenes left out: {folder} has no scene (.npz)")
        return Outcome()
    halves: dict[str, list[Findings]] = {"tuning": [], "held back": []}
    for k, scene in enumerate(scenes):
        report_progress(f"real scene {k + 1} of {len(scenes)}: {scene.name}")
        halves["tuning" if scene.tuning else "held back"].append(_perceive_scene(scene))
    both = [findings for half in halves.values() for findings in half]
    return Outcome([_scenes_table({"all": both, **halves})], {"real": _figures(both)})


def _perceive_scene(scene: RealScene) -> Findings:
    """Perceive one scene without a ball and with balls of each kind."""
    rng = np.random.default_rng([SEED, int.from_bytes(scene.name.encode(), "big")])
    session, findings = _Session(scene, rng), Findings()
    findings.is_plausible = session.model is not None and _is_plausible(session.model)
    false_tracks = set()
    for _ in range(EMPTY_FRAMES):
        result, _ = session.look()
        findings.empty.add([(s.center, s.radius) for s in detected_spheres(result)], [])
        false_tracks |= {item.object.id for item in tracked_spheres(result)}
    findings.false_tracks = len(false_tracks)
    for kind in KINDS:
        for balls, noise in _placements(scene, kind, rng):
            _add_frame(*session.look(balls, noise), findings.balls[kind], findings.nees)
    findings.seconds += session.run.seconds
    ball = place_ball(scene, FREE_GAP, rng)
    if ball is not None:
        session = _Session(scene, rng, [ball])
        for _ in range(STANDING_FRAMES):
            _add_frame(*session.look([ball]), findings.balls[STANDING], findings.nees)
        findings.seconds += session.run.seconds
    return findings


def _placements(
    scene: RealScene, kind: str, rng: np.random.Generator
) -> list[tuple[Sequence[PlacedBall], DepthNoise]]:
    """Balls and faults of the camera by frame, faults at edges at every second placement."""
    frames: list[tuple[Sequence[PlacedBall], DepthNoise]] = []
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


class _Session:
    """Perception of one scene, whose environment it models at once, maybe with balls in it."""

    def __init__(
        self, scene: RealScene, rng: np.random.Generator, balls: Sequence[PlacedBall] = ()
    ) -> None:
        self.run = PerceptionRun()
        self._time = 0.0
        self._cameras = {
            noise: SceneCamera(scene, noise, rng) for noise in (NO_EDGE_FAULTS, EDGE_FAULTS)
        }
        for _ in range(self.run.settings.environment_frames):
            self.model = self.look(balls)[0].model

    def look(
        self, balls: Sequence[PlacedBall] = (), noise: DepthNoise = NO_EDGE_FAULTS
    ) -> tuple[FrameResult, list[TrueBall]]:
        """Perceive the next frame; return the result and the true balls."""
        points, truth = self._cameras[noise].read(balls)
        self._time += FRAME_TIME
        return self.run.process(points, self._time), truth


def _add_frame(
    result: FrameResult, truth: list[TrueBall], score: Score, nees: dict[str, list[float]]
) -> None:
    """Score one frame with balls."""
    balls, spheres, model = detected_balls(result), detected_spheres(result), result.model
    for k, n in score.add(balls, truth):
        assert model is not None  # there is a ball
        error = balls[k][0] - truth[n].position
        covariance = model.rotation.T @ spheres[k].covariance[:3, :3] @ model.rotation
        for band, (nearest, farthest) in BANDS.items():
            if nearest <= truth[n].distance < farthest:
                nees[band].append(float(error @ np.linalg.solve(covariance, error)) / 3.0)


def _is_plausible(model: EnvironmentModel) -> bool:
    """Whether the support faces up in the image of a camera that is held about upright."""
    x, y, z = model.detected[0].normal
    roll = np.degrees(np.arctan2(abs(x), -y))
    pitch = np.degrees(np.arctan2(abs(z), np.hypot(x, y)))
    return bool(roll <= MOST_ROLL and pitch <= STEEPEST)


def _figures(scenes: Sequence[Findings]) -> dict[str, Any]:
    """Return the key figures of some scenes, null where nothing was measured."""
    nees = {band: [value for scene in scenes for value in scene.nees[band]] for band in BANDS}
    return {
        "false_followed_per_scene": _mean([scene.false_tracks for scene in scenes]),
        "false_per_1000_frames": _false_per_1000([scene.empty for scene in scenes]),
        "recall_free": _recall(scenes, "free", "thrown", STANDING),
        "recall_close": _recall(scenes, "close"),
        "recall_touching": _recall(scenes, "touching"),
        "support_plausible": _mean([scene.is_plausible for scene in scenes]),
        "nees": {band: _mean(values) for band, values in nees.items()},
    }


def _recall(scenes: Sequence[Findings], *kinds: str) -> float | None:
    """Part of the balls of some kinds that was found."""
    scores = [scene.balls[kind] for scene in scenes for kind in kinds]
    visible = sum(score.visible for score in scores)
    return _rounded(sum(score.found for score in scores) / visible) if visible else None


def _false_per_1000(scores: Sequence[Score]) -> float | None:
    frames = max(sum(score.frames for score in scores), 1)
    return _rounded(1000.0 * sum(score.false for score in scores) / frames)


def _mean(values: Sequence[float]) -> float | None:
    return _rounded(float(np.mean(values))) if values else None


def _rounded(value: float) -> float:
    return float(f"{value:.4g}")


def _scenes_table(named: dict[str, list[Findings]]) -> Table:
    """Return the figures of all scenes, of those to tune on and of those held back."""
    rows: list[list[Cell]] = []
    for name, scenes in named.items():
        if not scenes:
            continue
        figures = _figures(scenes)
        nees = figures.pop("nees")
        with_balls = [scene.balls[kind] for scene in scenes for kind in (*KINDS, STANDING)]
        seconds = [value for scene in scenes for value in scene.seconds]
        rows.append(
            [
                name,
                len(scenes),
                *figures.values(),
                *nees.values(),
                *(_recall(scenes, kind) for kind in ("thrown", STANDING)),
                _false_per_1000(with_balls),
                _rounded(1e3 * float(np.median(seconds))),
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


def _measure_clouds(folder: Path, quick: bool) -> Outcome:
    """Measure the LiDAR scans of a folder, each of which shows one ball."""
    paths = sorted(folder.glob("lidar_ball_*.npz"))[:: 3 if quick else 1]
    if not paths:
        report_progress(f"LiDAR scans left out: {folder} has no lidar_ball_*.npz")
        return Outcome()
    rows: list[list[Cell]] = []
    hits = false = 0
    for path in paths:
        report_progress(f"LiDAR scan {path.stem}")
        with np.load(path) as data:
            points = np.asarray(data["xyz"], dtype=np.float64)
        environment, spheres = perceive_cloud(
            points, PerceptionSettings(), np.random.default_rng(0)
        )
        balls = [sphere for sphere in spheres if _is_ball_of_scan(sphere)]
        others = len(spheres) - bool(balls)
        hits += bool(balls)
        false += others
        radius = f"{balls[0].radius:.3f}" if balls else "none"
        rows.append([path.stem, radius, others, len(environment.planes)])
    table = Table(
        title="LiDAR scans with one ball",
        columns=[Column("scan"), Column("radius found", "m"), Column("false"), Column("planes")],
        rows=rows,
    )
    return Outcome([table], {"lidar_found": f"{hits} of {len(paths)}", "lidar_false": false})


def _is_ball_of_scan(sphere: DetectedSphere) -> bool:
    """Whether a sphere has the size of the scans' ball and enough readings."""
    least, most = BALL_RADII_IN_SCANS
    return least <= sphere.radius <= most and sphere.points >= FEWEST_ON_BALL
