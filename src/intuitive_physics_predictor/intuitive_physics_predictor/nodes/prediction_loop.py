"""The predictor node's thread: decodes inputs, predicts at a steady rate, and publishes."""

from __future__ import annotations

import time
from collections.abc import Callable, Hashable
from functools import partial
from typing import Any

from intuitive_physics_msgs.msg import TrajectoryDistribution as DistributionMessage
from rclpy.node import Node

from intuitive_physics.errors import IntuitivePhysicsError
from intuitive_physics_predictor.live.live_prediction import (
    Inputs,
    LivePrediction,
    NoObjectsError,
    NothingToPredictError,
)
from intuitive_physics_predictor.live.pacer import Pacer
from intuitive_physics_predictor.live.predictor import Predictor
from intuitive_physics_predictor.live.settings import PredictionSettings
from intuitive_physics_predictor.nodes.messages import distribution_message
from intuitive_physics_ros.conversions import DistributionWriter
from intuitive_physics_ros.input_monitor import InputMonitor
from intuitive_physics_ros.qos import SENSOR_DATA
from intuitive_physics_ros.rate_monitor import RateMonitor

INPUT_TIME = 5e-3
"""s that decoding an input and drawing from it takes at most, as measured with three objects."""

Decode = Callable[[], dict[str, Any]]


class PredictionLoop:
    """Owns a `Predictor`: one thread decodes, draws ahead, predicts and publishes.

    Methods may be called from any thread. They hand over what is to be done to that thread, which
    does it in the gap between two ticks.

    Parameters
    ----------
    node : publishes the predictions
    settings : how to predict
    rate : 1/s
    seed : of the next prediction's noise, one more after each
    published_samples : in a message at most
    """

    def __init__(
        self,
        node: Node,
        settings: PredictionSettings,
        *,
        rate: float,
        seed: int,
        published_samples: int,
    ) -> None:
        self.monitor = RateMonitor("predicts", rate)
        self._node = node
        self._predictor = Predictor(settings, seed)
        self._published_samples = published_samples
        self._writer = DistributionWriter()
        self._paused_for = ""
        self._publisher = node.create_publisher(
            DistributionMessage, "~/trajectory_distribution", SENSOR_DATA
        )
        self._pacer = Pacer(self._on_tick, rate, INPUT_TIME)

    @property
    def inputs(self) -> Inputs:
        """The newest inputs that were taken."""
        return self._predictor.inputs

    @property
    def newest(self) -> LivePrediction | None:
        """The newest prediction; None while nothing can be predicted."""
        return self._predictor.newest

    def start(self) -> None:
        """Begin, with the first tick at once."""
        self._pacer.start()

    def stop(self) -> None:
        """End once the tick under way is done."""
        self._pacer.stop()

    def take(self, monitor: InputMonitor, decode: Decode) -> None:
        """Have an input decoded and taken, unless a newer one of the same topic comes first.

        Parameters
        ----------
        monitor : hears whether the input was good
        decode : returns fields of `Inputs` by name; may raise an error of the suite
        """
        self._submit(monitor, partial(self._take, monitor, decode))

    def wait_for_inputs(self, longest: float) -> None:
        """Wait until what was handed over has been taken, `longest` s at most."""
        self._pacer.wait_for_jobs(longest)

    def set_settings(self, settings: PredictionSettings) -> None:
        """Predict in another way from the next tick on."""
        self._submit("settings", partial(setattr, self._predictor, "settings", settings))

    def set_seed(self, seed: int) -> None:
        """Give the next prediction another seed."""
        self._submit("seed", partial(setattr, self._predictor, "seed", seed))

    def set_published_samples(self, count: int) -> None:
        """Publish `count` samples at most."""
        self._submit("published", partial(setattr, self, "_published_samples", count))

    def set_rate(self, rate: float) -> None:
        """Go on at another rate (1/s)."""
        if rate != self.monitor.rate:
            self.monitor.rate = rate
            self._pacer.set_rate(rate)

    def _submit(self, key: Hashable, job: Callable[[], None]) -> None:
        self._pacer.submit(key, partial(self._survive, job))

    def _survive(self, job: Callable[[], None]) -> None:
        """Do a job; a thread that dies would take all prediction with it."""
        try:
            job()
        except Exception as error:
            self._node.get_logger().error(f"internal error, please report: {error!r}")

    def _take(self, monitor: InputMonitor, decode: Decode) -> None:
        try:
            newer = decode()
        except IntuitivePhysicsError as error:
            monitor.rejected(error)
            return
        monitor.accepted()
        self._predictor.take(**newer)
        self._predictor.prefetch()

    def _on_tick(self, late: float, left_out: int) -> None:
        """Predict from the newest inputs and publish."""
        due = time.perf_counter() - late
        now = 1e-9 * self._node.get_clock().now().nanoseconds - late
        before = self._predictor.newest
        try:
            made = self._predictor.predict(now, time.monotonic())
            message = distribution_message(self._writer, made, self._published_samples)
            message.computation_time = time.perf_counter() - due
            self._publisher.publish(message)
        except Exception as error:
            self._pause(error, before is None)
            return
        self.monitor.left_out(left_out)
        self.monitor.done(time.perf_counter() - due)
        if self._paused_for:
            self._node.get_logger().info("predicts again")
            self._paused_for = ""
        # An input that waits draws the samples itself.
        if not self._pacer.has_jobs:
            self._survive(self._predictor.prefetch)

    def _pause(self, error: Exception, paused_before: bool) -> None:
        """Report why nothing is predicted now: on /diagnostics, and in the log when it is news."""
        known = isinstance(error, IntuitivePhysicsError)
        reason = str(error) if known else f"internal error, please report: {error!r}"
        self.monitor.idle(reason)
        # That states get older is logged once; that there are none yet, or no objects, is no news.
        waits = isinstance(error, NothingToPredictError)
        news = type(error).__name__ if waits else reason
        quiet = isinstance(error, NoObjectsError) or (waits and paused_before)
        if not quiet and news != self._paused_for:
            self._node.get_logger().warning(f"predicts no more: {reason}")
            self._paused_for = news
