"""Input of the perception node: depth and colour images or clouds, from topics to points."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from functools import partial
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, PointCloud2
from std_msgs.msg import Header

from intuitive_physics.errors import IntuitivePhysicsError
from intuitive_physics_perception.input.frame_decoder import FrameDecoder
from intuitive_physics_perception.nodes.frame_worker import FrameWorker
from intuitive_physics_ros.conversions import seconds_from_stamp
from intuitive_physics_ros.diagnostics import Diagnostics, Level, Status
from intuitive_physics_ros.lifecycle.kernel_loading import KernelLoading
from intuitive_physics_ros.monitors import InputMonitor
from intuitive_physics_ros.qos import SENSOR_DATA, create_subscription
from intuitive_physics_ros.silence import Silence, launch_arguments
from intuitive_physics_ros.unexpected_errors import unexpected_errors

Frame: TypeAlias = Image | CompressedImage | PointCloud2
UseFrame: TypeAlias = Callable[[Header, NDArray[np.float32], NDArray[np.uint8] | None], str]

TOPICS: dict[type[Frame], str] = {
    Image: "~/depth/image",
    CompressedImage: "~/depth/image/compressedDepth",
    PointCloud2: "~/points",
}
"""Topic of each kind of frame; compressed images are where image_transport has them."""

LAUNCH_ARGUMENTS: dict[type[Frame], str] = {
    Image: "depth_image",
    CompressedImage: "depth_image",
    PointCloud2: "points",
}
"""Argument of the launch file that chooses the topic of each kind of frame."""

CAMERA_INFO = "~/depth/camera_info"
"""Topic of the depth camera's calibration."""

INPUTS: dict[str, tuple[type[Frame], ...]] = {
    "auto": (Image, PointCloud2),
    "depth": (Image,),
    "compressed": (CompressedImage,),
    "points": (PointCloud2,),
}
"""Messages that each value of the parameter `input` subscribes to."""

TIMEOUT = 2.0
"""Time in s without a message after which an input counts as lost. Set by hand."""

COLOR_TOPICS: dict[type[Frame], str] = {
    Image: "~/color/image",
    CompressedImage: "~/color/image/compressed",
}
"""Topic of colour images registered to the depth images, which are compressed if those are."""

SAME_TIME = 0.01
"""Maximum difference in s between the stamps of a depth and a colour image of one frame."""

KEPT = 4
"""Newest colour images that are kept: those of frames that wait to be processed."""


class FrameInput:
    """Subscribes to frames, decodes them in a thread of its own and reports their health.

    It subscribes once the kernels are loaded: who waits for subscribers before playing a recording
    may count on the first frame. `node` must spin for that.

    A frame that cannot be used is named in the log, not more than every 10 s for one reason, and
    on /diagnostics; the next one is tried again.

    Parameters
    ----------
    node : that subscribes
    diagnostics : of the node
    kinds : messages that are subscribed to; of several the one that is good first stays, as both
        show the same scene
    rectified : whether images are without distortion already
    color : whether to subscribe to colour images registered to the depth images
    kernels : of the perception of a frame
    use : called in the thread with header, points and colours of each frame, None for no colours;
        returns why it could not be used, empty when it could
    """

    def __init__(
        self,
        node: Node,
        diagnostics: Diagnostics,
        kinds: tuple[type[Frame], ...],
        *,
        rectified: bool,
        color: bool,
        kernels: KernelLoading,
        use: UseFrame,
    ) -> None:
        self._node = node
        self._log = node.get_logger()
        self._use = use
        self._decoder = FrameDecoder(rectified=rectified)
        self._kind: type[Frame] | None = None
        self._monitors: dict[type[Frame], InputMonitor] = {}
        for kind in kinds:
            self._monitors[kind] = InputMonitor(node, TOPICS[kind], TIMEOUT)
            diagnostics.add(TOPICS[kind].removeprefix("~/"), partial(self._check, kind))
        self._camera_monitor = InputMonitor(node, CAMERA_INFO, None)
        self._has_images = Image in kinds or CompressedImage in kinds
        if self._has_images:
            diagnostics.add(CAMERA_INFO.removeprefix("~/"), self._check_camera)
        self._color: ColorInput | None = None
        if color and self._has_images:
            color_kind = CompressedImage if CompressedImage in kinds else Image
            self._color = ColorInput(node, diagnostics, color_kind)
        self._worker: FrameWorker[Frame] = FrameWorker(self._handle)
        kernels.when_loaded(self._subscribe)

    @property
    def dropped(self) -> int:
        """Frames left out because newer ones came before they could be handled."""
        return self._worker.dropped

    def stop(self, patience: float) -> bool:
        """End the thread once the frame under way is done; return whether it has ended.

        `patience` in s to wait for it at most.
        """
        return self._worker.stop(patience)

    def _subscribe(self) -> None:
        self._expect()
        for kind in self._monitors:
            create_subscription(self._node, kind, TOPICS[kind], self._worker.put, SENSOR_DATA)
        if self._has_images:
            create_subscription(self._node, CameraInfo, CAMERA_INFO, self._on_camera, SENSOR_DATA)

    def _expect(self) -> None:
        """Have it said when nothing arrives on what is subscribed to now."""
        arguments = [LAUNCH_ARGUMENTS[kind] for kind in self._monitors]
        frames = {TOPICS[kind]: kind for kind in self._monitors}
        silence = Silence(self._node, frames, launch_arguments("camera", *arguments))
        for monitor in self._monitors.values():
            monitor.expect(silence)
        if self._has_images:
            remedy = launch_arguments("camera", "camera_info")
            self._camera_monitor.expect(Silence(self._node, {CAMERA_INFO: CameraInfo}, remedy))

    def _on_camera(self, message: CameraInfo) -> None:
        try:
            self._decoder.take_camera(message)
        except IntuitivePhysicsError as error:
            self._camera_monitor.rejected(error)
        else:
            self._camera_monitor.accepted()

    def _handle(self, message: Frame) -> None:
        """Decode and use one frame; runs in the worker's thread."""
        if self._kind is not None and type(message) is not self._kind:
            return
        monitor = self._monitors[type(message)]
        try:
            points, colors = self._decoded(message)
            if self._kind is None:
                self._kind = type(message)
                self._log.info(f"perceives {self._kind.__name__} messages")
            problem = self._use(message.header, points, colors)
        except IntuitivePhysicsError as error:
            problem = str(error)
        except Exception as error:
            # A thread that dies would take all perception with it.
            problem = unexpected_errors(self._node).report(error, "a frame")
        if problem:
            monitor.rejected(problem)
        else:
            monitor.accepted()

    def _decoded(self, message: Frame) -> tuple[NDArray[np.float32], NDArray[np.uint8] | None]:
        """Points of a frame, and their colours where they are known."""
        if isinstance(message, PointCloud2):
            return self._decoder.cloud_points(message), self._decoder.cloud_colors(message)
        if isinstance(message, CompressedImage):
            points = self._decoder.compressed_image_points(message)
        else:
            points = self._decoder.image_points(message)
        if self._color is None:
            return points, None
        return points, self._color.of_frame(message.header, points)

    def _check(self, kind: type[Frame]) -> Status:
        if self._kind is not None and kind is not self._kind:
            return Status(Level.OK, f"not used: {self._kind.__name__} messages came first")
        return self._monitors[kind].check()

    def _check_camera(self) -> Status:
        if self._kind is PointCloud2:
            return Status(Level.OK, "not used: PointCloud2 messages came first")
        return self._camera_monitor.check()


class ColorInput:
    """Subscribes to colour images that are registered to the depth images pixel by pixel.

    A frame whose colour image comes later than itself, or never, is processed without colour.

    Parameters
    ----------
    node : that subscribes
    diagnostics : of the node
    kind : Image or CompressedImage
    """

    def __init__(
        self, node: Node, diagnostics: Diagnostics, kind: type[Image | CompressedImage]
    ) -> None:
        self._monitor = InputMonitor(node, COLOR_TOPICS[kind], TIMEOUT)
        self._newest: deque[tuple[float, NDArray[np.uint8]]] = deque(maxlen=KEPT)
        diagnostics.add(COLOR_TOPICS[kind].removeprefix("~/"), self._monitor.check)
        create_subscription(node, kind, COLOR_TOPICS[kind], self._on_image, SENSOR_DATA)
        topics = {COLOR_TOPICS[kind]: kind}
        self._monitor.expect(Silence(node, topics, launch_arguments("camera", "color")))

    def of_frame(self, header: Header, points: NDArray[np.float32]) -> NDArray[np.uint8] | None:
        """Return the colours (height, width, 3) of a frame, None where there are none.

        `points` (height, width, 3) m.
        """
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

    def _on_image(self, message: Image | CompressedImage) -> None:
        is_compressed = isinstance(message, CompressedImage)
        decode = (
            FrameDecoder.compressed_image_colors if is_compressed else FrameDecoder.image_colors
        )
        try:
            colors = decode(message)
        except IntuitivePhysicsError as error:
            self._monitor.rejected(error)
            return
        self._newest.append((seconds_from_stamp(message.header.stamp), colors))
        self._monitor.accepted()
