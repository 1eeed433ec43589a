"""Exported observations are what nodes send: ROS itself understands them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from intuitive_physics_msgs.msg import Observation as ObservationMessage
from rclpy.serialization import deserialize_message

from intuitive_physics.observation import Observation, ObservedObject
from intuitive_physics.scene import Environment, Plane, SceneObject, StaticBox
from intuitive_physics.shapes import Box, Capsule, Sphere
from intuitive_physics.state import ObjectState
from intuitive_physics.trajectory import Trajectory
from intuitive_physics_recordings.bag_reader import BagReader
from intuitive_physics_recordings.observation_bag import (
    read_observation_bag,
    write_observation_bag,
)
from intuitive_physics_ros.conversions import observation_from_message, observation_to_message


def observed() -> Observation:
    corners = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0]])
    environment = Environment(
        [Plane("table", "felt", [0, 0, 1], 0.0, corners)],
        [StaticBox("step", "stone", [1, 2, 0.1], [0, 0, 0.6, 0.8], [0.5, 0.4, 0.2])],
    )
    objects = tuple(
        ObservedObject(
            SceneObject(f"{k}", "cork", shape),
            Trajectory([12.5, 12.75], [[0.1 * k, 2.0, 3.0], [4.0, 5.0, 6.0]]),
            ObjectState([k, 0.0, 1.0], linear_velocity=[1.0, 2.0, 3.0], covariance=np.eye(12)),
        )
        for k, shape in enumerate((Sphere(0.05), Box((0.1, 0.2, 0.3)), Capsule(0.04, 0.2)))
    )
    return Observation(environment, objects, 12.25, "seen")


def test_ros_understands_what_was_exported(tmp_path: Path) -> None:
    bag = tmp_path / "observations.mcap"
    write_observation_bag([observed()], bag)
    with BagReader(bag) as reader:
        (message,) = reader.messages()
    as_ros = deserialize_message(message.data, ObservationMessage)
    assert as_ros == observation_to_message(observed())
    assert observation_from_message(as_ros).to_json() == observed().to_json()
    assert read_observation_bag(bag)[0].to_json() == observed().to_json()
