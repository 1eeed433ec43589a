"""`make bench-prediction`: the predictor node as a process, fed over DDS, on two cores.

README.md in the folder above says what is measured and how.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import repeat
from multiprocessing import get_context
from typing import Any

from benchmarks.command import Outcome, report_progress, run_benchmark
from benchmarks.prediction.camera import JudgedWorld, judge_world
from benchmarks.prediction.camera_report import (
    WORLDS,
    camera_complaints,
    camera_figures,
    camera_table,
    coverage_table,
)
from benchmarks.prediction.feed import SCENES, SEEN, Feed
from benchmarks.prediction.node import (
    MOST_PUBLISHED,
    SETTLING,
    TRIES,
    NodeUnderTest,
    largest_sample_count,
)
from benchmarks.prediction.peers import peer_times
from benchmarks.prediction.report import Results, complaints, key_figures, tables
from benchmarks.prediction.surfaces import samples_below_a_surface
from benchmarks.results.result import Table
from benchmarks.steady_loop import watch_loops
from intuitive_physics_experiments.calibration.options import CalibrationOptions
from intuitive_physics_experiments.calibration.paper_calibration import calibrate_on_paper_set

CORES = 2  # that node, learner and benchmark share


@dataclass(frozen=True)
class Effort:
    """What is measured, how long, in s, and how many throws."""

    scenes: tuple[str, ...]  # of which a node gets the true states
    estimated: tuple[str, ...]  # of which it estimates them

    steady: float  # each scene with 20 samples; memory has to be flat meanwhile
    trial: float  # each number of samples
    settling: float  # after each change of that number
    tries: int  # of each number that does not hold
    loop: float  # constant work, before and after the node
    synthetic_set: CalibrationOptions  # for coverage and scores
    resting: int  # predictions of balls that rest
    worlds: tuple[float, ...]  # that a camera sees, by their spin in rad/s
    throws: int  # in each of them
    learning: float  # s, at most, in each of them


# For the results that are kept
FULL = Effort(
    scenes=tuple(SCENES),
    estimated=tuple(SEEN),
    steady=60.0,
    trial=10.0,
    settling=SETTLING,
    tries=TRIES,
    loop=10.0,
    synthetic_set=CalibrationOptions(point_counts=()),
    resting=500,
    worlds=WORLDS,
    throws=120,
    learning=20.0,
)
# For a first look; its set is too small to hold the bars for sure. Half of the throws are learned
# from, so that each of the three materials is among them
SMALL_SET = CalibrationOptions(throws=6, held_out=6, point_counts=(), samples=20, iterations=100)
QUICK = Effort(
    scenes=("1_sphere",),
    estimated=("1_sphere_seen",),
    steady=4.0,
    trial=0.6,
    settling=0.5,
    tries=1,
    loop=1.0,
    synthetic_set=SMALL_SET,
    resting=50,
    worlds=WORLDS[:1],
    throws=8,
    learning=4.0,
)

PARTS = ("node", "camera")  # can be measured alone
FIRST_SEED = 500  # of the camera's worlds; nobody tuned on them. Those from 50 on were tuned on


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the tables, and print the line of JSON last."""
    return run_benchmark(
        "prediction",
        __doc__,
        run,
        arguments,
        parts=PARTS,
        first_seed=FIRST_SEED,
    )


def run(options: argparse.Namespace) -> Outcome:
    """Measure the chosen parts on the first cores of the machine."""
    wanted = options.only or PARTS
    effort = QUICK if options.quick else FULL
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:CORES])
    shown: list[Table] = []
    figures: dict[str, Any] = {}
    missed: list[str] = []
    if "node" in wanted:
        results = measure(effort)
        shown += tables(results)
        figures |= key_figures(results)
        missed += complaints(results)
    if "camera" in wanted:
        worlds = see_worlds(effort, options.first_seed)
        shown += [camera_table(worlds), coverage_table(worlds)]
        figures["camera"] = camera_figures(worlds)
        missed += camera_complaints(worlds)
    return Outcome(
        tables=shown,
        key_figures=figures,
        complaints=[f"bar missed: {complaint}" for complaint in missed],
        part="_".join(options.only or ()),
    )


def see_worlds(effort: Effort, first_seed: int) -> dict[float, JudgedWorld]:
    """Judge predictions in worlds that a camera sees, side by side, by their spin in rad/s."""
    report_progress(f"the camera's worlds, {effort.throws} throws each")
    spins = effort.worlds
    seeds = range(first_seed, first_seed + len(spins))
    with ProcessPoolExecutor(CORES, mp_context=get_context("spawn")) as pool:
        judged = pool.map(judge_world, spins, repeat(effort.throws), repeat(effort.learning), seeds)
        return dict(zip(spins, judged, strict=True))


def measure(effort: Effort) -> Results:
    """Measure all, one after the other."""
    runs, most = {}, {}
    cores = sorted(os.sched_getaffinity(0))
    report_progress("constant work")
    loops = [watch_loops("nothing, before", effort.loop, cores)]
    for name in (*effort.scenes, *effort.estimated):
        report_progress(f"{name}: 20 samples")
        with NodeUnderTest(Feed(name)) as node:
            runs[name] = run = node.run(effort.steady, effort.settling)
        report_progress(f"{name}: {run.rate:.1f} Hz, 99 % within {run.latency_p99:.1f} ms")
    for name in effort.scenes:
        report_progress(f"{name}: how many samples hold 100 Hz")
        with NodeUnderTest(Feed(name), published_samples=MOST_PUBLISHED) as node:
            most[name] = largest_sample_count(node, effort.trial, effort.settling, effort.tries)
        report_progress(f"{name}: {most[name]} samples")
    loops.append(watch_loops("nothing, after", effort.loop, cores))
    report_progress("other engines alone")
    peers = peer_times({name: SCENES[name] for name in effort.scenes})
    report_progress("samples below a surface")
    below = samples_below_a_surface(effort.resting)
    report_progress("coverage and scores")
    calibrated = calibrate_on_paper_set(effort.synthetic_set).summary()
    return Results(
        runs=runs,
        most_samples=most,
        loops=loops,
        peers=peers,
        throws=effort.synthetic_set.throws,
        coverage_90=calibrated["coverage_90"],
        score_ratio=calibrated["energy_score_vs_best_baseline"],
        resting=effort.resting,
        below=below,
    )


if __name__ == "__main__":
    sys.exit(main())
