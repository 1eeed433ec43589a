"""Constant work at 100 Hz: what the machine, or what works beside the loop, adds to its time."""

from __future__ import annotations

import json
import math
import os
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from intuitive_physics.processes import ChildProcess

RATE = 100.0
"""Hz, of the predictor."""

STARTING = 120.0
"""s that a loop's process may take besides; it ends with the benchmark if it takes longer."""

WORK = 0.003
"""s of work a tick, about what a prediction takes."""


@dataclass(frozen=True)
class Lateness:
    """When the work of a tick was done, over the ticks of a loop.

    Parameters
    ----------
    beside : what worked at the same time
    median, most, worst : ms after the tick: of half, of 99 % and of all ticks
    """

    beside: str
    median: float
    most: float
    worst: float


def watch_loops(beside: str, seconds: float, cores: Sequence[int]) -> Lateness:
    """Run a loop on each of these cores, each a process of its own, for some seconds."""
    loops = [
        ChildProcess(
            [sys.executable, "-m", "benchmarks.steady_loop", str(seconds), str(core)],
            name="a steady loop",
            environment={**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
        )
        for core in cores
    ]
    for loop in loops:
        if loop.wait(seconds + STARTING) != 0:
            loop.check_running()
    late = 1e3 * np.concatenate([json.loads(loop.output) for loop in loops])
    return Lateness(beside, *(float(q) for q in np.percentile(late, (50.0, 99.0, 100.0))))


def main() -> None:
    """Be the loop: tick for some seconds on one core and print the lateness of each tick."""
    seconds, core = float(sys.argv[1]), int(sys.argv[2])
    os.sched_setaffinity(0, [core])
    some = np.random.default_rng(0).random((60, 60))
    rounds = _rounds_of(WORK, some)
    late = []
    due = time.monotonic() + 0.1
    end = due + seconds
    while due < end:
        time.sleep(max(0.0, due - time.monotonic()))
        _work(rounds, some)
        late.append(time.monotonic() - due)
        # Ticks that were missed are not made up for.
        due += math.ceil(late[-1] * RATE) / RATE
    print(json.dumps(late))


def _rounds_of(seconds: float, some: np.ndarray) -> int:
    """How much work takes so long, by the time that this process has had of the core."""
    began = time.process_time()
    _work(1000, some)
    return max(1, int(1000 * seconds / (time.process_time() - began)))


def _work(rounds: int, some: np.ndarray) -> None:
    for _ in range(rounds):
        some @ some


if __name__ == "__main__":
    main()
