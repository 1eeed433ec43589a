"""`make bench-prediction`: the predictor node as a process, fed over DDS, on two cores.

README.md beside this file says what is measured and how.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.prediction_feed import SCENES, Feed
from benchmarks.prediction_node import MOST_PUBLISHED, NodeUnderTest, largest_sample_count
from benchmarks.prediction_peers import peer_times
from benchmarks.prediction_report import Results, complaints, json_line, report_text
from benchmarks.prediction_truth import truth
from benchmarks.steady_loop import watch_loops
from intuitive_physics.errors import IntuitivePhysicsError
from intuitive_physics_experiments.calibration.paper_calibration import PaperCalibrationOptions

RESULTS = Path(__file__).resolve().parent / "results/prediction.md"
CORES = 2


@dataclass(frozen=True)
class Effort:
    """How long is measured, in s.

    Parameters
    ----------
    steady : each scene with 20 samples; memory has to be flat meanwhile
    trial : each number of samples
    loop : constant work, before and after the node
    truth : calibration on the synthetic set
    """

    steady: float
    trial: float
    loop: float
    truth: PaperCalibrationOptions


SMALL_SET = PaperCalibrationOptions(samples=30, held_out=40, point_counts=(), sample_count=50)
"""Too small to hold the bars for sure: it shows that all works."""

FULL = Effort(300.0, trial=10.0, loop=10.0, truth=PaperCalibrationOptions(point_counts=()))
QUICK = Effort(20.0, trial=4.0, loop=4.0, truth=SMALL_SET)


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the tables, and print the line of JSON last."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="measure little, for a first look")
    parser.add_argument("--write", action="store_true", help=f"write the tables to {RESULTS} too")
    options = parser.parse_args(arguments)
    start = time.perf_counter()
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:CORES])
    try:
        results = measure(QUICK if options.quick else FULL)
    except IntuitivePhysicsError as error:
        print(f"bench-prediction: {error}", file=sys.stderr)
        return 1
    text = report_text(results, time.perf_counter() - start)
    print(text)
    if options.write:
        RESULTS.parent.mkdir(exist_ok=True)
        RESULTS.write_text(text)
    for complaint in complaints(results):
        print(f"bench-prediction: bar missed: {complaint}", file=sys.stderr)
    print(json_line(results))
    return 0


def measure(effort: Effort) -> Results:
    """Measure all, one after the other."""
    runs, most = {}, {}
    cores = sorted(os.sched_getaffinity(0))
    _tell("constant work")
    loops = [watch_loops("nothing, before", effort.loop, cores)]
    for name in SCENES:
        _tell(f"{name}: 20 samples")
        with NodeUnderTest(Feed(name)) as node:
            runs[name] = node.run(effort.steady)
        _tell(f"{name}: how many samples hold 100 Hz")
        with NodeUnderTest(Feed(name), published_samples=MOST_PUBLISHED) as node:
            most[name] = largest_sample_count(node, effort.trial)
    loops.append(watch_loops("nothing, after", effort.loop, cores))
    _tell("other engines alone")
    peers = peer_times(SCENES)
    _tell("coverage and scores")
    return Results(runs, most, loops, peers, truth(effort.truth))


def _tell(what: str) -> None:
    print(f"── {what}", file=sys.stderr)


if __name__ == "__main__":
    sys.exit(main())
