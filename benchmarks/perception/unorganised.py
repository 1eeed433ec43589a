"""Rendered frames as clouds without pixels: readings in random order, without the missing ones."""

from __future__ import annotations

import numpy as np

from benchmarks.command import Outcome, report_progress
from benchmarks.perception.perceive import (
    PerceptionRun,
    bag_frames,
    detected_balls,
    is_of_known_environment,
    rendered_bag,
)
from benchmarks.perception.scenes import SceneKind, random_truth
from benchmarks.perception.score import Score
from benchmarks.perception.truth import TrueRecording
from benchmarks.results.result import Column, Table

SEED = 43  # of the scenes, each of which has a generator of its own
SCENES, QUICK_SCENES = 3, 1  # of one to three planes
THROWS = 3  # in each scene, one ball at a time


def measure_unorganised(quick: bool) -> Outcome:
    """Measure clouds of about 300,000 readings."""
    seconds: list[float] = []
    score = Score()
    for k in range(QUICK_SCENES if quick else SCENES):
        kind = SceneKind(planes=1 + k % 3, balls_at_once=1, throws=THROWS, crates=k)
        report_progress(f"unorganised scene {k + 1}: {kind}")
        rng = np.random.default_rng([SEED, k])
        recording, run = TrueRecording(random_truth(kind, rng)), PerceptionRun()
        with rendered_bag(recording.truth, rng) as path:
            for frame in bag_frames(path, recording):
                cloud = frame.points[np.isfinite(frame.points[:, :, 2])]
                result = run.process(rng.permutation(cloud)[None], frame.time)
                if is_of_known_environment(result):
                    score.add(detected_balls(result), frame.balls)
        seconds += run.seconds
    p50, p99 = 1e3 * np.quantile(seconds, [0.5, 0.99])
    table = Table(
        title="Clouds without pixels",
        note="640 × 480 depth images as unorganised clouds, in random order; time of the thread.",
        columns=[
            Column("frames"),
            Column("median", "ms", ".1f"),
            Column("99 %", "ms", ".1f"),
            Column("recall", "", ".1%"),
            Column("false in 1,000 frames", "", ".1f"),
        ],
        rows=[[len(seconds), float(p50), float(p99), score.recall, score.false_positives_per_1000]],
    )
    return Outcome([table], {"unorganised_ms_p50": float(f"{p50:.4g}")})
