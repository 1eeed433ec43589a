"""The process that learns in the background.

It may be killed at any instant: all that matters is in the store. A line on its standard input
makes it read the store again, and it ends when that is closed. It writes reports as lines of JSON
to its standard output (`WorkerReport`).
"""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
import time
from dataclasses import asdict, dataclass

from intuitive_physics.errors import IntuitivePhysicsError
from intuitive_physics.simulation import make_simulator
from intuitive_physics_learner.online.improvement import OnlineOptions, OnlineSearch
from intuitive_physics_learner.search.convergence import SearchProgress
from intuitive_physics_learner.store import ObservationStore
from intuitive_physics_learner.store.observation_entries import USED

REPORT_PERIOD = 0.2
"""s between two reports of progress at least."""


@dataclass(frozen=True)
class WorkerReport:
    """The state of the worker.

    Parameters
    ----------
    state : SEARCHING, WAITING (for observations) or FAILED
    iteration : evaluations of J for the present observations
    best_cost : lowest J among them, m; None before the first
    version : of the newest improvement; 0: none yet
    message : what went wrong, when it failed
    """

    state: str
    iteration: int = 0
    best_cost: float | None = None
    version: int = 0
    message: str = ""


SEARCHING, WAITING, FAILED = "searching", "waiting", "failed"
"""States of a worker."""


class Worker:
    """Searches whenever there is something to learn from.

    Parameters
    ----------
    store : of observations and θ_s
    simulator_name : the engine
    cores : it may use
    options : how to learn
    """

    def __init__(
        self, store: ObservationStore, simulator_name: str, cores: int, options: OnlineOptions
    ) -> None:
        self._store = store
        self._simulator = make_simulator(simulator_name, threads=cores)
        self._options = options
        self._notified = threading.Event()
        self._report = WorkerReport(WAITING)
        self._published_at = 0.0
        threading.Thread(target=self._listen, name="commands", daemon=True).start()

    def run(self) -> None:
        """Search, and wait for new observations, until the process ends."""
        while True:
            self._notified.clear()
            try:
                self._learn()
            except IntuitivePhysicsError as error:
                self._publish(state=FAILED, message=str(error))
            else:
                self._publish(state=WAITING, message="")
            self._notified.wait()

    def _learn(self) -> None:
        """Search until the searches over the stored observations have ended."""
        while self._store.count(USED) > 0:
            search = OnlineSearch(self._store, self._simulator, self._options)
            while not search.finished and not search.outdated:
                self._publish(state=SEARCHING, message="")
                improved = search.run_slice(on_progress=self._on_progress)
                if improved is not None:
                    self._publish(version=improved.version)
            if not search.outdated:
                return

    def _on_progress(self, progress: SearchProgress) -> None:
        if time.monotonic() >= self._published_at + REPORT_PERIOD:
            self._publish(iteration=progress.iteration, best_cost=progress.best_cost)

    def _publish(self, **changes: object) -> None:
        self._report = WorkerReport(**{**asdict(self._report), **changes})
        self._published_at = time.monotonic()
        print(json.dumps(asdict(self._report)), flush=True)

    def _listen(self) -> None:
        for _ in sys.stdin:
            self._notified.set()
        # The process that started this one has ended.
        os._exit(0)


def main() -> None:
    """Learn in the background until standard input is closed."""
    # Ctrl-C at a terminal reaches this too; the node decides when it ends.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    task = json.loads(sys.argv[1])
    try:
        with ObservationStore(task["database"]) as store:
            Worker(store, task["simulator"], task["cores"], OnlineOptions(**task["options"])).run()
    except (IntuitivePhysicsError, BrokenPipeError) as error:
        sys.exit(str(error))


if __name__ == "__main__":
    main()
