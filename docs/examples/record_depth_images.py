"""Record a depth camera as a bag: `read_depth_image` asks the camera for an image."""

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from intuitive_physics_recordings.depth_bag_writer import DepthBagWriter, PinholeCamera

CAMERA = PinholeCamera(width=640, height=480, focal_length=(460.0, 460.0), center=(319.5, 239.5))


def record(folder: Path, seconds: float, read_depth_image: Callable[[], np.ndarray]) -> None:
    """Write images (480, 640) uint16 in millimetres, 0 where there is no reading."""
    with DepthBagWriter(folder, CAMERA) as bag:
        end = time.time() + seconds
        while time.time() < end:
            bag.write(time.time_ns(), read_depth_image())
