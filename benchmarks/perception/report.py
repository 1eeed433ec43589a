"""Turns what perception found into tables, and into the key figures that machines read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from benchmarks.perception.run import Findings, Timing
from benchmarks.perception.score import ENOUGH_PIXELS, NEAR, Hit, Score, rms
from benchmarks.results.result import Cell, Column, Table
from intuitive_physics_experiments.rendering.corner_room import BALL_RADII

# What the perception issue asks for, by the key of the last line
BARS = {
    "frame_ms_p50": (10.0, "below"),
    "frame_ms_p99": (20.0, "below"),
    "position_rmse_mm": (5.0, "below"),
    "radius_rmse_mm": (2.0, "below"),
    "gravity_error_deg": (0.3, "below"),
    "recall": (0.98, "above"),
    "false_positives_per_1000": (1.0, "below"),
}


def key_figures(findings: Findings, peer_ms: Sequence[float]) -> dict[str, float]:
    """Return what the last line says."""
    hits = findings.states.near_hits()
    p50 = 1e3 * float(np.median(findings.timing.total))
    return {
        "frame_ms_p50": p50,
        "frame_ms_p99": 1e3 * float(np.quantile(findings.timing.total, 0.99)),
        "position_rmse_mm": 1e3 * rms(hit.position_error for hit in hits),
        "radius_rmse_mm": 1e3 * rms(hit.radius_error for hit in hits),
        "gravity_error_deg": max(findings.gravity),
        "recall": findings.detections.recall,
        "false_positives_per_1000": findings.detections.false_positives_per_1000,
        "speedup_over_open3d_pyransac": float(np.median(peer_ms)) / p50,
    }


def misses(found: Mapping[str, float]) -> list[str]:
    """Return a sentence for each bar that was not reached."""
    return [
        f"{name} is {found[name]:.4g}; expected {side} {bar:g}"
        for name, (bar, side) in BARS.items()
        if not (found[name] < bar if side == "below" else found[name] > bar)
    ]


def accuracy_table(findings: Findings) -> Table:
    """Return errors of places and radii; velocities, recall and false positives as remarks."""
    rows: list[list[Cell]] = []
    for name, score in (("one frame", findings.detections), ("filtered", findings.states)):
        for size in (None, *sorted(BALL_RADII.values())):
            near = score.near_hits(size)
            far = [h for h in score.hits if h.distance > NEAR and size in (None, h.size)]
            ball = "all" if size is None else f"{1e2 * size:g} cm"
            rows.append([name, ball, *_errors(near), *_errors(far)])
    detections = findings.detections
    return Table(
        title="Accuracy",
        note="Root mean square errors in mm.",
        columns=[
            Column(""),
            Column("radius"),
            Column(f"position up to {NEAR:g} m", "mm", ".2f"),
            Column("radius", "mm", ".2f"),
            Column("position beyond", "mm", ".2f"),
            Column("radius", "mm", ".2f"),
        ],
        rows=rows,
        remarks=[
            f"Trajectories of observations, smoothed, up to {NEAR:g} m: "
            f"{1e3 * rms(findings.smoothed):.2f} mm over {len(findings.smoothed)} points.",
            f"Velocity of the last state before the first bounce: "
            f"{rms(findings.first_velocities):.3f} m/s over {len(findings.first_velocities)} "
            "balls.",
            f"Found in one frame: {detections.found} of {detections.visible} balls with at least "
            f"{ENOUGH_PIXELS} visible pixels, {detections.recall:.2%}; {detections.false} false "
            f"in {detections.frames} frames. Followed as an object: "
            f"{findings.states.recall:.2%} (the first frames of a throw only suggest one).",
            f"Gravity: largest error {max(findings.gravity):.3f}°, root mean square "
            f"{rms(findings.gravity):.3f}°, {len(findings.gravity)} scenes.",
            f"Planes: {len(findings.plane_angles)} found, {findings.planes_missing} missing, "
            f"{findings.planes_false} false; {rms(findings.plane_angles):.3f}° and "
            f"{1e3 * rms(findings.plane_offsets):.2f} mm.",
        ],
    )


def timing_table(timing: Timing) -> Table:
    """Return the time of frames by stage."""
    rows = [_timing_row(stage, seconds) for stage, seconds in timing.stages.items()]
    rows.append(_timing_row("message to states", timing.total))
    rows.append(_timing_row("… by the clock on the wall", timing.wall))
    if timing.closing:
        rows.append(_timing_row("after an episode: its observations", timing.closing))
    return Table(
        title="Time of a 640 × 480 frame",
        note="Milliseconds of the one thread that does the work.",
        columns=[
            Column("stage"),
            Column("median", "ms", ".2f"),
            Column("99 %", "ms", ".2f"),
            Column("most", "ms", ".2f"),
        ],
        rows=rows,
    )


def peers_table(
    scores: Mapping[str, Score], milliseconds: Mapping[str, Sequence[float]], how: Sequence[str]
) -> Table:
    """Return how ours and others did on the same frames."""
    return Table(
        title="Others on the same frames",
        note="Root mean square errors in mm, balls found within their radius of the truth.",
        columns=[
            Column(""),
            Column("ms a frame", "ms", ".1f"),
            Column(f"position up to {NEAR:g} m", "mm", ".2f"),
            Column("radius", "mm", ".2f"),
            Column("recall", "", ".1%"),
            Column("false"),
        ],
        rows=[
            [
                name,
                float(np.median(milliseconds[name])),
                *_errors(score.near_hits()),
                score.recall,
                f"{score.false} in {score.frames} frames",
            ]
            for name, score in scores.items()
        ],
        remarks=how,
    )


def _errors(hits: Sequence[Hit]) -> list[float]:
    return [
        1e3 * rms(hit.position_error for hit in hits),
        1e3 * rms(hit.radius_error for hit in hits),
    ]


def _timing_row(stage: str, seconds: Sequence[float]) -> list[Cell]:
    values = 1e3 * np.array(seconds)
    quantiles = np.median(values), np.quantile(values, 0.99), values.max()
    return [stage, *(float(value) for value in quantiles)]
