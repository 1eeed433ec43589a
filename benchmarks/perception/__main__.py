"""`make bench-perception`: our perception on rendered bags with ground truth, beside others.

README.md in the folder above says what is measured and how.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.command import Outcome, report_progress, run_benchmark
from benchmarks.perception.end_to_end import measure_end_to_end
from benchmarks.perception.looks import measure_looks
from benchmarks.perception.peers import FrameByFrame, Open3dAndPyransac, Peer
from benchmarks.perception.real import measure_clouds, measure_real_scenes
from benchmarks.perception.release import measure_release
from benchmarks.perception.report import (
    accuracy_table,
    key_figures,
    misses,
    peers_table,
    timing_table,
)
from benchmarks.perception.run import (
    Findings,
    Frame,
    PerceivedBag,
    perceive_bag,
    some_frames,
)
from benchmarks.perception.scenes import PAUSE, SceneKind, random_truth
from benchmarks.perception.score import Ball, Score
from benchmarks.perception.truth import TrueRecording
from benchmarks.perception.unorganised import measure_unorganised
from benchmarks.results.result import Table
from intuitive_physics_experiments.rendering.rendered_bag import RenderSettings, render_truth
from intuitive_physics_perception.compile import warm_up
from intuitive_physics_perception.settings import PerceptionSettings

SEED = 5  # of the scenes, each of which has a generator of its own
# Parts that `--only` may name
RENDERED, REAL, RELEASE, UNORGANISED, END_TO_END, LOOKS = PARTS = (
    "rendered",
    "real",
    "release",
    "unorganised",
    "end_to_end",
    "looks",
)

# Real depth frames and scans, beside the project
REAL_DATA = Path(__file__).resolve().parents[3] / "shared" / "data" / "real"
OURS = "ours"  # name of our perception beside the others


@dataclass(frozen=True)
class Effort:
    """How much is measured."""

    scenes: int  # rendered bags; their kinds take turns
    throws: int  # in each bag
    peer_frames: int  # of each bag that others look at, too


FULL = Effort(scenes=20, throws=10, peer_frames=3)  # of the results that are kept
QUICK = Effort(scenes=9, throws=3, peer_frames=1)  # of a first look


@dataclass(frozen=True)
class Comparison:
    """How each method did on the frames that all looked at, by its name."""

    scores: dict[str, Score] = field(default_factory=lambda: defaultdict(Score))
    milliseconds: dict[str, list[float]] = field(default_factory=lambda: defaultdict(list))
    how: dict[str, str] = field(default_factory=dict)

    def add(self, name: str, balls: Sequence[Ball], seconds: float, frame: Frame) -> None:
        """Take what a method found in a frame."""
        self.scores[name].add(balls, frame.balls)
        self.milliseconds[name].append(1e3 * seconds)


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the tables, and print the line of JSON last."""
    return run_benchmark("perception", __doc__, run, arguments, _add_options, parts=PARTS)


def _add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--scenes",
        type=Path,
        default=REAL_DATA / "scenes",
        metavar="FOLDER",
        help="depth frames without a ball (.npz: depth in mm, K); default %(default)s",
    )
    parser.add_argument(
        "--clouds",
        type=Path,
        default=REAL_DATA,
        metavar="FOLDER",
        help="LiDAR scans with one ball each (lidar_ball_*.npz: xyz in m); default %(default)s",
    )


def run(options: argparse.Namespace) -> Outcome:
    """Measure all parts, or those that were chosen."""
    wanted = options.only or PARTS
    warm_up()
    outcome = Outcome([], {})
    if RENDERED in wanted:
        outcome = measure_rendered(QUICK if options.quick else FULL)
    tables: list[Table] = list(outcome.tables)
    figures: dict[str, Any] = dict(outcome.key_figures)
    others: list[tuple[str, Callable[[], tuple[dict[str, Any], list[Table]]]]] = [
        (UNORGANISED, lambda: measure_unorganised(options.quick)),
        (END_TO_END, lambda: measure_end_to_end(options.quick)),
        (REAL, lambda: measure_real_scenes(options.scenes, options.quick)),
        (REAL, lambda: measure_clouds(options.clouds)),
        (RELEASE, lambda: measure_release(options.quick)),
        (LOOKS, lambda: measure_looks(options.quick)),
    ]
    for name, measure in others:
        if name in wanted:
            found, shown = measure()
            figures.update(found)
            tables += shown
    return replace(outcome, tables=tables, key_figures=figures)


def measure_rendered(effort: Effort) -> Outcome:
    """Measure every rendered scene."""
    findings, comparison = Findings(), Comparison()
    for k in range(effort.scenes):
        kind = SceneKind(
            planes=1 + k % 3, balls_at_once=1 + k // 3 % 3, throws=effort.throws, crates=k % 4
        )
        report_progress(f"scene {k + 1} of {effort.scenes}: {kind}")
        measure_scene(kind, np.random.default_rng([SEED, k]), effort, findings, comparison)
    figures = key_figures(findings, comparison.milliseconds[Open3dAndPyransac.name])
    return Outcome(
        tables=[
            accuracy_table(findings),
            timing_table(findings.timing),
            peers_table(
                comparison.scores,
                comparison.milliseconds,
                [f"{name}: {how}" for name, how in comparison.how.items()],
            ),
        ],
        key_figures={name: float(f"{value:.4g}") for name, value in figures.items()},
        note=f"{effort.scenes} rendered bags of {effort.throws} throws: balls of 3, 5 and 7 cm "
        "radius at 1 to 3 m, one to three at once; one to three planes, none to three crates; the "
        "camera tilted by 15 to 40° and a little rolled; all its faults on.",
        complaints=[f"bar not reached: {miss}" for miss in misses(figures)],
    )


def measure_scene(
    kind: SceneKind,
    rng: np.random.Generator,
    effort: Effort,
    findings: Findings,
    comparison: Comparison,
) -> None:
    """Render one bag and let ours and the others perceive it."""
    truth = random_truth(kind, rng)
    recording = TrueRecording(truth)
    with tempfile.TemporaryDirectory(prefix="bench-perception-") as folder:
        bag = Path(folder) / "bag"
        render_truth(bag, truth, RenderSettings(pause=PAUSE), rng)
        own = perceive_bag(bag, recording, PerceptionSettings(), findings)
        peers: list[Peer] = [Open3dAndPyransac(), FrameByFrame(own.model.detected, rng)]
        for frame in some_frames(bag, recording, _chosen(recording, own, effort.peer_frames, rng)):
            comparison.add(OURS, own.detections[frame.time], own.seconds[frame.time], frame)
            points = frame.points[np.isfinite(frame.points[:, :, 2])].astype(np.float64)
            for peer in peers:
                found, seconds = peer.timed(points, kind.planes, len(frame.balls))
                comparison.add(peer.name, found, seconds, frame)
                comparison.how[peer.name] = peer.how


def _chosen(
    recording: TrueRecording, own: PerceivedBag, count: int, rng: np.random.Generator
) -> list[float]:
    """Stamps of random frames that show a ball."""
    start = 1e-9 * recording.truth.start_time
    throws = recording.truth.throws
    shown = [
        stamp
        for stamp in own.detections
        if any(throw.start_time <= stamp - start <= throw.end_time for throw in throws)
    ]
    return sorted(rng.choice(shown, size=min(count, len(shown)), replace=False).tolist())


if __name__ == "__main__":
    sys.exit(main())
