"""One frame of a recording, with what perception sees in it, for the report's picture."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.observation import Observation
from intuitive_physics_experiments.demo.demo_result import ExampleFrame
from intuitive_physics_experiments.rendering.camera import Camera
from intuitive_physics_perception.environment.environment_model import model_environment
from intuitive_physics_perception.input.camera import Intrinsics
from intuitive_physics_perception.input.depth import depth_from_image_data, points_from_depth
from intuitive_physics_perception.settings import PerceptionSettings
from intuitive_physics_recordings.bag_reader import BagReader
from intuitive_physics_recordings.depth_bag_writer import DEPTH_TOPIC

HEIGHT_SHOWN = 0.25
"""m; the frame shown is one in which the ball is well above the floor."""


def example_frame(
    bag: Path,
    observation: Observation,
    camera: Camera,
    rotation: NDArray[np.float64],
    translation: NDArray[np.float64],
) -> ExampleFrame:
    """Take the frame of a throw in which the ball flies, with the planes in view.

    Rotation (3, 3) and translation (3,) m lead from the sensor to the environment.
    """
    seen = observation.objects[0]
    track = seen.trajectory
    flying = np.flatnonzero(track.positions[:, 2] > HEIGHT_SHOWN)
    shown = int(flying[len(flying) // 2]) if flying.size else 0
    depths = depth_images(bag)
    settings = PerceptionSettings()
    rays = Intrinsics(camera.width, camera.height, camera.matrix()).rays()
    first = [points_from_depth(next(depths)[1], rays) for _ in range(settings.environment_frames)]
    model = model_environment(first, settings, np.random.default_rng(0))
    depth = next(image for time, image in depths if time > track.times[shown] - 1e-3)
    return ExampleFrame(
        depth=depth.copy(),
        camera_matrix=camera.matrix(),
        rotation=rotation,
        translation=translation,
        environment=observation.environment,
        plane_outlines=tuple(plane.corners @ rotation.T + translation for plane in model.detected),
        sphere_center=track.positions[shown],
        sphere_radius=seen.object.shape.bounding_radius,
        track=track.positions,
    )


def depth_images(bag: Path) -> Iterator[tuple[float, NDArray[Any]]]:
    """Yield time (s) and depth image (height, width) of each frame of a bag."""
    with BagReader(bag) as reader:
        for message in reader.messages([DEPTH_TOPIC]):
            image = reader.decode(message)
            stamp = image.header.stamp.sec + 1e-9 * image.header.stamp.nanosec
            yield (
                stamp,
                depth_from_image_data(
                    image.data,
                    width=image.width,
                    height=image.height,
                    encoding=image.encoding,
                    step=image.step,
                    is_bigendian=bool(image.is_bigendian),
                ),
            )
