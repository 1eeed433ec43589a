"""Reading recordings of ROS 2 (MCAP and SQLite) and of ROS 1, with no ROS on the machine."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

from rosbags.interfaces import (
    ConnectionExtRosbag2,
    MessageDefinition,
    MessageDefinitionFormat,
    QosDurability,
    QosHistory,
)
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from intuitive_physics.errors import InvalidInputError, UnknownNameError
from intuitive_physics.limits import check_limit
from intuitive_physics_recordings.ros1_bag import SUFFIX as ROS1_SUFFIX
from intuitive_physics_recordings.ros1_bag import Ros1Reader

METADATA_FILE = "metadata.yaml"
"""File that makes a folder a rosbag2 recording."""

STORAGE_SUFFIXES = (".mcap", ".db3", ROS1_SUFFIX)
"""Endings of single files that are bags."""

EXPECTED = f"a bag's folder or a file that ends in {', '.join(STORAGE_SUFFIXES)}"
"""Description of a bag, for errors."""


@dataclass(frozen=True)
class BagTopic:
    """One topic of a bag.

    Parameters
    ----------
    name, type : such as "/camera/depth/image_rect_raw", "sensor_msgs/msg/Image"
    message_count : messages in the bag
    latched : whether it was offered as transient local
    depth : messages its publisher kept for late or slow subscribers; 0 where that is not recorded
    """

    name: str
    type: str
    message_count: int
    latched: bool
    depth: int = 0


@dataclass(frozen=True)
class BagMessage:
    """One message.

    Parameters
    ----------
    topic : name
    type : such as "sensor_msgs/msg/Image"
    time : ns since the epoch, when it was recorded
    data : CDR bytes
    """

    topic: str
    type: str
    time: int
    data: bytes


class BagReader:
    """A bag that is open; use it as a context manager.

    Parameters
    ----------
    path : a bag's folder, or one .mcap or .db3 file, or a .bag of ROS 1, whose messages come as
        those of ROS 2
    typestore : message types that can be decoded; None: ROS 2 Jazzy's own. Of a type that is not
        one of those, the definition in the bag goes before the one here: the messages were written
        by it

    Raises
    ------
    InvalidInputError
        When there is no bag, or it was cut short or damaged.
    """

    def __init__(self, path: str | Path, typestore: Typestore | None = None) -> None:
        self.path = Path(path)
        _check_is_bag(self.path)
        with self._readable():
            is_ros1 = self.path.suffix == ROS1_SUFFIX and self.path.is_file()
            self._reader: Any = Ros1Reader(self.path) if is_ros1 else Reader(str(self.path))
            self._reader.open()
        try:
            self._check_chunks()
        except InvalidInputError:
            self._reader.close()
            raise
        self._typestore = typestore or get_typestore(Stores.ROS2_JAZZY)
        self._recorded_types: dict[str, Typestore] = {}

    def __enter__(self) -> BagReader:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the files; the reader cannot be used any more."""
        self._reader.close()

    @property
    def topics(self) -> list[BagTopic]:
        """All topics, by name."""
        counts: dict[tuple[str, str], BagTopic] = {}
        for connection in self._reader.connections:
            key = (connection.topic, connection.msgtype)
            before = counts.get(key, BagTopic(*key, 0, False))
            latched, depth = _offered(connection.ext)
            counts[key] = BagTopic(
                *key,
                before.message_count + connection.msgcount,
                before.latched or latched,
                max(before.depth, depth),
            )
        return sorted(counts.values(), key=lambda topic: topic.name)

    @property
    def start_time(self) -> int:
        """Time of the first message, ns since the epoch."""
        return self._reader.start_time

    @property
    def duration(self) -> float:
        """Time in s from the first to the last message."""
        return max(self._reader.duration - 1, 0) * 1e-9

    def messages(
        self, topics: Sequence[str] | None = None, start_offset: float = 0.0
    ) -> Iterator[BagMessage]:
        """Yield messages in order of time.

        Parameters
        ----------
        topics : names; None means all
        start_offset : s after the bag's start before which messages are left out

        Raises
        ------
        UnknownNameError
            When a topic is not in the bag.
        InvalidInputError
            When the bag is damaged further on.
        """
        connections = self._reader.connections
        if topics is not None:
            present = {connection.topic for connection in connections}
            for name in topics:
                if name not in present:
                    raise UnknownNameError(
                        f"topic is {name!r}; the bag {self.path} has {', '.join(sorted(present))}"
                    )
            connections = [c for c in connections if c.topic in topics]
        if not connections:
            return
        start = self.start_time + round(start_offset * 1e9)
        with self._readable():
            for connection, time, data in self._reader.messages(connections, start=start):
                yield BagMessage(connection.topic, connection.msgtype, time, bytes(data))

    def decode(self, message: BagMessage) -> Any:
        """Return a message of a ROS 2 Jazzy type as an object with the message's fields.

        Raises
        ------
        InvalidInputError
            When the type is unknown or the bytes are not of it.
        """
        if message.type not in self._typestore.fielddefs:
            raise InvalidInputError(
                f"{message.topic} has the type {message.type}; expected one of ROS 2 Jazzy's own"
            )
        with self._readable():
            if message.type not in self._recorded_types:
                self._recorded_types[message.type] = self._types_of(message.type)
            return self._recorded_types[message.type].deserialize_cdr(message.data, message.type)

    def _check_chunks(self) -> None:
        """Check what the chunks of an MCAP file say they unpack to; SQLite has none."""
        # A folder's storage has one for each file; a file is its own.
        whole = getattr(self._reader, "storage", None)
        for storage in getattr(whole, "storages", [whole]):
            for chunk in getattr(storage, "chunks", ()):
                size = chunk.uncompressed_size
                check_limit("largest_unpacked", size, f"bytes of a chunk of the bag {self.path}")

    def _types_of(self, name: str) -> Typestore:
        """Types that a message type consists of, as the bag defines them where it does."""
        store = get_typestore(Stores.ROS2_JAZZY)
        if name in store.fielddefs:
            return self._typestore
        for connection in self._reader.connections:
            if connection.msgtype == name and _is_text(connection.msgdef):
                types = get_types_from_msg(connection.msgdef.data, name)
                store.register({k: v for k, v in types.items() if k not in store.fielddefs})
                return store
        return self._typestore

    @contextmanager
    def _readable(self) -> Iterator[None]:
        # rosbags lets errors of struct, zstd, lz4, SQLite and its own assertions through.
        try:
            yield
        except (InvalidInputError, GeneratorExit):
            raise
        except Exception as error:
            detail = str(error).strip() or type(error).__name__
            raise InvalidInputError(
                f"cannot read the bag {self.path}: {detail} It was cut short or damaged; "
                "expected a whole recording (`ros2 bag reindex`, of ROS 1 `rosbag reindex`, may "
                "repair it)"
            ) from None


def _check_is_bag(path: Path) -> None:
    if not path.exists():
        raise InvalidInputError(f"there is no bag {path}; expected {EXPECTED}")
    if path.is_dir():
        if not (path / METADATA_FILE).exists():
            raise InvalidInputError(
                f"folder {path} has no {METADATA_FILE}; expected the folder of a whole rosbag2 "
                "recording (`ros2 bag reindex` writes the file again)"
            )
    elif path.suffix not in STORAGE_SUFFIXES:
        raise InvalidInputError(f"{path} ends in {path.suffix or 'nothing'}; expected {EXPECTED}")


def _is_text(definition: MessageDefinition) -> bool:
    return definition.format == MessageDefinitionFormat.MSG


def _offered(extension: object) -> tuple[bool, int]:
    """Return whether any of a topic's publishers latched, and the largest depth of one."""
    profiles = extension.offered_qos_profiles if isinstance(extension, ConnectionExtRosbag2) else ()
    latched = any(qos.durability == QosDurability.TRANSIENT_LOCAL for qos in profiles)
    kept = [qos.depth for qos in profiles if qos.history == QosHistory.KEEP_LAST]
    return latched, max(kept, default=0)
