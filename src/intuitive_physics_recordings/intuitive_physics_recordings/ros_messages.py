"""ROS messages with no ROS on the machine: their types, made from the definitions themselves."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

PACKAGE = "intuitive_physics_msgs/msg"
"""Where the names of this suite's message types begin."""

DEFINITIONS = Path(__file__).parent / "message_definitions"
"""The `.msg` files of the message package: a link in the sources, copies where installed."""


@lru_cache(maxsize=1)
def suite_typestore() -> Typestore:
    """ROS 2 Jazzy's own types and those of this suite."""
    store = get_typestore(Stores.ROS2_JAZZY)
    types: dict[str, Any] = {}
    for path in sorted(DEFINITIONS.glob("*.msg")):
        text = path.read_text(encoding="utf-8")
        types.update(get_types_from_msg(text, f"{PACKAGE}/{path.stem}"))
    store.register(types)
    return store


def suite_types() -> dict[str, Any]:
    """Message classes of this suite by their names."""
    return {
        name.rpartition("/")[2]: made
        for name, made in suite_typestore().types.items()
        if name.startswith(PACKAGE)
    }


def new_message(type_name: str, **fields: Any) -> Any:
    """Return a message of a type from all its fields."""
    return suite_typestore().types[type_name](**fields)


def _named(numbers: ArrayLike) -> dict[str, float]:
    return dict(zip("xyzw", np.asarray(numbers, dtype=np.float64).tolist(), strict=False))


def vector_message(numbers: ArrayLike) -> Any:
    """Return numbers (3,) as a message."""
    return new_message("geometry_msgs/msg/Vector3", **_named(numbers))


def point_message(numbers: ArrayLike) -> Any:
    """Return a point as a message.

    Parameters
    ----------
    numbers : (3,) m
    """
    return new_message("geometry_msgs/msg/Point", **_named(numbers))


def pose_message(position: ArrayLike = (0, 0, 0), orientation: ArrayLike = (0, 0, 0, 1)) -> Any:
    """Return a position (3,) in m and an orientation (x, y, z, w) as a message."""
    return new_message(
        "geometry_msgs/msg/Pose",
        position=point_message(position),
        orientation=new_message("geometry_msgs/msg/Quaternion", **_named(orientation)),
    )


def xyz(message: Any) -> tuple[float, float, float]:
    """Return the numbers of a vector or point."""
    return message.x, message.y, message.z


def xyzw(message: Any) -> tuple[float, float, float, float]:
    """Return the numbers of a quaternion."""
    return message.x, message.y, message.z, message.w
