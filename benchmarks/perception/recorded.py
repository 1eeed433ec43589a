"""A recording of a depth camera that moves by hand, with balls thrown into it: with the camera's
poses and without."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from time import monotonic, sleep

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from benchmarks.command import Outcome, report_progress
from benchmarks.perception.perceive import PerceptionRun, detected_balls, tracked_spheres
from benchmarks.perception.real_scenes import (
    FRAME_TIME,
    NO_EDGE_FAULTS,
    PlacedBall,
    RealScene,
    SceneCamera,
    rendered,
)
from benchmarks.perception.recorded_frames import Recording, Throws
from benchmarks.perception.score import Score, matched
from benchmarks.perception.truth import TrueBall
from benchmarks.results.result import Column, Table
from intuitive_physics_perception.frame_result import FrameResult

SEED = 40  # of the throws and the noise of the balls
QUICK_FRAMES = 90
FEWEST_FRAMES = 5  # of a ball in view, from which on it has to be followed


@dataclass
class Findings:
    """What perception made of a recording."""

    models: int = 0  # environments that were modelled
    unknown: int = 0  # frames without one
    score: Score = field(default_factory=Score)  # spheres of single frames
    names: set[str] = field(default_factory=set)  # of published spheres
    true_names: set[str] = field(default_factory=set)  # of those that were a ball
    thrown: dict[int, int] = field(default_factory=dict)  # frames in which each ball was seen
    followed: set[int] = field(default_factory=set)  # balls that were published
    seconds: list[float] = field(default_factory=list)  # of the thread, of each frame


def measure_recorded(folder: Path, quick: bool) -> Outcome:
    """Measure a recording; nothing where there is none."""
    recording = Recording(folder)
    if not recording.frames:
        report_progress(f"recording left out: {folder} has no frame-*.depth.png")
        return Outcome()
    count = min(len(recording.frames), QUICK_FRAMES if quick else len(recording.frames))
    found = {}
    for name in ("with_poses", "without_poses"):
        report_progress(f"recording {name.replace('_', ' ')}: {folder}")
        found[name] = _perceive(recording, count, posed=name == "with_poses")
    figures = {
        name: {
            "false_followed": len(f.names - f.true_names),
            "followed": f"{len(f.followed & _long(f))} of {len(_long(f))}",
        }
        for name, f in found.items()
    }
    return Outcome([_table(found)], {"recorded": figures})


def _perceive(recording: Recording, count: int, *, posed: bool) -> Findings:
    """Perceive a recording as a live camera does: with a budget of time and a background thread."""
    findings, throws = Findings(), None
    rng = np.random.default_rng(SEED)
    with ThreadPoolExecutor(1) as background:
        run, began = PerceptionRun(background=background), monotonic()
        for k in range(count):
            scene, pose = recording.scene(k), recording.pose(k)
            ball = throws.ball(k, scene, pose) if throws else None
            points, truth = _read(scene, ball, rng)
            sleep(max(0.0, began + k * FRAME_TIME - monotonic()))
            result = run.process(points, k * FRAME_TIME, pose=pose if posed else None)
            _add(result, truth, throws.number if throws else -1, findings)
            if throws is None and result.model is not None:
                throws = Throws(pose.directions(result.model.rotation[2]), rng)
        findings.seconds = run.seconds
    return findings


def _read(
    scene: RealScene, ball: PlacedBall | None, rng: np.random.Generator
) -> tuple[NDArray[np.float32], list[TrueBall]]:
    """Return points (height, width, 3) m of a frame, with the readings of a rendered camera about a
    ball, and the ball."""
    points = scene.points(np.rint(1000.0 * scene.depth).astype(np.uint16))
    if ball is None:
        return points, []
    seen, truth = SceneCamera(scene, NO_EDGE_FAULTS, rng).read([ball])
    about = binary_dilation(rendered(scene, [ball])[1] >= 0, np.ones((3, 3)))
    return np.where(about[..., None], seen, points), truth


def _add(result: FrameResult, truth: list[TrueBall], number: int, findings: Findings) -> None:
    """Count what one frame has shown of the ball of a number."""
    model = result.model
    findings.models += result.is_new_model
    findings.unknown += model is None
    findings.score.add(detected_balls(result), truth)
    if truth:
        findings.thrown[number] = findings.thrown.get(number, 0) + 1
    for item in tracked_spheres(result):
        assert model is not None  # objects are in its frame
        findings.names.add(item.object.id)
        place = model.to_sensor(item.state.position)
        if matched([(place, 0.0)], truth):
            findings.true_names.add(item.object.id)
            findings.followed.add(number)


def _long(findings: Findings) -> set[int]:
    """Numbers of the balls that were in view for long enough to be followed."""
    return {number for number, frames in findings.thrown.items() if frames >= FEWEST_FRAMES}


def _table(found: dict[str, Findings]) -> Table:
    return Table(
        title="Recording of a camera that moves",
        note="A live pipeline, 30 frames a second by the clock; time of its thread.",
        columns=[
            Column("kind"),
            Column("frames"),
            Column("models"),
            Column("frames without one"),
            Column("false followed"),
            Column("false in 1,000 frames", "", ".1f"),
            Column("recall thrown", "", ".3f"),
            Column("followed"),
            Column("balls"),
            Column("error", "mm", ".1f"),
            Column("median", "ms", ".1f"),
            Column("99 %", "ms", ".1f"),
        ],
        rows=[
            [
                name.replace("_", " "),
                f.score.frames,
                f.models,
                f.unknown,
                len(f.names - f.true_names),
                f.score.false_positives_per_1000,
                f.score.recall if f.score.visible else None,
                len(f.followed & _long(f)),
                len(_long(f)),
                1e3 * float(np.median([hit.position_error for hit in f.score.hits]))
                if f.score.hits
                else None,
                *(1e3 * float(np.quantile(f.seconds, q)) for q in (0.5, 0.99)),
            ]
            for name, f in found.items()
        ],
    )
