"""Publishes an environment, latched, and the place of its frame in the tree of frames."""

from __future__ import annotations

from geometry_msgs.msg import TransformStamped
from intuitive_physics_msgs.msg import Environment as EnvironmentMessage
from rclpy.node import Node
from rclpy.publisher import Publisher
from std_msgs.msg import Header

from intuitive_physics.frames.change_of_frame import RigidTransform
from intuitive_physics.scene import Environment
from intuitive_physics_ros.conversions import environment_to_message
from intuitive_physics_ros.conversions.primitives import (
    pose_to_message,
    quaternion_to_message,
    vector_to_message,
)
from intuitive_physics_ros.qos import LATCHED, create_publisher
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
        self._environments = create_publisher(node, EnvironmentMessage, ENVIRONMENT, LATCHED)
        try:
            from tf2_msgs.msg import TFMessage
        except ImportError:
            self._transforms = None
        else:
            self._transforms = node.create_publisher(TFMessage, "/tf_static", LATCHED)

    @property
    def publishers(self) -> list[Publisher]:
        """Its publishers, for `farewell`."""
        return [each for each in (self._environments, self._transforms) if each is not None]

    def destroy(self) -> None:
        """Take back what it published last."""
        for publisher in self.publishers:
            self._node.destroy_publisher(publisher)

    def publish(
        self, environment: Environment, *, camera: Header, camera_pose: RigidTransform
    ) -> None:
        """Publish a new environment as the next version.

        `camera` is the header of the frame it was perceived in, `camera_pose` the pose of the
        camera in the environment's frame.
        """
        self.version += 1
        self._environments.publish(
            environment_to_message(
                environment,
                stamp=camera.stamp,
                version=self.version,
                camera_frame_id=camera.frame_id,
                camera_pose=pose_to_message(camera_pose.translation, camera_pose.orientation),
            )
        )

    def hang(self, frame_id: str, parent: Header, parent_pose: RigidTransform) -> None:
        """Publish where a frame hangs below its parent, where tf2_msgs is installed.

        `parent_pose` is the pose of the parent, such as the camera, in the frame.
        """
        if self._transforms is None:
            return
        from tf2_msgs.msg import TFMessage

        transform = transform_from_parent(frame_id, parent, parent_pose)
        self._transforms.publish(TFMessage(transforms=[transform]))


def transform_from_parent(
    frame_id: str, parent: Header, parent_pose: RigidTransform
) -> TransformStamped:
    """Return the transform that hangs a frame below one that may have a parent itself.

    `parent_pose` is the pose of the upper frame in this one.
    """
    inverse = parent_pose.inverse
    transform = TransformStamped(header=parent, child_frame_id=frame_id)
    transform.transform.translation = vector_to_message(inverse.translation)
    transform.transform.rotation = quaternion_to_message(inverse.orientation)
    return transform
