"""The nodes, and the topics of the cameras that they are connected to.

The nodes meet by the relative names of `intuitive_physics_ros.topics`; nothing connects them. They
look for others on this machine only, unless they are configured otherwise.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from dataclasses import dataclass

from intuitive_physics.errors import InvalidInputError
from intuitive_physics_ros.topics import (
    ENVIRONMENT,
    OBJECT_STATES,
    OBSERVATIONS,
    PREDICTIONS,
    STATIC_PARAMETERS,
)

NODES: dict[str, str] = {
    "perception_node": "intuitive_physics_perception",
    "learner_node": "intuitive_physics_learner",
    "predictor_node": "intuitive_physics_predictor",
}
"""Package of each node; node, executable and module (in `nodes/`) have the same name."""


@dataclass(frozen=True)
class Camera:
    """Topics of a camera's driver; relative ones, so that a namespace holds its own camera.

    Parameters
    ----------
    depth_image, camera_info : depth images and their intrinsics
    points : clouds
    imu : samples of its IMU
    color : colour images that are registered to the depth images
    registered_depth_image, registered_camera_info : depth images to which `color` is registered,
        where these are others; empty: the same
    """

    depth_image: str
    camera_info: str
    points: str
    imu: str
    color: str
    registered_depth_image: str = ""
    registered_camera_info: str = ""

    def topics(self, *, color: bool = False) -> dict[str, str]:
        """Return the topic for each input of the perception node, by the input's name.

        Parameters
        ----------
        color : whether depth and colour must be registered to each other
        """
        depth, info = self.depth_image, self.camera_info
        if color:
            depth = self.registered_depth_image or depth
            info = self.registered_camera_info or info
        return {
            "~/depth/image": depth,
            "~/depth/camera_info": info,
            "~/points": self.points,
            "~/imu": self.imu,
            "~/color/image": self.color,
        }

    def further_topics(self, namespace: str, *, color: bool = False) -> dict[str, str]:
        """Return the topic for each input of a further camera of the same driver, by its name.

        Parameters
        ----------
        namespace : of its topics, in place of the one that all topics here begin with
        color : as in `topics`
        """
        topics = self.topics(color=color)
        del topics["~/imu"]
        own = os.path.commonpath(list(topics.values()))
        name = camera_name(namespace)
        return {
            key.replace("~/", f"~/{name}/"): f"{namespace}/{topic[len(own) :].lstrip('/')}"
            for key, topic in with_compressed(topics).items()
        }


def camera_name(namespace: str) -> str:
    """Return the name that the perception node gives to a further camera by its namespace."""
    return namespace.strip("/").replace("/", "_")


TRANSPORTS = {"~/depth/image": "/compressedDepth", "~/color/image": "/compressed"}
"""Ends of the topics on which image_transport publishes the same images compressed."""


def with_compressed(topics: Mapping[str, str]) -> dict[str, str]:
    """Return the topic for each input, and those of the same images compressed."""
    compressed = {name + below: topics[name] + below for name, below in TRANSPORTS.items()}
    return {**topics, **compressed}


CAMERAS: dict[str, Camera] = {
    "realsense": Camera(
        depth_image="camera/camera/depth/image_rect_raw",
        camera_info="camera/camera/depth/camera_info",
        points="camera/camera/depth/color/points",
        imu="camera/camera/imu",
        color="camera/camera/color/image_raw",
        registered_depth_image="camera/camera/aligned_depth_to_color/image_raw",
        registered_camera_info="camera/camera/aligned_depth_to_color/camera_info",
    ),
    "zed": Camera(
        depth_image="zed/zed_node/depth/depth_registered",
        camera_info="zed/zed_node/depth/camera_info",
        points="zed/zed_node/point_cloud/cloud_registered",
        imu="zed/zed_node/imu/data",
        color="zed/zed_node/rgb/color/rect/image",
    ),
    "azure_kinect": Camera(
        depth_image="depth/image_raw",
        camera_info="depth/camera_info",
        points="points2",
        imu="imu",
        color="rgb_to_depth/image_raw",
    ),
    "generic": Camera(
        depth_image="camera/depth/image_rect_raw",
        camera_info="camera/depth/camera_info",
        points="camera/depth/color/points",
        imu="camera/imu",
        color="camera/color/image_raw",
    ),
}
"""Cameras by the value of the launch argument `camera`: realsense2_camera since 4.54,
zed_wrapper 5, azure_kinect_ros_driver, and topics without a name of the camera, as bags of this
suite have them."""


def clock_rules(prefix: str, *, replayed: bool) -> list[tuple[str, str]]:
    """Return the remapping rules for simulated time below a namespace.

    A bag's replay has a clock below the namespace, so that each robot's bag has its own; the clock
    of a simulator is one for all.
    """
    return [("/clock", f"{prefix}/clock")] if prefix and replayed else []


def session_topics(
    camera: Camera, namespace: str = "", *, color: bool = False, clouds: bool = False
) -> list[str]:
    """Return the topics from which a session can be reproduced and compared.

    Topics of the camera and of frames are all that perception needs; the others are its results.

    Parameters
    ----------
    camera : whose topics are recorded
    namespace : of the robot; empty: none
    color : whether colour images are recorded, and the depth images that are registered to them
    clouds : whether point clouds are recorded instead of depth images
    """
    inputs = camera.topics(color=color)
    unused = ["~/depth/image", "~/depth/camera_info"] if clouds else ["~/points"]
    if not color:
        unused.append("~/color/image")
    inputs_recorded = [topic for name, topic in inputs.items() if name not in unused]
    outputs = [ENVIRONMENT, OBJECT_STATES, OBSERVATIONS, STATIC_PARAMETERS, PREDICTIONS]
    prefix = f"/{namespace.strip('/')}" if namespace.strip("/") else ""
    return [
        *(f"{prefix}/{topic}" for topic in (*inputs_recorded, *outputs)),
        "/tf",
        "/tf_static",
        "/diagnostics",
    ]


def module(node: str) -> str:
    """Return the Python module whose `main` runs a node."""
    return f"{NODES[node]}.nodes.{node}"


RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
"""Variable of the environment with the range in which nodes are found by themselves."""

PEERS = "ROS_STATIC_PEERS"
"""Variable of the environment with the machines that are looked for wherever they are."""

RANGES = ("localhost", "subnet", "off", "system_default")
"""Values of the range; `system_default` leaves it to the middleware's own configuration."""

ADDRESS = re.compile(r"[A-Za-z0-9:]([A-Za-z0-9.:-]*[A-Za-z0-9:])?")
"""A host name or an address of IPv4 or IPv6."""


def default_range() -> str:
    """Return what the environment says, else this machine."""
    return os.environ.get(RANGE, "").lower() or RANGES[0]


def default_peers() -> str:
    """Return what the environment says, else none."""
    return os.environ.get(PEERS, "")


def discovery_environment(wanted: str, peers: str) -> Mapping[str, str]:
    """Return the variables with which a node finds others.

    Parameters
    ----------
    wanted : one of `RANGES`, in small or capital letters
    peers : addresses, divided by `;`; empty for none

    Raises
    ------
    InvalidInputError
        When one of them is something else, or peers are named where they would not be used.
    """
    if wanted.lower() not in RANGES:
        raise InvalidInputError(f"discovery is {wanted!r}; expected one of {', '.join(RANGES)}")
    addresses = [address.strip() for address in peers.split(";") if address.strip()]
    for address in addresses:
        if not ADDRESS.fullmatch(address):
            raise InvalidInputError(
                f"peers has {address!r}; expected host names or addresses, divided by ;"
            )
    if addresses and wanted.lower() in ("off", "system_default"):
        raise InvalidInputError(
            f"peers is {peers!r} and discovery {wanted!r}, which looks for none of them; expected "
            "discovery localhost or subnet"
        )
    return {RANGE: wanted.upper(), PEERS: ";".join(addresses)}
