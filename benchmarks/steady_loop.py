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

RATE = 100.0  # hz, of the predictor
WORK = 0.003  # s of work a tick, about what a prediction takes


@dataclass(frozen=True)
class Lateness:
    """When the work was done, in ms after the tick: of half, of 99 % and of all ticks of a loop.

    `beside` names what worked at the same time.
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
        # A process that takes two minutes more than its loop hangs.
        if loop.wait(seconds + 120.0) != 0:
            loop.check_running()
    late = 1e3 * np.concatenate([json.loads(loop.output) for loop in loops])
    return Lateness(beside, *(float(q) for q in np.percentile(late, (50.0, 99.0, 100.0))))


def main() -> None:
    """Be the loop: tick for some seconds on one core and print the lateness of each tick."""
    seconds, core = float(sys.argv[1]), int(sys.argv[2])
    os.sched_setaffinity(0, [core])
    matrix = np.random.default_rng(0).random((60, 60))
    rounds = _rounds_within(WORK, matrix)
    late = []
    due = time.monotonic() + 0.1
    end = due + seconds
    while due < end:
        time.sleep(max(0.0, due - time.monotonic()))
        _work(rounds, matrix)
        late.append(time.monotonic() - due)
        # Ticks that were missed are not made up for.
        due += math.ceil(late[-1] * RATE) / RATE
    print(json.dumps(late))


def _rounds_within(seconds: float, matrix: np.ndarray) -> int:
    """Return how much work takes some seconds of this process's time on the core."""
    began = time.process_time()
    _work(1000, matrix)
    return max(1, int(1000 * seconds / (time.process_time() - began)))


def _work(rounds: int, matrix: np.ndarray) -> None:
    for _ in range(rounds):
        matrix @ matrix


if __name__ == "__main__":
    main()
