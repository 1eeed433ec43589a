"""What the predictor node does at each tick: predict from the newest of everything, and publish."""

from __future__ import annotations

import time
from contextlib import suppress
from dataclasses import replace
from typing import Any

from intuitive_physics_msgs.msg import TrajectoryDistribution as DistributionMessage
from rclpy.node import Node

from intuitive_physics.errors import IntuitivePhysicsError
from intuitive_physics_predictor.live.live_prediction import (
    Inputs,
    LivePrediction,
    NoObjectsError,
    NothingToPredictError,
    predict_now,
)
from intuitive_physics_predictor.live.pacer import Pacer
from intuitive_physics_predictor.live.prediction_settings import PredictionSettings
from intuitive_physics_predictor.nodes.messages import distribution_message
from intuitive_physics_ros.conversions import DistributionWriter
from intuitive_physics_ros.qos import SENSOR_DATA
from intuitive_physics_ros.rate_monitor import RateMonitor

INPUT_TIME, LONGEST_WAIT = 5e-3, 0.02
"""s that an input takes to be taken over, and that it waits for a tick to end."""


class PredictionTicks:
    """Publishes predictions at a steady rate, from a thread of its own.

    Attributes may be set at any time; they count from the next tick on.

    Parameters
    ----------
    node : publishes them
    settings : how to predict
    rate : 1/s
    seed : of the next prediction's noise, one more each time
    published_samples : in a message at most
    """

    def __init__(
        self,
        node: Node,
        settings: PredictionSettings,
        rate: float,
        seed: int,
        published_samples: int,
    ) -> None:
        self.inputs = Inputs()
        self.settings = settings
        self.seed = seed
        self.published_samples = published_samples
        self.newest: LivePrediction | None = None
        self.monitor = RateMonitor("predicts", rate)
        self._node = node
        self._writer = DistributionWriter()
        self._paused_for = ""
        self._publisher = node.create_publisher(
            DistributionMessage, "~/trajectory_distribution", SENSOR_DATA
        )
        self._pacer = Pacer(self._on_tick, rate)

    def take(self, **newer: Any) -> None:
        """Take over inputs that are newer, and draw the samples of the next tick from them."""
        self.inputs = replace(self.inputs, **newer)
        self._draw_ahead()

    def wait_for_gap(self) -> None:
        """Wait until no tick is under way, so that what follows takes none of its time."""
        self._pacer.wait_for_gap(INPUT_TIME, LONGEST_WAIT)

    def start(self) -> None:
        """Begin, with the first tick at once."""
        self._pacer.start()

    def stop(self) -> None:
        """End once the tick under way is done."""
        self._pacer.stop()

    def set_rate(self, rate: float) -> None:
        """Go on at another rate (1/s)."""
        if rate != self.monitor.rate:
            self.monitor.rate = rate
            self._pacer.set_rate(rate)

    def _on_tick(self, late: float, left_out: int) -> None:
        """Predict from the newest input and publish; runs in the pacer's thread."""
        due = time.perf_counter() - late
        now = 1e-9 * self._node.get_clock().now().nanoseconds - late
        try:
            made = predict_now(
                self.inputs, self.settings, seed=self.seed, now=now, monotonic=time.monotonic()
            )
            message = distribution_message(self._writer, made, self.published_samples)
            message.computation_time = time.perf_counter() - due
            self._publisher.publish(message)
        except Exception as error:
            # A thread that dies would take all prediction with it.
            self._pause(error)
            return
        self.newest = made
        self.seed += 1
        self.monitor.left_out(left_out)
        self.monitor.done(time.perf_counter() - due)
        if self._paused_for:
            self._node.get_logger().info("predicts again")
            self._paused_for = ""
        # What waits is an input, after which they are drawn anyway.
        if not self._pacer.is_awaited:
            self._draw_ahead()

    def _draw_ahead(self) -> None:
        """Draw the samples of the next tick while nothing waits for them."""
        # What goes wrong goes wrong again in the tick, which tells it.
        with suppress(Exception):
            self.settings.draw_ahead(self.inputs.scene, self.inputs.learned, self.seed)

    def _pause(self, error: Exception) -> None:
        """Say why nothing is predicted now: on /diagnostics, and in the log when it is news."""
        known = isinstance(error, IntuitivePhysicsError)
        reason = str(error) if known else f"internal error, please report: {error!r}"
        self.monitor.idle(reason)
        # That states get older is told once; that there are none yet, or no objects, is no news.
        waits = isinstance(error, NothingToPredictError)
        news = type(error).__name__ if waits else reason
        quiet = isinstance(error, NoObjectsError) or (waits and self.newest is None)
        if not quiet and news != self._paused_for:
            self._node.get_logger().warning(f"predicts no more: {reason}")
            self._paused_for = news
        self.newest = None
