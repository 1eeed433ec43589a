"""Whether a steady loop notices that the learner works beside it in the background."""

from __future__ import annotations

import os
import tempfile
import time
from dataclasses import replace
from pathlib import Path

from benchmarks.learning.paper_sets import Task
from benchmarks.results.result import Column, Table
from benchmarks.steady_loop import watch_loops
from intuitive_physics_learner import ObservationStore
from intuitive_physics_learner.online.background_learning import BackgroundLearning
from intuitive_physics_learner.online.options import OnlineOptions
from intuitive_physics_learner.online.worker import LEARNING

COPIES = 4  # copies of each observation, so that there is more to learn from than time
PATIENCE = 60.0  # s within which the learner has to be at work


def compare_lateness(task: Task, seconds: float) -> Table:
    """Run the loop alone, and beside a learner with endless work, on the one core that it has."""
    core = sorted(os.sched_getaffinity(0))[-1:]
    alone = watch_loops("nothing", seconds, core)
    rows = [alone]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "learner.sqlite3"
        observations = task.dataset.training_observations
        with ObservationStore(path) as store:
            for copy in range(COPIES):
                store.add_all([replace(each, id=f"{each.id} {copy}") for each in observations])
        for priority in ("idle", "normal"):
            background = BackgroundLearning(path, "auto", lambda: None)
            background.start(OnlineOptions(), cores=1, priority=priority)
            try:
                busy = "" if _at_work(background) else ", which got no core to begin with"
                beside = f"the learner, priority {priority}{busy}"
                rows.append(watch_loops(beside, seconds, core))
            finally:
                background.stop()
    return Table.of(
        "A 100 Hz loop on the one core of the background learner: ms from tick to work done",
        rows,
        [
            (Column("beside it"), lambda r: r.beside),
            (Column("median", "ms", ".2f"), lambda r: r.median),
            (Column("99 %", "ms", ".2f"), lambda r: r.most),
            (Column("worst", "ms", ".2f"), lambda r: r.worst),
            (Column("99 % over that alone", "", ".2f"), lambda r: r.most / alone.most),
        ],
    )


def _at_work(background: BackgroundLearning) -> bool:
    """Wait until the learner learns; return whether it does: others may have all the cores."""
    deadline = time.monotonic() + PATIENCE
    while background.report.state != LEARNING:
        if time.monotonic() > deadline:
            return False
        time.sleep(0.05)
    return True
