"""Which topic of which node is heard by which: said once, for all that start them.

And where nodes look for others: on this machine, unless something else is said.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping

from intuitive_physics.errors import InvalidInputError

NODES: dict[str, str] = {
    "perception_node": "intuitive_physics_perception",
    "learner_node": "intuitive_physics_learner",
    "predictor_node": "intuitive_physics_predictor",
}
"""Package of each node; node, executable and module (in `nodes/`) have the same name."""

_HEARD: dict[str, dict[str, str]] = {
    "perception_node": {},
    "learner_node": {"~/observation": "perception_node/observation"},
    "predictor_node": {
        "~/environment": "perception_node/environment",
        "~/object_states": "perception_node/object_states",
        "~/static_parameters": "learner_node/static_parameters",
    },
}
"""Topics that a node subscribes to, by the names of their publishers."""

CAMERA_TOPICS: dict[str, str] = {
    "~/depth/image": "/camera/depth/image_rect_raw",
    "~/depth/camera_info": "/camera/depth/camera_info",
    "~/points": "/camera/depth/color/points",
    "~/imu": "/camera/imu",
}
"""Topics of the perception node's inputs; these are what common depth cameras publish."""


def remappings(node: str) -> list[tuple[str, str]]:
    """Return (from, to) of each topic a node hears from another node of the suite."""
    return list(_HEARD[node].items())


def module(node: str) -> str:
    """Return the Python module whose `main` runs a node."""
    return f"{NODES[node]}.nodes.{node}"


RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
"""Variable of the environment with the range in which nodes are found by themselves."""

PEERS = "ROS_STATIC_PEERS"
"""Variable of the environment with the machines that are looked for wherever they are."""

RANGES = ("localhost", "subnet", "off", "system_default")
"""What the range may be; `system_default` leaves it to the middleware's own configuration."""

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
    addresses = [one.strip() for one in peers.split(";") if one.strip()]
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
