"""Real scenes that come into view: by a pan, and as furniture that is carried in."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path
from time import monotonic, sleep
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.command import Outcome, report_progress
from benchmarks.perception.drive import measure_drive
from benchmarks.perception.perceive import (
    PerceptionRun,
    detected_balls,
    detected_spheres,
    tracked_spheres,
)
from benchmarks.perception.real_scenes import (
    FRAME_TIME,
    NO_EDGE_FAULTS,
    PlacedBall,
    RealScene,
    SceneCamera,
    load_scenes,
    throw_ball,
)
from benchmarks.perception.score import Score
from benchmarks.perception.truth import TrueBall
from benchmarks.results.result import Column, Table
from intuitive_physics.frames.change_of_frame import RigidTransform
from intuitive_physics_perception.detection.foreground import ForegroundFinder
from intuitive_physics_perception.environment.environment_model import EnvironmentModel
from intuitive_physics_perception.settings import PerceptionSettings

SEED = 38  # of the noise and the throws; each scene has a generator of its own
COLUMNS = 440  # of an image that pans within the 640 of a frame
PAN_STEP = 0.6  # degrees a frame
PAN_FRAMES, STANDING_FRAMES, SHOWN_FRAMES = 30, 20, 60
THROWS, FLIGHT_FRAMES = 2, 12  # of balls through each scene, and frames of each at most
FARTHEST_BACKGROUND = 8.0  # m, what is taken away in a scene shows at most this behind it


@dataclass
class Findings:
    """What perception found in scenes of one kind."""

    scenes: int = 0
    frames: int = 0
    false: int = 0  # detections of spheres in frames without a ball
    false_tracks: int = 0
    seconds: list[float] = field(default_factory=list)  # of the thread, of each frame
    thrown: Score = field(default_factory=Score)


Frame = tuple[NDArray[np.float32], RigidTransform | None, list[TrueBall] | None]
"""Points (height, width, 3) m, the sensor's pose, and the true balls; None where the frame does
not count."""


def measure_clutter(folder: Path, quick: bool) -> Outcome:
    """Measure the real scenes of a folder; nothing where there are none."""
    scenes = load_scenes(folder)[:: 13 if quick else 1]
    if not scenes:
        report_progress(f"clutter left out: {folder} has no scene (.npz)")
        return Outcome()
    kinds = {"rest": _rest, "pan": _pan, "carried_in": _carried_in, "unorganised": _unorganised}
    halves = {name: {"tuning": Findings(), "held back": Findings()} for name in kinds}
    with ThreadPoolExecutor(1) as background:
        for k, scene in enumerate(scenes):
            report_progress(f"clutter, scene {k + 1} of {len(scenes)}: {scene.name}")
            for name, frames in kinds.items():
                half = "tuning" if scene.tuning else "held back"
                rng = np.random.default_rng([SEED, int.from_bytes(scene.name.encode(), "big")])
                _perceive(frames(scene, rng), halves[name][half], background)
    return Outcome([_table(halves)], _figures(halves))


def measure_moving(folder: Path, quick: bool) -> Outcome:
    """Measure a slow drive, and scenes that come into view."""
    drive, clutter = measure_drive(quick), measure_clutter(folder, quick)
    figures = {**clutter.key_figures}
    figures["moving"] = {**drive.key_figures, **figures.get("moving", {})}
    return Outcome([*drive.tables, *clutter.tables], figures)


def _perceive(frames: Iterator[Frame], findings: Findings, background: Executor) -> None:
    """Perceive one scene as a live camera does: with a budget of time and a background thread.

    Frames do not come before their time: what stands about is modelled beside them, by the clock.
    """
    run = PerceptionRun(background=background)
    tracks: set[str] = set()
    began = monotonic()
    for k, (points, pose, balls) in enumerate(frames):
        stamp = (k + 1) * FRAME_TIME
        sleep(max(0.0, began + stamp - monotonic()))
        result = run.process(points, stamp, pose=pose)
        if balls is None:
            continue
        findings.seconds += run.seconds[-1:]
        if balls:
            findings.thrown.add(detected_balls(result), balls)
        else:
            findings.frames += 1
            findings.false += len(detected_spheres(result))
            tracks |= {item.object.id for item in tracked_spheres(result)}
    findings.scenes += 1
    findings.false_tracks += len(tracks)


def _rest(scene: RealScene, rng: np.random.Generator) -> Iterator[Frame]:
    """A camera that stands."""
    camera = SceneCamera(scene, NO_EDGE_FAULTS, rng)
    for k in range(PerceptionSettings().environment_frames + SHOWN_FRAMES):
        points, _ = camera.read()
        yield points, None, None if k < PerceptionSettings().environment_frames else []


def _unorganised(scene: RealScene, rng: np.random.Generator) -> Iterator[Frame]:
    """The same as clouds without pixels, of every third reading."""
    for points, pose, balls in _rest(scene, rng):
        readings = points[np.isfinite(points[:, :, 2])]
        yield np.ascontiguousarray(readings[::3])[None], pose, balls


def _pan(scene: RealScene, rng: np.random.Generator) -> Iterator[Frame]:
    """A camera that stands, turns by 18° and stands again; then balls are thrown."""
    camera = SceneCamera(scene, NO_EDGE_FAULTS, rng)
    angles = [0.0] * STANDING_FRAMES
    angles += [PAN_STEP * (k + 1) for k in range(PAN_FRAMES)] + [PAN_STEP * PAN_FRAMES] * 20
    for k, angle in enumerate(angles):
        points, pose, _ = _turned(camera, angle)
        yield points, pose, None if k < STANDING_FRAMES else []
    for _ in range(THROWS):
        for ball in throw_ball(scene, rng, FLIGHT_FRAMES):
            points, pose, balls = _turned(camera, PAN_STEP * PAN_FRAMES, [ball])
            yield points, pose, balls or None


def _turned(
    camera: SceneCamera, degrees: float, balls: Sequence[PlacedBall] = ()
) -> tuple[NDArray[np.float32], RigidTransform, list[TrueBall]]:
    """A part of a frame as a narrower camera reads it that has turned to the right."""
    points, truth = camera.read(balls)
    angle = np.radians(degrees)
    first = round(float(camera.scene.intrinsics[0, 0]) * np.tan(angle))
    first = min(max(first, 0), points.shape[1] - COLUMNS)
    pose = RigidTransform((0.0, 0.0, 0.0), (0.0, np.sin(0.5 * angle), 0.0, np.cos(0.5 * angle)))
    part = points[:, first : first + COLUMNS] @ pose.matrix.astype(np.float32)
    seen = []
    for ball in truth:
        u = camera.scene.intrinsics[0] @ ball.position / ball.position[2] - first
        reach = camera.scene.intrinsics[0, 0] * ball.radius / ball.position[2]
        if reach < u < COLUMNS - reach:
            seen.append(replace(ball, position=ball.position @ pose.matrix))
    return np.ascontiguousarray(part), pose, seen


def _carried_in(scene: RealScene, rng: np.random.Generator) -> Iterator[Frame]:
    """A room that is bare at first, and then has all that stands about in it."""
    full = SceneCamera(scene, NO_EDGE_FAULTS, rng)
    bare = _bare(scene, rng)
    if bare is None:
        return
    empty = SceneCamera(bare, NO_EDGE_FAULTS, rng)
    for _ in range(PerceptionSettings().environment_frames + 2):
        yield empty.read()[0], None, None
    for _ in range(SHOWN_FRAMES):
        yield full.read()[0], None, []
    for _ in range(THROWS):
        for ball in throw_ball(scene, rng, FLIGHT_FRAMES):
            points, balls = full.read([ball])
            yield points, None, balls


def _bare(scene: RealScene, rng: np.random.Generator) -> RealScene | None:
    """A scene without what stands before its planes: one sees these behind it, or nothing."""
    settings = replace(PerceptionSettings(), static_boxes=False)
    run = PerceptionRun(settings)
    camera = SceneCamera(scene, NO_EDGE_FAULTS, rng)
    for k in range(settings.environment_frames):
        run.process(camera.read()[0], k * FRAME_TIME)
    if run.pipeline.model is None:
        return None
    points = scene.rays * np.where(scene.depth > 0.0, scene.depth, np.nan)[..., None]
    before = ForegroundFinder(run.model, settings).before(points.reshape(-1, 3))
    stands = np.zeros(scene.depth.size, dtype=bool)
    stands[before] = True
    behind = _behind(scene, run.model)
    bare = np.where(stands.reshape(scene.depth.shape), behind, scene.depth)
    return replace(scene, depth=bare)


def _behind(scene: RealScene, model: EnvironmentModel) -> NDArray[np.float32]:
    """Depth (height, width) m of the nearest plane behind each reading, 0 where there is none."""
    behind = np.full(scene.depth.shape, np.inf, dtype=np.float32)
    for plane in model.detected:
        with np.errstate(divide="ignore"):
            depth = plane.offset / (scene.rays @ plane.normal.astype(np.float32))
        depth[(depth <= 0.98 * scene.depth) | (depth <= 0.0)] = np.inf
        behind = np.minimum(behind, depth)
    behind[behind > FARTHEST_BACKGROUND] = 0.0
    return behind


def _figures(halves: dict[str, dict[str, Findings]]) -> dict[str, Any]:
    both = {name: list(parts.values()) for name, parts in halves.items()}
    moving = {
        name: {
            "false_followed_per_scene": _per_scene(both[name]),
            "ms_p99": _milliseconds(both[name], 0.99),
        }
        for name in ("pan", "carried_in")
    }
    p99 = {name: _milliseconds(parts, 0.99) for name, parts in both.items()}
    return {"moving": moving, "clutter_ms_p99": p99}


def _per_scene(parts: Sequence[Findings]) -> float:
    scenes = sum(part.scenes for part in parts)
    return float(f"{sum(part.false_tracks for part in parts) / max(scenes, 1):.4g}")


def _milliseconds(parts: Sequence[Findings], quantile: float) -> float:
    seconds = [value for part in parts for value in part.seconds]
    return float(f"{1e3 * np.quantile(seconds, quantile):.4g}") if seconds else float("nan")


def _table(halves: dict[str, dict[str, Findings]]) -> Table:
    return Table(
        title="Clutter that comes into view",
        note="A live pipeline, 30 frames a second by the clock; time of its thread.",
        columns=[
            Column("kind"),
            Column("half"),
            Column("scenes"),
            Column("followed false balls a scene", "", ".2f"),
            Column("false in 1,000 frames", "", ".0f"),
            Column("recall thrown", "", ".3f"),
            Column("of"),
            Column("median", "ms", ".1f"),
            Column("99 %", "ms", ".1f"),
        ],
        rows=[
            [
                name,
                half,
                part.scenes,
                _per_scene([part]),
                1e3 * part.false / max(part.frames, 1),
                part.thrown.recall if part.thrown.visible else None,
                part.thrown.visible,
                _milliseconds([part], 0.5),
                _milliseconds([part], 0.99),
            ]
            for name, parts in halves.items()
            for half, part in parts.items()
            if part.scenes
        ],
    )
