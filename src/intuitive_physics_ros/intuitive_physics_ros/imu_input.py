"""Samples of an IMU, in the frame of another sensor."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray
from rclpy.node import Node
from sensor_msgs.msg import Imu

from intuitive_physics.errors import IntuitivePhysicsError, InvalidInputError
from intuitive_physics.geometry.rotations import rotation_matrix
from intuitive_physics.messages.geometry import xyz
from intuitive_physics_ros.conversions import seconds_from_stamp
from intuitive_physics_ros.monitors import InputMonitor
from intuitive_physics_ros.qos import SENSOR_DATA, create_subscription
from intuitive_physics_ros.silence import Silence, launch_arguments
from intuitive_physics_ros.transforms import Transforms, UnknownTransformError

Sample = Callable[[float, NDArray[np.float64], NDArray[np.float64] | None], None]

TIMEOUT = 2.0
"""s without a message after which the input counts as lost."""


class ImuInput:
    """Subscribes to an IMU and hands on each sample, turned into the frame of another sensor.

    The rotation between the two frames is the one given, none where they have one name, else it is
    looked up in tf where tf2_ros is installed.

    Parameters
    ----------
    node : that subscribes
    topic : of sensor_msgs/Imu
    target_frame : returns the name of the other sensor's frame, empty while it is not known
    on_sample : called with time in s, acceleration (3,) in m/s² and angular velocity (3,) in
        rad/s, None where it is not measured; what it raises of ours is reported
    orientation : (4,) quaternion (x, y, z, w) of the IMU in the other sensor's frame; None: looked
        up
    """

    def __init__(
        self,
        node: Node,
        topic: str,
        target_frame: Callable[[], str],
        on_sample: Sample,
        orientation: NDArray[np.float64] | None = None,
    ) -> None:
        self.monitor = InputMonitor(node, topic, TIMEOUT)
        self._target_frame = target_frame
        self._on_sample = on_sample
        self._orientation = orientation
        self._transforms: Transforms | None = None
        if orientation is None:
            # Where IMU and camera share a frame nothing has to be looked up.
            with suppress(InvalidInputError):
                self._transforms = Transforms(node)
        create_subscription(node, Imu, topic, self._on_message, SENSOR_DATA)
        self.monitor.expect(Silence(node, {topic: Imu}, launch_arguments("camera", "imu")))

    def _on_message(self, message: Imu) -> None:
        target = self._target_frame()
        if not target and self._orientation is None:
            return
        try:
            turn = rotation_matrix(self._orientation_in(target, message.header.frame_id))
            # By definition of the message -1 says that there is no such measurement.
            has_gyroscope = message.angular_velocity_covariance[0] != -1.0
            if message.linear_acceleration_covariance[0] == -1.0:
                raise InvalidInputError(
                    "IMU says that it measures no acceleration; expected one that does"
                )
            self._on_sample(
                seconds_from_stamp(message.header.stamp),
                turn @ xyz(message.linear_acceleration),
                turn @ xyz(message.angular_velocity) if has_gyroscope else None,
            )
        except IntuitivePhysicsError as error:
            self.monitor.rejected(error)
        else:
            self.monitor.accepted()

    def _orientation_in(self, target: str, source: str) -> NDArray[np.float64]:
        if self._orientation is not None:
            return self._orientation
        if source == target:
            return np.array([0.0, 0.0, 0.0, 1.0])
        if self._transforms is None:
            raise InvalidInputError(
                f"IMU is in the frame {source!r} and the camera in {target!r}; expected one frame, "
                "tf2_ros to look up the rotation between them, or the parameter imu_orientation"
            )
        try:
            return self._transforms.lookup(target, source).orientation
        except UnknownTransformError as error:
            raise InvalidInputError(
                f"{error}, or the parameter imu_orientation for the rotation from the IMU's frame "
                "to the camera's"
            ) from None
