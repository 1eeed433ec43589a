"""Publishers that both nodes of this package have: states, observations and markers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from builtin_interfaces.msg import Time
from intuitive_physics_msgs.msg import ObjectStates
from intuitive_physics_msgs.msg import Observation as ObservationMessage
from numpy.typing import NDArray
from rclpy.node import Node
from std_msgs.msg import Header
from visualization_msgs.msg import MarkerArray

from intuitive_physics.observation import Detections, Observation
from intuitive_physics.scene import Environment, SceneObject
from intuitive_physics.state import ObjectState
from intuitive_physics_ros.conversions import object_states_to_message, observation_to_message
from intuitive_physics_ros.markers import (
    clearing_marker,
    environment_markers,
    gravity_marker,
    name_markers,
    object_markers,
)
from intuitive_physics_ros.parameters import Parameter
from intuitive_physics_ros.qos import OBSERVATIONS as OBSERVATIONS_QOS
from intuitive_physics_ros.qos import STREAM, create_publisher
from intuitive_physics_ros.topics import OBJECT_STATES, OBSERVATIONS

MARKER_RATE = Parameter("marker_rate", 5.0, "RViz marker messages a second", (0.1, 100.0))
"""Parameter of both nodes."""


class Outputs:
    """Publishes object states, observations and markers for RViz.

    Parameters
    ----------
    node : publishes them
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._states = create_publisher(node, ObjectStates, OBJECT_STATES, STREAM)
        self.observations = create_publisher(
            node, ObservationMessage, OBSERVATIONS, OBSERVATIONS_QOS
        )
        self._markers = node.create_publisher(MarkerArray, "~/markers", 1)

    def publish_states(
        self,
        header: Header,
        objects: Sequence[SceneObject],
        states: Sequence[ObjectState],
        detections: Sequence[Detections | None] = (),
    ) -> None:
        """Publish the states of objects at the time and in the frame of a header."""
        self._states.publish(
            object_states_to_message(
                objects,
                states,
                frame_id=header.frame_id,
                stamp=header.stamp,
                detections=detections,
            )
        )

    def publish_observation(self, observation: Observation) -> None:
        """Publish an observation and log the names of its objects."""
        self.observations.publish(observation_to_message(observation))
        self._node.get_logger().info(f"observed {object_names(observation)}")

    @property
    def has_viewer(self) -> bool:
        """Whether anyone subscribes to the markers."""
        return bool(self._markers.get_subscription_count())

    def publish_markers(
        self,
        stamp: Time,
        environment: Environment,
        objects: Sequence[SceneObject],
        states: Sequence[ObjectState],
        colors: Sequence[NDArray[np.float64] | None] | None = None,
    ) -> None:
        """Publish markers of an environment and its objects, in `colors` (3,) of 0 to 1."""
        header = Header(stamp=stamp, frame_id=environment.frame_id)
        self._markers.publish(
            MarkerArray(
                markers=[
                    clearing_marker(),
                    *environment_markers(environment, stamp),
                    *object_markers(objects, states, header, colors=colors),
                    *name_markers(objects, states, header, -environment.gravity),
                    gravity_marker(environment, stamp),
                ]
            )
        )


def object_names(observation: Observation) -> str:
    """Return the names of an observation's objects, separated by commas."""
    return ", ".join(item.object.id for item in observation.objects)
