"""Rendered frames as clouds without pixels: what is missing left out, the rest in random order."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.command import report_progress
from benchmarks.perception.run import some_frames
from benchmarks.perception.scenes import PAUSE, SceneKind, random_truth
from benchmarks.perception.score import Score
from benchmarks.perception.truth import TrueRecording
from benchmarks.results.result import Column, Table
from intuitive_physics_experiments.rendering.rendered_bag import RenderSettings, render_truth
from intuitive_physics_perception.detection.detections import DetectedSphere
from intuitive_physics_perception.pipeline import PerceptionPipeline
from intuitive_physics_perception.settings import PerceptionSettings

SEED = 43  # of the scenes, each of which has a generator of its own
# Scenes of a full measurement and of a first look, of one to three planes
SCENES, QUICK_SCENES = 3, 1
THROWS = 3  # in each scene, one ball at a time


def measure_unorganised(quick: bool) -> tuple[dict[str, Any], list[Table]]:
    """Return key figure and table of clouds of about 300,000 readings."""
    milliseconds: list[float] = []
    score = Score()
    for k in range(QUICK_SCENES if quick else SCENES):
        kind = SceneKind(planes=1 + k % 3, balls_at_once=1, throws=THROWS, crates=k)
        report_progress(f"unorganised scene {k + 1}: {kind}")
        _measure_scene(kind, np.random.default_rng([SEED, k]), milliseconds, score)
    p50, p99 = np.quantile(milliseconds, [0.5, 0.99])
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
        rows=[
            [
                len(milliseconds),
                float(p50),
                float(p99),
                score.recall,
                score.false_positives_per_1000,
            ]
        ],
    )
    return {"unorganised_ms_p50": float(f"{p50:.4g}")}, [table]


def _measure_scene(
    kind: SceneKind, rng: np.random.Generator, milliseconds: list[float], score: Score
) -> None:
    truth = random_truth(kind, rng)
    recording = TrueRecording(truth)
    pipeline = PerceptionPipeline(PerceptionSettings(), np.random.default_rng(0))
    with tempfile.TemporaryDirectory(prefix="bench-perception-") as folder:
        bag = Path(folder) / "bag"
        render_truth(bag, truth, RenderSettings(pause=PAUSE), rng)
        for frame in some_frames(bag, recording):
            cloud = frame.points[np.isfinite(frame.points[:, :, 2])]
            cloud = rng.permutation(cloud)[None]
            start = time.thread_time()
            result = pipeline.process(cloud, frame.time)
            if result.model is None or result.is_new_model:
                continue
            milliseconds.append(1e3 * (time.thread_time() - start))
            found = [
                (result.model.to_sensor(one.center), one.radius)
                for one in result.detections
                if isinstance(one, DetectedSphere)
            ]
            score.add(found, frame.balls)
