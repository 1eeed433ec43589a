"""All that the predictor node publishes: distributions, estimated states and markers."""

from __future__ import annotations

import time

from intuitive_physics_msgs.msg import ObjectStates
from intuitive_physics_msgs.msg import TrajectoryDistribution as DistributionMessage
from rclpy.node import Node
from visualization_msgs.msg import MarkerArray

from intuitive_physics_predictor.live.live_prediction import LivePrediction
from intuitive_physics_predictor.live.predictor import Snapshot
from intuitive_physics_predictor.nodes.distribution_messages import DistributionWriter, header_of
from intuitive_physics_ros.conversions import object_states_to_message, stamp_from_seconds
from intuitive_physics_ros.markers import distribution_markers
from intuitive_physics_ros.qos import STREAM, create_publisher
from intuitive_physics_ros.topics import PREDICTIONS


class PredictionOutputs:
    """Publishes predictions and estimated states from the thread of the ticks, and markers.

    Parameters
    ----------
    node : publishes them
    published_samples : largest number of samples in a message; may be changed
    """

    def __init__(self, node: Node, published_samples: int) -> None:
        self.published_samples = published_samples
        self._writer = DistributionWriter()
        self._predictions = create_publisher(node, DistributionMessage, PREDICTIONS, STREAM)
        self._estimated_states = create_publisher(node, ObjectStates, "~/estimated_states", STREAM)
        self._markers = node.create_publisher(MarkerArray, "~/markers", 1)

    def publish_prediction(self, made: LivePrediction, due: float) -> None:
        """Publish a prediction that was due at a time (s) of `time.perf_counter`."""
        message = self._writer.write(made, self.published_samples)
        message.computation_time = time.perf_counter() - due
        self._predictions.publish(message)

    def publish_estimated_states(self, snapshot: Snapshot) -> None:
        """Publish the newest states, with estimated ones in the place of the perceived ones."""
        perceived, estimates = snapshot.inputs.states, snapshot.estimates
        if perceived is None or self._estimated_states.get_subscription_count() == 0:
            return
        states = [
            state if estimate is None else estimate.state(state.orientation)
            for state, estimate in zip(
                perceived.states, estimates or [None] * len(perceived.states), strict=True
            )
        ]
        stamp = stamp_from_seconds(perceived.stamp)
        self._estimated_states.publish(
            object_states_to_message(
                perceived.objects, states, frame_id=perceived.frame_id, stamp=stamp
            )
        )

    def publish_markers(self, made: LivePrediction | None) -> None:
        """Publish markers of a prediction, if there is one and they have a subscriber."""
        if made is None or self._markers.get_subscription_count() == 0:
            return
        distribution = made.distribution
        self._markers.publish(
            distribution_markers(
                header_of(made),
                distribution.object_ids,
                distribution.positions,
                distribution.mean,
                distribution.covariance,
            )
        )
