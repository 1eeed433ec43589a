"""ROS messages with no ROS on the machine: their types, made from the definitions themselves."""

from __future__ import annotations

from array import array
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

PACKAGE = "intuitive_physics_msgs/msg"
"""Where the names of this suite's message types begin."""

DEFINITIONS = Path(__file__).parent / "message_definitions"
"""Copies of the `.msg` files of the message package, which is not there without ROS."""


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


def message_maker(type_name: str) -> Callable[..., Any]:
    """Return what makes messages of a type from all their fields, as the library's mapping asks."""
    message_class = suite_typestore().types[type_name]

    def make(**fields: Any) -> Any:
        return message_class(
            **{
                name: np.array(value) if isinstance(value, array) else value
                for name, value in fields.items()
            }
        )

    return make
