"""Observations as an MCAP file that `ros2 bag` plays and Foxglove opens.

They are ROS messages and not JSON: played on a robot, they are what perception would have
published, and the learner that hears them stores them. The file holds the message definitions, so
it can be read where this suite is not installed.
"""

from __future__ import annotations

import tempfile
from array import array
from collections.abc import Callable, Iterable
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.messages.geometry import stamp_nanoseconds
from intuitive_physics.messages.observation import (
    observation_from_message,
    observation_to_message,
)
from intuitive_physics.observation import Observation
from intuitive_physics.scene import SceneObject
from intuitive_physics_recordings.bag_reader import BagReader
from intuitive_physics_recordings.bag_writing import mcap_writer, offered_qos

PACKAGE = "intuitive_physics_msgs/msg"
"""Beginning of the names of this suite's message types."""

DEFINITIONS = Path(__file__).parent / "message_definitions"
"""Copies of the `.msg` files of the message package, which is not there without ROS."""

OBSERVATION_TYPE = f"{PACKAGE}/Observation"
"""Name of the message type."""

SUFFIX = ".mcap"
"""Ending of a file of observations."""

TOPIC = "/intuitive_physics/observations"
"""Topic on which perception publishes observations and the learner subscribes to them."""

QUEUE = 100
"""Observations kept for those who subscribe late."""


def write_observation_bag(observations: Iterable[Observation], path: Path) -> None:
    """Write observations into one MCAP file, in order of time; it appears whole or not at all.

    Times are kept to a nanosecond.

    Raises
    ------
    InvalidInputError
        When the file cannot be written, or an observation has what its message has no field for.
    """
    ordered = sorted(observations, key=lambda observation: observation.start_time)
    messages = [_stamped_message(observation) for observation in ordered]
    store = suite_typestore()
    try:
        with tempfile.TemporaryDirectory(prefix=f".{path.name}-", dir=path.parent) as folder:
            bag = Path(folder) / path.stem
            with mcap_writer(bag) as writer:
                connection = writer.add_connection(
                    TOPIC,
                    OBSERVATION_TYPE,
                    typestore=store,
                    offered_qos_profiles=[offered_qos(QUEUE, transient_local=True)],
                )
                for stamp, message in messages:
                    data = store.serialize_cdr(message, OBSERVATION_TYPE)
                    writer.write(connection, stamp, data)
            (written,) = bag.glob(f"*{SUFFIX}")
            written.replace(path)
    except OSError as error:
        raise InvalidInputError(f"cannot write {path}: {error.strerror}") from None


def read_observation_bag(path: Path) -> list[Observation]:
    """Read all observations of a bag, on whatever topics they were recorded.

    Raises
    ------
    InvalidInputError
        When there is no bag, it is damaged, or has no observation.
    """
    with BagReader(path, suite_typestore()) as reader:
        topics = [topic.name for topic in reader.topics if topic.type == OBSERVATION_TYPE]
        observations = [
            _from_message(reader.decode(message)) for message in reader.messages(topics)
        ]
    if not observations:
        raise InvalidInputError(
            f"{path} has no message of the type {OBSERVATION_TYPE}; expected recorded observations"
        )
    return observations


def _stamped_message(observation: Observation) -> tuple[int, Any]:
    """Start in ns since the epoch of its clock, and the message."""
    start = stamp_nanoseconds(observation.start_time, f"observation {observation.id} starts at")
    for observed in observation.objects:
        item = observed.object
        if item != SceneObject(item.id, item.material, item.shape):
            raise InvalidInputError(
                f"object {item.id} has a drag or Magnus coefficient or an inertia factor, for "
                "which the message has no field; keep its observation as JSON"
            )
    return start, observation_to_message(observation, message_maker)


def _from_message(message: Any) -> Observation:
    try:
        return observation_from_message(message)
    except (AttributeError, ValueError) as error:
        raise InvalidInputError(
            f"message is no observation of this version: {error}; "
            f"expected the fields of {OBSERVATION_TYPE}"
        ) from None


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
