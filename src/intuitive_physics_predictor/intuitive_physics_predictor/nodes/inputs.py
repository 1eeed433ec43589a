"""All that the predictor node subscribes to: environment, object states and θ_s."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

from intuitive_physics_msgs.msg import Environment as EnvironmentMessage
from intuitive_physics_msgs.msg import ObjectStates
from intuitive_physics_msgs.msg import StaticParameters as StaticParametersMessage
from rclpy.node import Node
from rclpy.serialization import deserialize_message

from intuitive_physics.errors import IntuitivePhysicsError
from intuitive_physics_predictor.live.live_prediction import PerceivedStates
from intuitive_physics_predictor.live.predictor import Predictor, Snapshot
from intuitive_physics_predictor.nodes.outputs import PredictionOutputs
from intuitive_physics_predictor.nodes.ticks import PredictionTicks
from intuitive_physics_ros.conversions import (
    detections_from_messages,
    environment_from_message,
    object_states_from_messages,
    seconds_from_stamp,
    static_parameters_from_message,
)
from intuitive_physics_ros.lifecycle.managed_node import ManagedNode
from intuitive_physics_ros.monitors import InputMonitor
from intuitive_physics_ros.qos import LATCHED, SENSOR_DATA, create_subscription
from intuitive_physics_ros.silence import SAME_NAMESPACE, WARN_AGAIN, Silence
from intuitive_physics_ros.topics import ENVIRONMENT, OBJECT_STATES, STATIC_PARAMETERS
from intuitive_physics_ros.unexpected_errors import unexpected_errors

STATES_TIMEOUT = 2.0
"""s without object states after which they count as lost. Our choice."""


class PredictionInputs:
    """Hands each message to the predictor, to be decoded and taken over between two ticks.

    Of messages that come faster than they can be decoded the newest counts.

    Parameters
    ----------
    node : subscribes
    ticks : own the predictor
    outputs : publish the states that are estimated from new ones
    """

    def __init__(
        self, node: ManagedNode, ticks: PredictionTicks, outputs: PredictionOutputs
    ) -> None:
        self._node = node
        self._ticks = ticks
        self._outputs = outputs
        self._monitors: dict[str, InputMonitor] = {}
        for name, kind, qos, callback in (
            (ENVIRONMENT, EnvironmentMessage, LATCHED, self._on_environment),
            (OBJECT_STATES, ObjectStates, SENSOR_DATA, self._on_states),
            (STATIC_PARAMETERS, StaticParametersMessage, LATCHED, self._on_parameters),
        ):
            monitor = InputMonitor(node, name, STATES_TIMEOUT if name == OBJECT_STATES else None)
            self._monitors[name] = monitor
            create_subscription(node, kind, name, callback, qos, raw=True)
            if name != STATIC_PARAMETERS:
                # A learner is not needed; perception that runs reports itself what it waits for.
                monitor.expect(Silence(node, {name: kind}, SAME_NAMESPACE, patience=WARN_AGAIN))
            node.diagnostics.add(name.rpartition("/")[2], monitor.check)

    def _on_environment(self, message: bytes) -> None:
        monitor = self._monitors[ENVIRONMENT]

        def take(predictor: Predictor) -> None:
            with _reported(self._node, monitor):
                received = deserialize_message(message, EnvironmentMessage)
                predictor.take(
                    environment=environment_from_message(received),
                    environment_version=received.version,
                )
                monitor.accepted()

        self._ticks.post(take, key=monitor)

    def _on_states(self, message: bytes) -> None:
        """Have states taken over at once, so that the next tick predicts from them."""
        monitor = self._monitors[OBJECT_STATES]
        stamp, monotonic = 1e-9 * self._node.get_clock().now().nanoseconds, time.monotonic()

        def take(predictor: Predictor) -> bool:
            with _reported(self._node, monitor):
                received = deserialize_message(message, ObjectStates)
                states = perceived_states(received, stamp, monotonic)
                return self._take_step(predictor.take_states(states))
            return True

        self._ticks.post(take, key=monitor, urgent=True)

    def _take_step(self, steps: Iterator[None]) -> bool:
        """Take over one object, and post the next one; return whether it was the last one."""
        monitor = self._monitors[OBJECT_STATES]
        with _reported(self._node, monitor):
            for _ in steps:
                self._ticks.post(lambda _: self._take_step(steps), urgent=True)
                return False
            self._outputs.publish_estimated_states(self._ticks.snapshot)
            monitor.accepted()
        return True

    def _on_parameters(self, message: bytes) -> None:
        """Draw from newer θ_s beside the ticks, then have it taken over between two of them."""
        monitor = self._monitors[STATIC_PARAMETERS]

        def prepare(snapshot: Snapshot) -> None:
            with _reported(self._node, monitor):
                received = deserialize_message(message, StaticParametersMessage)
                learned = static_parameters_from_message(received)
                snapshot.settings.uncertain_parameters(learned, learned.materials)
                self._ticks.post(lambda predictor: predictor.take(learned=learned), key=monitor)
                monitor.accepted()

        self._ticks.prepare(prepare)


def perceived_states(message: ObjectStates, arrival: float, monotonic: float) -> PerceivedStates:
    """Return the states in a message.

    `arrival` is s on the node's clock, `monotonic` s of the same instant on `time.monotonic`.
    """
    objects, states = object_states_from_messages(message.objects)
    stamp = seconds_from_stamp(message.header.stamp)
    return PerceivedStates(
        tuple(objects),
        tuple(states),
        stamp,
        arrived=monotonic,
        delay=arrival - stamp,
        frame_id=message.header.frame_id,
        detections=detections_from_messages(message, stamp),
    )


@contextmanager
def _reported(node: Node, monitor: InputMonitor) -> Iterator[None]:
    """Report an input that is wrong, and go on."""
    try:
        yield
    except IntuitivePhysicsError as error:
        monitor.rejected(error)
    except Exception as error:
        monitor.rejected(unexpected_errors(node).report(error, "an input"))
