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
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace

from intuitive_physics.errors import IntuitivePhysicsError
from intuitive_physics.kernels.cache import compilations_noted
from intuitive_physics.limits import InputLimits, use_limits
from intuitive_physics.simulation import make_simulator
from intuitive_physics_learner.online.options import OnlineOptions
from intuitive_physics_learner.online.stored_online_learning import StoredOnlineLearning
from intuitive_physics_learner.store import ObservationStore


@dataclass(frozen=True)
class WorkerReport:
    """The state of the worker.

    Parameters
    ----------
    state : LEARNING, COMPILING (kernels, once), WAITING (for observations) or FAILED
    processed : observations learned from or set aside so far
    pending : observations that are still to be learned from
    doubtful : observations that are set aside
    score : by how much the candidate has predicted observations better than what is published, as
        the logarithm of a ratio of probabilities
    changes : the last changes of parameters that were noticed, in words
    version : of the newest θ_s that it has published; 0: none yet
    message : what went wrong; empty where nothing did
    """

    state: str
    processed: int = 0
    pending: int = 0
    doubtful: int = 0
    score: float = 0.0
    changes: Sequence[str] = ()
    version: int = 0
    message: str = ""


LEARNING, COMPILING, WAITING, FAILED = "learning", "compiling", "waiting", "failed"
"""States of a worker."""


class Worker:
    """Learns whenever there are observations to learn from."""

    def __init__(
        self, store: ObservationStore, simulator_name: str, cores: int, options: OnlineOptions
    ) -> None:
        self._store = store
        self._simulator = make_simulator(simulator_name, threads=cores)
        self._options = options
        self._report = WorkerReport(WAITING)
        self._notified = threading.Event()
        threading.Thread(target=self._listen, name="commands", daemon=True).start()

    def run(self) -> None:
        """Learn, and wait for new observations, until the process ends."""
        while True:
            self._notified.clear()
            try:
                with compilations_noted(lambda: self._report_state(COMPILING)):
                    self._learn()
            except IntuitivePhysicsError as error:
                self._report_state(FAILED, str(error))
            self._notified.wait()

    def _learn(self) -> None:
        """Learn from all that waits in the store."""
        learning = StoredOnlineLearning(self._store, self._simulator, self._options)
        while learning.advance():
            self._send(_report_of(learning, LEARNING))
        self._send(_report_of(learning, WAITING))

    def _report_state(self, state: str, message: str = "") -> None:
        self._send(replace(self._report, state=state, message=message))

    def _send(self, report: WorkerReport) -> None:
        """Keep a report and write it for the process that started this one."""
        self._report = report
        print(json.dumps(asdict(report)), flush=True)

    def _listen(self) -> None:
        for _ in sys.stdin:
            self._notified.set()
        # The process that started this one has ended.
        os._exit(0)


def _report_of(learning: StoredOnlineLearning, activity: str) -> WorkerReport:
    state = learning.learner.state
    return WorkerReport(
        activity,
        state.processed,
        learning.pending,
        state.set_aside,
        state.score,
        [f"{' on '.join(each.pair)} after observation {count}" for each, count in state.changes],
        0 if state.published is None else state.published.version,
        learning.problem,
    )


def main() -> None:
    """Learn in the background until standard input is closed."""
    # Ctrl-C at a terminal reaches this too; the node decides when it ends.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    task = json.loads(sys.argv[1])
    use_limits(InputLimits(**task.get("limits", {})))
    try:
        with ObservationStore(task["database"]) as store:
            Worker(store, task["simulator"], task["cores"], OnlineOptions(**task["options"])).run()
    except (IntuitivePhysicsError, BrokenPipeError) as error:
        sys.exit(str(error))


if __name__ == "__main__":
    main()
