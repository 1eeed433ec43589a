"""What was measured of the predictor, as tables and as the line that machines read."""

from __future__ import annotations

import json
from dataclasses import dataclass

from benchmarks.prediction_node import HOLDS, MOST_PUBLISHED, Run
from benchmarks.prediction_peers import PeerTime
from benchmarks.prediction_truth import Truth
from benchmarks.report import NOTHING, table
from benchmarks.steady_loop import RATE, WORK, Lateness

MOST_LATENCY = 10.0
"""ms from the tick to the received message, of 99 % of the messages."""

LEAST_SAMPLES = {"1_sphere": 500}
"""Samples that have to hold 100 Hz, by scene."""

MOST_GROWTH = 5.0
"""MB over a run: what allocators move about, not what grows with each prediction."""

COVERAGE = (0.85, 0.95)
"""Of 90 % regions."""


@dataclass(frozen=True)
class Results:
    """What was measured, by scene.

    Parameters
    ----------
    runs : of the node with 20 samples
    most_samples : largest number that holds 100 Hz, all of them published up to MOST_PUBLISHED
    loops : of constant work on both cores, with nothing beside it
    peers : times of a prediction by ODE and PyBullet, the paper's way, and by ours
    truth : coverage and scores of what is predicted
    """

    runs: dict[str, Run]
    most_samples: dict[str, int]
    loops: list[Lateness]
    peers: dict[str, list[PeerTime]]
    truth: Truth


def report_text(results: Results, seconds: float) -> str:
    """Describe everything."""
    return (
        "\n\n".join(
            [
                "# Prediction benchmark",
                _runs_text(results.runs),
                _most_text(results),
                _loops_text(results.loops),
                _peers_text(results),
                _truth_text(results),
                f"Measured in {seconds:.0f} s.",
            ]
        )
        + "\n"
    )


def complaints(results: Results) -> list[str]:
    """Return the bars that were missed."""
    found = []
    for scene, run in results.runs.items():
        if run.rate < HOLDS:
            found.append(f"{scene} at {run.rate:.1f} Hz; expected at least {HOLDS:g}")
        if run.latency_p99 >= MOST_LATENCY:
            found.append(f"{scene} 99 % in {run.latency_p99:.1f} ms; expected {MOST_LATENCY:g}")
        if run.growth > MOST_GROWTH:
            found.append(f"{scene} grew by {run.growth:.1f} MB; expected at most {MOST_GROWTH:g}")
    for scene, least in LEAST_SAMPLES.items():
        if results.most_samples[scene] < least:
            found.append(f"{scene} holds {results.most_samples[scene]} samples; expected {least}")
    for horizon, share in results.truth.coverage_90.items():
        if not COVERAGE[0] <= share <= COVERAGE[1]:
            found.append(f"90 % regions hold {100 * share:.0f} % after {horizon} s")
    if not results.truth.score_ratio < 1.0:
        found.append(f"energy score is {results.truth.score_ratio:.2f} of the best baseline's")
    return found


def json_line(results: Results) -> str:
    """Return the one line that machines read."""
    runs = results.runs
    return json.dumps(
        {
            "rate_hz": {scene: round(run.rate, 2) for scene, run in runs.items()},
            "latency_ms_p99": {scene: round(run.latency_p99, 2) for scene, run in runs.items()},
            "max_samples_at_100hz": results.most_samples,
            "coverage_90": {h: round(c, 3) for h, c in results.truth.coverage_90.items()},
            "energy_score_vs_best_baseline": round(results.truth.score_ratio, 3),
        }
    )


def _runs_text(runs: dict[str, Run]) -> str:
    rows = [
        [
            scene,
            f"{run.seconds:.0f}",
            f"{run.rate:.1f}",
            f"{100 * run.lost:.2f}",
            f"{run.latency_median:.2f}",
            f"{run.latency_p99:.2f}",
            f"{100 * run.cpu:.0f}",
            f"{run.memory:.0f}",
            f"{run.growth:+.1f}",
            f"{run.message_size:.2f}",
        ]
        for scene, run in runs.items()
    ]
    header = [
        "scene",
        "for s",
        "Hz",
        "lost on the way, %",
        "tick → received, median ms",
        "99 %",
        "CPU, % of a core",
        "memory, MB",
        "its growth",
        "message, MB",
    ]
    return "## The node at 100 Hz, 20 samples, 5 s ahead\n\n" + table(header, rows)


def _most_text(results: Results) -> str:
    rows = [[scene, str(count)] for scene, count in results.most_samples.items()]
    return (
        f"## The most samples at {RATE:g} Hz\n\n"
        f"All of them published, up to {MOST_PUBLISHED}.\n\n" + table(["scene", "samples"], rows)
    )


def _loops_text(loops: list[Lateness]) -> str:
    rows = [[loop.beside, f"{loop.median:.2f}", f"{loop.most:.2f}"] for loop in loops]
    return (
        f"## The machine by itself\n\nA loop on each core at {RATE:g} Hz, {1e3 * WORK:g} ms of the "
        "same work each time: ms until it is done. What its 99 % is above its median, the machine "
        "adds.\n\n" + table(["beside", "median", "99 %"], rows)
    )


def _peers_text(results: Results) -> str:
    engines = list(dict.fromkeys(t.engine for times in results.peers.values() for t in times))
    rows = []
    for engine in engines:
        own = [
            next((t.seconds for t in times if t.engine == engine), None)
            for times in results.peers.values()
        ]
        cells = [NOTHING if s is None else f"{1e3 * s:.3g} ({1 / s:.0f} Hz)" for s in own]
        rows.append([engine, *cells])
    return (
        "## The paper's way: engines alone\n\n"
        "Median wall milliseconds of one prediction, 20 simulations of 5 s, on one thread, and how "
        "often a second that could be.\n\n" + table(["engine", *results.peers], rows)
    )


def _truth_text(results: Results) -> str:
    truth = results.truth
    rows = [[horizon, f"{100 * share:.1f}"] for horizon, share in truth.coverage_90.items()]
    return (
        f"## True of the paper's synthetic set, {truth.samples} samples an object\n\n"
        + table(["s ahead", "% in the 90 % region"], rows)
        + "\n\nEnergy score over that of the best baseline, at the horizon where it is worst: "
        f"{truth.score_ratio:.3f}"
    )
