"""Colour images beside depth images: which colours belong to which frame."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray
from rclpy.node import Node
from sensor_msgs.msg import Image
from std_msgs.msg import Header

from intuitive_physics.errors import IntuitivePhysicsError
from intuitive_physics_perception.input.frame_decoder import FrameDecoder
from intuitive_physics_ros.conversions import seconds_from_stamp
from intuitive_physics_ros.diagnostics import Diagnostics
from intuitive_physics_ros.input_monitor import InputMonitor
from intuitive_physics_ros.qos import SENSOR_DATA

TOPIC = "~/color/image"
TIMEOUT = 2.0
SAME_TIME = 0.01
"""s between stamps of a depth and a colour image of one frame: what is fast is elsewhere later."""

KEPT = 4
"""Newest colour images: those of frames that wait to be perceived."""


class ColorInput:
    """Hears colour images that are registered to the depth images: pixel by pixel the same rays.

    A frame whose colour image comes later than itself, or never, is perceived without colour.
    """

    def __init__(self, node: Node, diagnostics: Diagnostics) -> None:
        self._monitor = InputMonitor(node, TOPIC, TIMEOUT)
        self._newest: deque[tuple[float, NDArray[np.uint8]]] = deque(maxlen=KEPT)
        diagnostics.add(TOPIC.removeprefix("~/"), self._monitor.check)
        node.create_subscription(Image, TOPIC, self._on_image, SENSOR_DATA)

    def of_frame(self, header: Header, points: NDArray[np.float32]) -> NDArray[np.uint8] | None:
        """Return the colours (height, width, 3) of a frame of points, None where there are none."""
        time = seconds_from_stamp(header.stamp)
        for stamp, colors in list(self._newest):
            if abs(stamp - time) > SAME_TIME:
                continue
            if colors.shape != points.shape:
                self._monitor.rejected(
                    f"colour image has {colors.shape[1::-1]} pixels (width, height) and the depth "
                    f"image {points.shape[1::-1]}; expected one that is registered to it"
                )
                return None
            return colors
        return None

    def _on_image(self, message: Image) -> None:
        try:
            colors = FrameDecoder.image_colors(message)
        except IntuitivePhysicsError as error:
            self._monitor.rejected(error)
            return
        self._newest.append((seconds_from_stamp(message.header.stamp), colors))
        self._monitor.accepted()
