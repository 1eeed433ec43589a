"""Whether a steady loop notices that the learner works beside it in the background."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.learning_runs import Task
from intuitive_physics_learner import ObservationStore
from intuitive_physics_learner.online.background_learning import BackgroundLearning
from intuitive_physics_learner.online.improvement import OnlineOptions
from intuitive_physics_learner.online.worker import SEARCHING

RATE = 100.0
"""Hz, of the predictor."""

WORK = 0.003
"""s of work a tick, about what a prediction takes."""

PATIENCE = 60.0
"""s that the learner has to be at work."""


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


def compare_lateness(task: Task, seconds: float) -> list[Lateness]:
    """Run the loop alone, and beside a learner that never ends, on the one core that it has."""
    rows = [_loop("nothing", seconds)]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "learner.sqlite3"
        with ObservationStore(path) as store:
            store.add_all(task.dataset.training_observations)
        for priority in ("idle", "normal"):
            background = BackgroundLearning(path, "auto", lambda: None)
            endless = OnlineOptions("random", seconds=1e6, iterations_without_gain=10**9)
            background.start(endless, cores=1, priority=priority)
            try:
                busy = "" if _at_work(background) else ", which got no core to begin with"
                rows.append(_loop(f"the learner, priority {priority}{busy}", seconds))
            finally:
                background.stop()
    return rows


def _at_work(background: BackgroundLearning) -> bool:
    """Wait until the learner searches; return whether it does: others may have all the cores."""
    deadline = time.monotonic() + PATIENCE
    while background.report.state != SEARCHING or background.report.iteration == 0:
        if time.monotonic() > deadline:
            return False
        time.sleep(0.05)
    return True


def _loop(beside: str, seconds: float) -> Lateness:
    told = subprocess.run(
        [sys.executable, "-m", "benchmarks.learning_beside", str(seconds)],
        check=True,
        capture_output=True,
        text=True,
        env={**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
    )
    late = np.array(json.loads(told.stdout)) * 1e3
    return Lateness(beside, *(float(q) for q in np.percentile(late, (50.0, 99.0, 100.0))))


def main() -> None:
    """Be the loop: tick for so many seconds on the core that the learner has; print lateness."""
    seconds = float(sys.argv[1])
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[-1:])
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
