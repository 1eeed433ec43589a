"""Publishes an environment, latched, and where its frame hangs in the tree of frames."""

from __future__ import annotations

from copy import copy

import numpy as np
from geometry_msgs.msg import TransformStamped
from intuitive_physics_msgs.msg import Environment as EnvironmentMessage
from numpy.typing import NDArray
from rclpy.node import Node
from rclpy.publisher import Publisher
from std_msgs.msg import Header

from intuitive_physics.geometry.rotations import rotation_matrix
from intuitive_physics.scene import Environment
from intuitive_physics_ros.conversions import environment_to_message
from intuitive_physics_ros.conversions.primitives import (
    pose_to_message,
    quaternion_to_message,
    vector_to_message,
)
from intuitive_physics_ros.qos import LATCHED, QOS_OVERRIDES
from intuitive_physics_ros.topics import ENVIRONMENT


class EnvironmentPublisher:
    """Publishes environments and, where tf2_msgs is installed, their frames on /tf_static.

    Parameters
    ----------
    node : that publishes
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self.version = 0
        self._environments = node.create_publisher(
            EnvironmentMessage, ENVIRONMENT, copy(LATCHED), qos_overriding_options=QOS_OVERRIDES
        )
        try:
            from tf2_msgs.msg import TFMessage
        except ImportError:
            self._transforms = None
        else:
            self._transforms = node.create_publisher(TFMessage, "/tf_static", LATCHED)

    @property
    def publishers(self) -> list[Publisher]:
        """What it publishes with, for `farewell`."""
        return [one for one in (self._environments, self._transforms) if one is not None]

    def destroy(self) -> None:
        """Take back what it published last."""
        for publisher in self.publishers:
            self._node.destroy_publisher(publisher)

    def publish(
        self,
        environment: Environment,
        *,
        camera: Header,
        position: NDArray[np.float64],
        orientation: NDArray[np.float64],
    ) -> None:
        """Publish a new environment as the next version.

        Parameters
        ----------
        camera : header of the frame it was seen in
        position, orientation : (3,) m and (4,) quaternion (x, y, z, w) of the camera in the
            environment's frame
        """
        self.version += 1
        self._environments.publish(
            environment_to_message(
                environment,
                stamp=camera.stamp,
                version=self.version,
                camera_frame_id=camera.frame_id,
                camera_pose=pose_to_message(position, orientation),
            )
        )
        if self._transforms is None:
            return
        from tf2_msgs.msg import TFMessage

        transform = transform_from_camera(environment.frame_id, camera, position, orientation)
        self._transforms.publish(TFMessage(transforms=[transform]))


def transform_from_camera(
    frame_id: str,
    camera: Header,
    position: NDArray[np.float64],
    orientation: NDArray[np.float64],
) -> TransformStamped:
    """Return the transform that hangs a frame below the camera's, which may have a parent already.

    Parameters
    ----------
    frame_id : of the frame
    camera : header in the camera's frame
    position, orientation : (3,) m and (4,) of the camera in the frame
    """
    inverse = np.asarray(orientation) * [-1.0, -1.0, -1.0, 1.0]
    transform = TransformStamped(header=camera, child_frame_id=frame_id)
    transform.transform.translation = vector_to_message(-rotation_matrix(inverse) @ position)
    transform.transform.rotation = quaternion_to_message(inverse)
    return transform
