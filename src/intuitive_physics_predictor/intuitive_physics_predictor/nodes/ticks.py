"""The thread that owns the predictor: takes over inputs, and predicts at each tick."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Hashable

from rclpy.node import Node

from intuitive_physics.errors import IntuitivePhysicsError
from intuitive_physics.simulation.stop_flag import StopFlag
from intuitive_physics_predictor.live.live_prediction import (
    LivePrediction,
    NoObjectsError,
    NothingToPredictError,
    OtherClockError,
)
from intuitive_physics_predictor.live.pacer import Pacer
from intuitive_physics_predictor.live.predictor import Predictor, Snapshot
from intuitive_physics_predictor.live.settings import PredictionSettings
from intuitive_physics_predictor.nodes.outputs import PredictionOutputs
from intuitive_physics_ros.background import Background
from intuitive_physics_ros.monitors import RateMonitor
from intuitive_physics_ros.unexpected_errors import unexpected_errors

FAILURES_LOGGED_EVERY = 10.0
"""s between two log lines about samples that failed. Our choice."""

CLOCK_PATIENCE = 1.0
"""s for which states must be of another clock before the log says so: a node that starts, and a bag
that begins again, bring some that are late. Our choice."""


class PredictionTicks:
    """Predicts at a steady rate, in a thread of its own.

    Only that thread touches the predictor. Others post work to it, which is done in the gaps
    between two ticks, and read the newest snapshot.

    Parameters
    ----------
    node : its clock and its log
    predictor : with the inputs and settings so far
    rate : 1/s
    outputs : publish the predictions
    """

    def __init__(
        self, node: Node, predictor: Predictor, rate: float, outputs: PredictionOutputs
    ) -> None:
        self.monitor = RateMonitor("predicts", rate)
        self._node = node
        self._stop = StopFlag()
        self._predictor = predictor
        predictor.set(settings=predictor.snapshot.settings.stopped_by(self._stop))
        self._outputs = outputs
        self._paused_for = ""
        self._clock_was_right = time.monotonic()
        self._background = Background(node, "prepare")
        self._prepared = threading.Event()
        self._prepared.set()
        self._pacer = Pacer(self._on_tick, rate, self._predictor.draw_ahead)

    @property
    def snapshot(self) -> Snapshot:
        """Newest inputs, settings and prediction."""
        return self._predictor.snapshot

    def post(
        self,
        work: Callable[[Predictor], bool | None],
        key: Hashable = None,
        *,
        urgent: bool = False,
    ) -> None:
        """Have work done with the predictor between two ticks, as `Pacer.post`."""
        self._pacer.post(lambda: work(self._predictor), key, urgent=urgent)

    def prepare(self, work: Callable[[Snapshot], None]) -> None:
        """Have work done that takes longer than a tick, in another thread; it may post.

        Of work that was not begun the newest counts.
        """
        self._prepared = done = threading.Event()

        def prepare() -> None:
            try:
                work(self.snapshot)
            finally:
                done.set()

        self._background.post(prepare, key="newest")

    def settled_snapshot(self, longest: float) -> Snapshot:
        """Return the snapshot once all that was posted is done, after `longest` s at most."""
        self._prepared.wait(longest)
        done = threading.Event()

        def settle() -> None:
            if self._predictor.is_taking:
                self._pacer.post(settle)
            else:
                done.set()

        self._pacer.post(settle)
        done.wait(longest)
        return self.snapshot

    def set(
        self,
        *,
        rate: float,
        settings: PredictionSettings | None = None,
        seed: int | None = None,
    ) -> None:
        """Set how the next predictions are made; None leaves settings or seed as they are."""

        def work() -> None:
            stoppable = None if settings is None else settings.stopped_by(self._stop)
            self._predictor.set(settings=stoppable, seed=seed)
            if rate != self.monitor.rate:
                self.monitor.rate = rate
                self._pacer.set_rate(rate)

        self._pacer.post(work)

    def start(self) -> None:
        """Begin, with the first tick at once."""
        self._pacer.start()

    def stop(self, patience: float) -> bool:
        """Cut the tick under way short; return whether all has ended within `patience` s."""
        self._stop.set()
        end = time.monotonic() + patience
        ticks = self._pacer.stop(patience)
        return self._background.stop(max(0.0, end - time.monotonic())) and ticks

    def _on_tick(self, late: float, left_out: int) -> None:
        """Predict from the newest inputs and publish."""
        due = time.perf_counter() - late
        now = 1e-9 * self._node.get_clock().now().nanoseconds - late
        had_prediction = self.snapshot.newest is not None
        try:
            made = self._predictor.predict(now=now, monotonic=time.monotonic())
            self._outputs.publish_prediction(made, due)
        except Exception as error:
            # An exception that ended this thread would end all prediction.
            if not self._stop.is_set():
                self._pause(error, had_prediction)
            return
        self._clock_was_right = time.monotonic()
        self.monitor.left_out(left_out)
        self.monitor.done(time.perf_counter() - due)
        if self._paused_for:
            self._node.get_logger().info("predicts again")
            self._paused_for = ""
        if made.distribution.failed_count:
            self._log_failures(made)

    def _log_failures(self, made: LivePrediction) -> None:
        failed = made.distribution.failed_count
        self._node.get_logger().warning(
            f"{failed} of {failed + made.distribution.weights.size} samples could not be simulated "
            "to the end and are left out; check the objects' states, their speeds above all",
            throttle_duration_sec=FAILURES_LOGGED_EVERY,
        )

    def _pause(self, error: Exception, had_prediction: bool) -> None:
        """Report why nothing is predicted: on /diagnostics, and a new reason in the log."""
        is_ours = isinstance(error, IntuitivePhysicsError)
        reason = (
            str(error) if is_ours else unexpected_errors(self._node).report(error, "a prediction")
        )
        no_objects = isinstance(error, NoObjectsError)
        self.monitor.idle(reason, normal=no_objects)
        # The age of the states in the reason grows: it is one reason. No states yet is no news,
        # but a wrong clock would let the user wait for ever.
        waits = isinstance(error, NothingToPredictError)
        news = type(error).__name__ if waits else reason
        if not isinstance(error, OtherClockError):
            self._clock_was_right = time.monotonic()
        has_clock = time.monotonic() - self._clock_was_right < CLOCK_PATIENCE
        is_start = waits and not had_prediction and has_clock
        if not is_start and not no_objects and news != self._paused_for:
            sentence = "predicts no more" if had_prediction else "does not predict"
            self._node.get_logger().warning(f"{sentence}: {reason}")
            self._paused_for = news
