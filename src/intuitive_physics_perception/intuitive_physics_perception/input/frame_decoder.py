"""From images to frames of points, whoever read the messages: rclpy or a reader of bags.

Nothing here imports ROS: a message is anything with the attributes of its type.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics_perception.input.camera import Intrinsics
from intuitive_physics_perception.input.compressed import depth_from_compressed_data
from intuitive_physics_perception.input.depth import check_size, depth_of_image, points_from_depth


class _Camera:
    """A camera with the rays of its pixels, made when they are first asked for."""

    def __init__(self, intrinsics: Intrinsics) -> None:
        self.intrinsics = intrinsics

    @cached_property
    def rays(self) -> NDArray[np.float32]:
        return self.intrinsics.rays()


class FrameDecoder:
    """Decodes sensor_msgs/Image and CompressedImage with the newest CameraInfo.

    Parameters
    ----------
    rectified : whether images are without distortion already, so that the camera matrix is that
        of P instead of K
    camera_info : topic of CameraInfo, as errors name it
    """

    def __init__(
        self, *, rectified: bool = False, camera_info: str = "~/depth/camera_info"
    ) -> None:
        self._rectified = rectified
        self._camera_info = camera_info
        self._key: tuple[Any, ...] = ()
        self._camera: _Camera | None = None

    def take_camera(self, info: Any) -> None:
        """Take a CameraInfo for the images that follow; returns at once.

        Raises
        ------
        InvalidInputError
            When it describes no camera; images go on with the one before.
        """
        matrix = np.reshape(info.p, (3, 4))[:, :3] if self._rectified else info.k
        distortion = () if self._rectified else tuple(info.d)
        roi = info.roi
        window = (roi.x_offset, roi.y_offset, roi.width, roi.height)
        binning = (info.binning_x, info.binning_y)
        size = (info.width, info.height)
        key = (*size, *np.ravel(matrix), distortion, info.distortion_model, *window, *binning)
        if key == self._key:
            return
        camera = Intrinsics(*size, matrix, distortion, info.distortion_model)
        self._camera = _Camera(_windowed(camera, window, binning))
        self._key = key

    def image_points(self, image: Any) -> NDArray[np.float32]:
        """Return the frame of points (height, width, 3) of a depth Image.

        Raises
        ------
        InvalidInputError
            When it is no depth image, its data do not fit its header, or no fitting CameraInfo
            came before it.
        """
        return self._points(depth_of_image(image))

    def compressed_image_points(self, image: Any) -> NDArray[np.float32]:
        """Return the frame of points (height, width, 3) of a CompressedImage of the transport
        compressedDepth.

        Raises
        ------
        InvalidInputError
            As `image_points`.
        """
        return self._points(depth_from_compressed_data(image.data, image.format))

    def _points(self, depth: NDArray[Any]) -> NDArray[np.float32]:
        camera = self._camera
        if camera is None:
            raise InvalidInputError(
                f"depth images arrive without a CameraInfo on {self._camera_info}; "
                "expected one: publish it or remap the topic"
            )
        # Asked first, so that a wrong CameraInfo alone costs neither time nor memory.
        intrinsics = camera.intrinsics
        check_size(depth.shape[1], depth.shape[0], intrinsics.width, intrinsics.height)
        return points_from_depth(depth, camera.rays)


def _windowed(
    camera: Intrinsics, window: tuple[int, int, int, int], binning: tuple[int, int]
) -> Intrinsics:
    """Return the camera of the part of its image that a CameraInfo says is sent."""
    left, top, width, height = window
    # By definition of the message, zeros mean the whole image and no binning.
    joined = {max(1, n) for n in binning}
    width, height = width or camera.width - left, height or camera.height - top
    if len(joined) > 1 or left + width > camera.width or top + height > camera.height:
        raise InvalidInputError(
            f"camera of {camera.width} x {camera.height} pixels has the region of interest "
            f"{window} (left, top, width, height) and the binning {binning}; expected a region "
            "within it, and equal binning along x and y"
        )
    return camera.part(left=left, top=top, width=width, height=height, binning=joined.pop())
