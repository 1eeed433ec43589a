"""Writing bags (MCAP), which `ros2 bag play` plays too; depth images with their camera."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Connection
from rosbags.typesys import Stores, get_typestore

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.validation import finite_array, name_string
from intuitive_physics_recordings.bag_writing import mcap_writer, offered_qos

DEPTH_TOPIC = "/camera/depth/image_rect_raw"
"""Topic of the images, named as camera drivers do."""

CAMERA_INFO_TOPIC = "/camera/depth/camera_info"
"""Topic of the camera's size and matrix, beside the images."""

QUEUE = 5
"""Messages kept for a slow subscriber."""


class DepthCamera(Protocol):
    """A pinhole camera without distortion, as a bag describes it.

    Parameters
    ----------
    width, height : pixels
    frame_id : optical frame: z forward, x right
    """

    @property
    def width(self) -> int: ...

    @property
    def height(self) -> int: ...

    @property
    def frame_id(self) -> str: ...

    def matrix(self) -> NDArray[np.float64]:
        """Return K, (3, 3) pixels."""


@dataclass(frozen=True)
class PinholeCamera:
    """A camera of rectified images, such as a depth camera's driver or SDK describes it.

    Parameters
    ----------
    width, height : pixels
    focal_length : (f_x, f_y) pixels
    center : (c_x, c_y) pixels, the principal point
    frame_id : optical frame: z forward, x right
    """

    width: int
    height: int
    focal_length: tuple[float, float]
    center: tuple[float, float]
    frame_id: str = "camera_depth_optical_frame"

    def __post_init__(self) -> None:
        if self.width < 1 or self.height < 1:
            raise InvalidInputError(
                f"image is {self.width} × {self.height} pixels; expected at least 1 × 1"
            )
        focal_length = finite_array(self.focal_length, "focal length", (2,))
        if (focal_length <= 0.0).any():
            raise InvalidInputError(f"focal length is {self.focal_length} pixels; expected > 0")
        finite_array(self.center, "principal point", (2,))
        name_string(self.frame_id, "frame")

    def matrix(self) -> NDArray[np.float64]:
        """Return K, (3, 3) pixels."""
        (f_x, f_y), (c_x, c_y) = self.focal_length, self.center
        return np.array([[f_x, 0.0, c_x], [0.0, f_y, c_y], [0.0, 0.0, 1.0]])


class DepthBagWriter:
    """A bag being written; use it as a context manager, which completes the bag at its end.

    Parameters
    ----------
    path : folder to make; it must not exist
    camera : of all images
    """

    def __init__(self, path: Path, camera: DepthCamera) -> None:
        if path.exists():
            raise InvalidInputError(f"{path} exists already; expected a new folder for the bag")
        self._typestore = get_typestore(Stores.ROS2_JAZZY)
        self._types = self._typestore.types
        self._camera = camera
        self._writer = mcap_writer(path)
        try:
            self._writer.open()
        except OSError as error:
            raise InvalidInputError(f"cannot write {path}: {error.strerror}") from None
        self._image_connection = self._add_topic(DEPTH_TOPIC, "sensor_msgs/msg/Image")
        self._info_connection = self._add_topic(CAMERA_INFO_TOPIC, "sensor_msgs/msg/CameraInfo")

    def __enter__(self) -> DepthBagWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is None:
            self._writer.close()
        else:
            self._writer.abort()

    def write(self, time: int, image: NDArray[np.uint16]) -> None:
        """Append one image with its camera info.

        Parameters
        ----------
        time : ns since the epoch
        image : (height, width) millimetres, 0 where there is no reading
        """
        expected = (self._camera.height, self._camera.width)
        if image.shape != expected or image.dtype != np.uint16:
            raise InvalidInputError(
                f"image has shape {image.shape} of {image.dtype}; expected {expected} of uint16"
            )
        header = self._header(time)
        info, depth = self._camera_info(header), self._image(header, image)
        for connection, message in ((self._info_connection, info), (self._image_connection, depth)):
            data = self._typestore.serialize_cdr(message, connection.msgtype)
            self._writer.write(connection, time, data)

    def _add_topic(self, topic: str, type_name: str) -> Connection:
        return self._writer.add_connection(
            topic, type_name, typestore=self._typestore, offered_qos_profiles=[offered_qos(QUEUE)]
        )

    def _header(self, time: int) -> Any:
        seconds, nanoseconds = divmod(time, 1_000_000_000)
        stamp = self._types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=nanoseconds)
        return self._types["std_msgs/msg/Header"](stamp=stamp, frame_id=self._camera.frame_id)

    def _image(self, header: Any, image: NDArray[np.uint16]) -> Any:
        little_endian = np.ascontiguousarray(image, dtype="<u2")
        return self._types["sensor_msgs/msg/Image"](
            header=header,
            height=self._camera.height,
            width=self._camera.width,
            encoding="16UC1",
            is_bigendian=0,
            step=2 * self._camera.width,
            data=little_endian.view(np.uint8).ravel(),
        )

    def _camera_info(self, header: Any) -> Any:
        matrix = self._camera.matrix()
        region = self._types["sensor_msgs/msg/RegionOfInterest"](
            x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
        )
        return self._types["sensor_msgs/msg/CameraInfo"](
            header=header,
            height=self._camera.height,
            width=self._camera.width,
            distortion_model="plumb_bob",
            d=np.zeros(5),
            k=matrix.ravel(),
            r=np.eye(3).ravel(),
            p=np.column_stack([matrix, np.zeros(3)]).ravel(),
            binning_x=0,
            binning_y=0,
            roi=region,
        )
