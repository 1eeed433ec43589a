"""`make bench-prediction`: the predictor node as a process, fed over DDS, on two cores.

README.md in the folder above says what is measured and how.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass

from benchmarks.command import Outcome, report_progress, run_benchmark
from benchmarks.prediction.feed import SCENES, Feed
from benchmarks.prediction.node import MOST_PUBLISHED, NodeUnderTest, largest_sample_count
from benchmarks.prediction.peers import peer_times
from benchmarks.prediction.report import Results, complaints, key_figures, tables
from benchmarks.prediction.surfaces import samples_below_a_surface
from benchmarks.prediction.truth import truth
from benchmarks.steady_loop import watch_loops
from intuitive_physics_experiments.calibration.paper_calibration import PaperCalibrationOptions

CORES = 2
"""That node, learner and benchmark share."""


@dataclass(frozen=True)
class Effort:
    """How long is measured, in s.

    Parameters
    ----------
    steady : each scene with 20 samples; memory has to be flat meanwhile
    trial : each number of samples
    loop : constant work, before and after the node
    truth : options of the calibration on the synthetic set
    """

    steady: float
    trial: float
    loop: float
    truth: PaperCalibrationOptions


SMALL_SET = PaperCalibrationOptions(samples=30, held_out=40, point_counts=(), sample_count=50)
"""Too small to hold the bars for sure: it shows that all works."""

FULL = Effort(300.0, trial=10.0, loop=10.0, truth=PaperCalibrationOptions(point_counts=()))
"""Of the results that are kept."""

QUICK = Effort(20.0, trial=4.0, loop=4.0, truth=SMALL_SET)
"""Of a first look."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the tables, and print the line of JSON last."""
    description = (__doc__ or "").splitlines()[0]
    return run_benchmark(
        "prediction", description, lambda options: run(QUICK if options.quick else FULL), arguments
    )


def run(effort: Effort) -> Outcome:
    """Measure all on the first cores of the machine."""
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:CORES])
    results = measure(effort)
    return Outcome(
        tables=tables(results),
        key_figures=key_figures(results),
        complaints=[f"bar missed: {complaint}" for complaint in complaints(results)],
    )


def measure(effort: Effort) -> Results:
    """Measure all, one after the other."""
    runs, most = {}, {}
    cores = sorted(os.sched_getaffinity(0))
    report_progress("constant work")
    loops = [watch_loops("nothing, before", effort.loop, cores)]
    for name in SCENES:
        report_progress(f"{name}: 20 samples")
        with NodeUnderTest(Feed(name)) as node:
            runs[name] = node.run(effort.steady)
        report_progress(f"{name}: how many samples hold 100 Hz")
        with NodeUnderTest(Feed(name), published_samples=MOST_PUBLISHED) as node:
            most[name] = largest_sample_count(node, effort.trial)
    loops.append(watch_loops("nothing, after", effort.loop, cores))
    report_progress("other engines alone")
    peers = peer_times(SCENES)
    report_progress("samples below a surface")
    below = samples_below_a_surface()
    report_progress("coverage and scores")
    return Results(runs, most, loops, peers, truth(effort.truth), below)


if __name__ == "__main__":
    sys.exit(main())
