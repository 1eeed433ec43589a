"""Input of the perception node: depth and colour images or clouds, from topics to points."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, PointCloud2
from std_msgs.msg import Header

from intuitive_physics.errors import IntuitivePhysicsError, InvalidInputError
from intuitive_physics_perception.input.colors import colors_of_cloud, colors_of_image
from intuitive_physics_perception.input.compressed import colors_from_compressed_data
from intuitive_physics_perception.input.frame_decoder import FrameDecoder
from intuitive_physics_perception.input.point_cloud import points_of_cloud
from intuitive_physics_perception.input.reading_times import times_of_cloud, times_of_rows
from intuitive_physics_ros.conversions import seconds_from_stamp
from intuitive_physics_ros.diagnostics import Diagnostics, Level, Status
from intuitive_physics_ros.lifecycle.kernel_loading import KernelLoading
from intuitive_physics_ros.monitors import InputMonitor
from intuitive_physics_ros.qos import SENSOR_DATA, create_subscription
from intuitive_physics_ros.silence import Silence, launch_arguments
from intuitive_physics_ros.unexpected_errors import unexpected_errors

Frame: TypeAlias = Image | CompressedImage | PointCloud2


@dataclass(frozen=True, eq=False)
class DecodedFrame:
    """What a camera has read.

    Parameters
    ----------
    camera : its name, empty for the first
    header : of the message
    points : (height, width, 3) m in the camera's frame
    colors : (height, width, 3) red, green and blue; None where they are not known
    offsets : (height, width) s, time of each reading after the stamp; None where all have its time
    """

    camera: str
    header: Header
    points: NDArray[np.float32]
    colors: NDArray[np.uint8] | None
    offsets: NDArray[np.float32] | None


UseFrame: TypeAlias = Callable[[DecodedFrame], str]

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


def topic_of(camera: str, topic: str) -> str:
    """Return one of the topics above of a camera by its name, empty for the first."""
    return topic.replace("~/", f"~/{camera}/") if camera else topic


class FrameInput:
    """Subscribes to the frames of one camera, decodes them and reports their health.

    It subscribes once the kernels are loaded: who waits for subscribers before playing a recording
    may count on the first frame. `node` must spin for that.

    A frame that cannot be used is named in the log, not more than every 10 s for one reason, and
    on /diagnostics; the next one is tried again.

    Parameters
    ----------
    node : that subscribes
    diagnostics : of the node
    camera : its name, empty for the first
    put : called with each message that arrives; hands it over to a thread that calls `handle`
    kinds : messages that are subscribed to; of several the one that is good first stays, as both
        show the same scene
    is_placed : whether tf has where each camera is
    rectified : whether images are without distortion already
    color : whether to subscribe to colour images registered to the depth images
    row_time : from row to row of an image, s, as in `times_of_rows`
    kernels : of the perception of a frame
    use : called in that thread with each frame; returns why it could not be used, else nothing
    """

    def __init__(
        self,
        node: Node,
        diagnostics: Diagnostics,
        camera: str,
        put: Callable[[Frame], None],
        *,
        kinds: tuple[type[Frame], ...],
        is_placed: bool,
        rectified: bool,
        color: bool,
        row_time: float,
        kernels: KernelLoading,
        use: UseFrame,
    ) -> None:
        self._node = node
        self._log = node.get_logger()
        self._camera = camera
        self._is_placed = is_placed
        self._row_time = row_time
        self._put, self._use = put, use
        self._info_topic = topic_of(camera, CAMERA_INFO)
        self._decoder = FrameDecoder(rectified=rectified, camera_info=self._info_topic)
        self._kind: type[Frame] | None = None
        self._frame_id = ""
        self._topics = {kind: topic_of(camera, TOPICS[kind]) for kind in kinds}
        self._monitors: dict[type[Frame], InputMonitor] = {}
        for kind, topic in self._topics.items():
            self._monitors[kind] = InputMonitor(node, topic, TIMEOUT)
            diagnostics.add(topic.removeprefix("~/"), partial(self._check, kind))
        self._camera_monitor = InputMonitor(node, self._info_topic, None)
        self._has_images = Image in kinds or CompressedImage in kinds
        if self._has_images:
            diagnostics.add(self._info_topic.removeprefix("~/"), self._check_camera)
        self._color: ColorInput | None = None
        if color and self._has_images:
            color_kind = CompressedImage if CompressedImage in kinds else Image
            self._color = ColorInput(node, diagnostics, camera, color_kind)
        kernels.when_loaded(self._subscribe)

    def _subscribe(self) -> None:
        """Subscribe, and have it said when nothing arrives."""
        node, camera = self._node, self._camera
        frames = {topic: kind for kind, topic in self._topics.items()}
        silence = Silence(
            node, frames, self._remedy(*(LAUNCH_ARGUMENTS[kind] for kind in self._topics))
        )
        for kind, monitor in self._monitors.items():
            monitor.expect(silence)
            create_subscription(node, kind, topic_of(camera, TOPICS[kind]), self._put, SENSOR_DATA)
        if self._has_images:
            info = {self._info_topic: CameraInfo}
            self._camera_monitor.expect(Silence(node, info, self._remedy("camera_info")))
            create_subscription(
                node, CameraInfo, topic_of(camera, CAMERA_INFO), self._on_camera, SENSOR_DATA
            )

    def _remedy(self, *arguments: str) -> str:
        return launch_arguments(
            "further_cameras" if self._camera else "camera", *(() if self._camera else arguments)
        )

    def _on_camera(self, message: CameraInfo) -> None:
        try:
            self._decoder.take_camera(message)
        except IntuitivePhysicsError as error:
            self._camera_monitor.rejected(error)
        else:
            self._camera_monitor.accepted()

    def handle(self, message: Frame) -> None:
        """Decode and use one frame; runs in the thread of perception."""
        if self._kind is not None and type(message) is not self._kind:
            return
        monitor = self._monitors[type(message)]
        try:
            frame = self._decoded(self._camera_of(message), message)
            if self._kind is None:
                self._kind, self._frame_id = type(message), message.header.frame_id
                of = f" of camera {self._camera}" if self._camera else ""
                self._log.info(f"perceives {self._kind.__name__} messages{of}")
            problem = self._use(frame)
        except IntuitivePhysicsError as error:
            problem = str(error)
        except Exception as error:
            # A thread that dies would take all perception with it.
            problem = unexpected_errors(self._node).report(error, "a frame")
        if problem:
            monitor.rejected(problem)
        else:
            monitor.accepted()

    def _camera_of(self, message: Frame) -> str:
        """Name of the camera that a message is from: clouds of another frame are those of a camera
        elsewhere, where tf has it."""
        frame_id = message.header.frame_id
        if self._kind is None or frame_id == self._frame_id:
            return self._camera
        if self._is_placed and isinstance(message, PointCloud2):
            return f"{self._camera}/{frame_id}"
        raise InvalidInputError(
            f"frame_id is {frame_id!r:.80}; expected {self._frame_id!r:.80} as in all before: do "
            "two cameras publish on one topic? Give each its own (parameter further_cameras); "
            "deactivate and activate perception if one camera has replaced another"
        )

    def _decoded(self, camera: str, message: Frame) -> DecodedFrame:
        """Points of a frame, their colours and times."""
        header, decoder = message.header, self._decoder
        if isinstance(message, PointCloud2):
            points, colors = points_of_cloud(message), colors_of_cloud(message)
            return DecodedFrame(camera, header, points, colors, times_of_cloud(message))
        if isinstance(message, CompressedImage):
            points = decoder.compressed_image_points(message)
        else:
            points = decoder.image_points(message)
        colors = self._color.of_frame(header, points) if self._color is not None else None
        height, width = points.shape[:2]
        offsets = times_of_rows(height, width, self._row_time) if self._row_time else None
        return DecodedFrame(camera, header, points, colors, offsets)

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
    camera : its name, empty for the first
    kind : Image or CompressedImage
    """

    def __init__(
        self, node: Node, diagnostics: Diagnostics, camera: str, kind: type[Image | CompressedImage]
    ) -> None:
        topic = topic_of(camera, COLOR_TOPICS[kind])
        self._monitor = InputMonitor(node, topic, TIMEOUT)
        self._newest: deque[tuple[float, NDArray[np.uint8]]] = deque(maxlen=KEPT)
        diagnostics.add(topic.removeprefix("~/"), self._monitor.check)
        create_subscription(
            node, kind, topic_of(camera, COLOR_TOPICS[kind]), self._on_image, SENSOR_DATA
        )
        self._monitor.expect(Silence(node, {topic: kind}, launch_arguments("camera", "color")))

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
        try:
            if isinstance(message, CompressedImage):
                colors = colors_from_compressed_data(message.data)
            else:
                colors = colors_of_image(message)
        except IntuitivePhysicsError as error:
            self._monitor.rejected(error)
            return
        self._newest.append((seconds_from_stamp(message.header.stamp), colors))
        self._monitor.accepted()
