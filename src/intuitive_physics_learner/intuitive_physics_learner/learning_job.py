"""Learning in a thread of its own, watched and stopped from another."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import replace

import numpy as np

from intuitive_physics.errors import SimulationStoppedError
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.simulation.stop_flag import StopFlag
from intuitive_physics_learner.errors import LearningCancelledError
from intuitive_physics_learner.learning_session import LearningResult
from intuitive_physics_learner.search.convergence import SearchProgress

REPORT_PERIOD = 0.1
"""s between two calls of `on_change` at least, except for the last."""

Work = Callable[[Callable[[SearchProgress], None], StopFlag], LearningResult]
"""Takes `on_progress`, as `learn_from_store` does, and a flag that its simulations stop by."""

YIELD_PERIOD, YIELD = 0.02, 2e-4
"""s between two pauses of a search, and their length. A kernel releases the interpreter lock and
takes it again within some 10 µs; a thread that waits for it is woken by each release, too late, and
so never asks for it: it waited for 0.5 s now and then."""


class LearningJob:
    """Starts at once; kernels of the search release the interpreter lock, so other threads run."""

    def __init__(self, work: Work, on_change: Callable[[], None]) -> None:
        self._work = work
        self._on_change = on_change
        self._stop = StopFlag()
        self._why = ""
        self._outcome: Future[LearningResult] = Future()
        self._lock = threading.Lock()
        self._progress = SearchProgress(0, np.inf, (), 0.0, np.inf)
        self._reported_at = self._yielded_at = -np.inf
        self._began = time.monotonic()
        self._ended: float | None = None
        self._thread = threading.Thread(target=self._run, name="learning", daemon=True)
        self._thread.start()

    @property
    def cancelled(self) -> bool:
        """Whether a stop was requested."""
        return self._stop.is_set()

    @property
    def cancellation(self) -> LearningCancelledError:
        """The error that is raised in place of a result after a stop."""
        return LearningCancelledError(self._why) if self._why else LearningCancelledError()

    @property
    def done(self) -> bool:
        """Whether it has ended, with or without a result."""
        return self._outcome.done()

    @property
    def seconds(self) -> float:
        """Wall time so far, or from begin to end."""
        return (time.monotonic() if self._ended is None else self._ended) - self._began

    @property
    def iteration(self) -> int:
        """Evaluations of J so far."""
        return self._progress.iteration

    def cancel(self, why: str = "") -> None:
        """Make it stop, in the midst of a simulation too."""
        self._why = self._why or why
        self._stop.set()

    def stop(self, timeout: float) -> bool:
        """Cancel, wait up to `timeout` s, and return whether it has ended."""
        self.cancel()
        self._thread.join(timeout)
        return self.done

    def drain_progress(self) -> SearchProgress:
        """Return the progress and drain the new costs: each is returned once."""
        with self._lock:
            drained = self._progress
            self._progress = replace(drained, new_costs=())
        return drained

    def result(self) -> LearningResult:
        """Wait for the end and return what was learned, or raise what the work raised."""
        return self._outcome.result()

    def learned(self) -> LearnedParameters | None:
        """Return what was learned; None as long as it has not ended, or when it failed."""
        if not self.done or self._outcome.exception() is not None:
            return None
        return self._outcome.result().learned

    def _run(self) -> None:
        try:
            result = self._work(self._on_progress, self._stop)
        except SimulationStoppedError:
            self._ended = time.monotonic()
            self._outcome.set_exception(self.cancellation)
        except Exception as error:
            # `result` raises it in the caller's thread.
            self._ended = time.monotonic()
            self._outcome.set_exception(error)
        else:
            self._ended = time.monotonic()
            self._outcome.set_result(result)
        self._on_change()

    def _on_progress(self, progress: SearchProgress) -> None:
        with self._lock:
            before = self._progress.new_costs
            self._progress = replace(progress, new_costs=before + progress.new_costs)
        now = time.monotonic()
        if now - self._yielded_at >= YIELD_PERIOD:
            self._yielded_at = now
            time.sleep(YIELD)
        if now - self._reported_at >= REPORT_PERIOD:
            self._reported_at = now
            self._on_change()
