"""Reading ROS 1 recordings (.bag) as if they were ROS 2's: types of ROS 2 Jazzy, in CDR."""

from __future__ import annotations

from bz2 import BZ2Decompressor
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from lz4.frame import LZ4FrameDecompressor
from rosbags.interfaces import (
    Connection,
    ConnectionExtRosbag1,
    ConnectionExtRosbag2,
    Nodetype,
)
from rosbags.rosbag1 import Reader
from rosbags.rosbag1.reader import Compression, decompressors
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.limits import check_limit
from intuitive_physics_recordings.bag_writing import offered_qos

SUFFIX = ".bag"
"""Ending of a ROS 1 recording, one file."""

RENAMED = {"tf/msg/tfMessage": "tf2_msgs/msg/TFMessage"}
"""Types of ROS 1 that have another name in ROS 2."""


UNPACKERS: dict[Callable[[bytes], bytes], Callable[[], Any]] = {
    decompressors[Compression.BZ2.value]: BZ2Decompressor,
    decompressors[Compression.LZ4.value]: LZ4FrameDecompressor,
}
"""Decompressors that work piece by piece, by the function that does it at once."""

PIECE = 16_000_000
"""Bytes that are unpacked at once. Our choice."""


class Ros1Reader:
    """A ROS 1 bag, read as `rosbags.rosbag2.Reader` reads one of ROS 2; of topics whose type ROS 2
    has not, nothing is read.

    Parameters
    ----------
    path : of the file

    Raises
    ------
    InvalidInputError
        When a chunk of messages unpacks to more than the limit.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._reader = Reader(path)
        self._types = get_typestore(Stores.ROS2_JAZZY)
        self.connections: list[Connection] = []
        self._recorded: dict[int, Connection] = {}
        self._recorded_types: dict[str, Typestore] = {}

    def open(self) -> None:
        """Read what the file says of its messages."""
        self._reader.open()
        for recorded in self._reader.connections:
            name = RENAMED.get(recorded.msgtype, recorded.msgtype)
            if name in self._types.fielddefs:
                latched = isinstance(recorded.ext, ConnectionExtRosbag1) and recorded.ext.latching
                offered = [offered_qos(1, transient_local=True)] if latched else []
                self._recorded[recorded.id] = recorded
                self.connections.append(
                    recorded._replace(msgtype=name, ext=ConnectionExtRosbag2("cdr", offered))
                )
        for at, chunk in self._reader.chunks.items():
            unpacker = UNPACKERS.get(chunk.decompressor)
            if unpacker is not None:
                bounded = partial(unpacked, unpacker, self._path)
                self._reader.chunks[at] = chunk._replace(decompressor=bounded)

    def close(self) -> None:
        """Close the file."""
        self._reader.close()

    @property
    def start_time(self) -> int:
        """Time of the first message, ns since the epoch."""
        return self._reader.start_time

    @property
    def duration(self) -> int:
        """Time in ns from the first to the last message, and one more."""
        return self._reader.duration

    def messages(
        self, connections: Sequence[Connection], start: int
    ) -> Iterator[tuple[Connection, int, memoryview]]:
        """Yield messages from a time (ns since the epoch) on as bytes of CDR, in order of time."""
        asked = {connection.id: connection for connection in connections}
        recorded = [self._recorded[number] for number in asked]
        for connection, time, data in self._reader.messages(recorded, start=start):
            message = self._types_of(connection).deserialize_ros1(data, connection.msgtype)
            name = asked[connection.id].msgtype
            as_ros2 = _as_ros2(message, name, self._types)
            yield asked[connection.id], time, self._types.serialize_cdr(as_ros2, name)

    def _types_of(self, connection: Connection) -> Typestore:
        """Types that a message consists of, as the bag defines them."""
        name = connection.msgtype
        if name not in self._recorded_types:
            store = get_typestore(Stores.EMPTY)
            store.register(get_types_from_msg(connection.msgdef.data, name))
            self._recorded_types[name] = store
        return self._recorded_types[name]


def _as_ros2(message: Any, name: str, types: Typestore) -> Any:
    """Return a message as the type that ROS 2 has by that name.

    ROS 2 has lowercase names where ROS 1 has K or D, and no number in a header.
    """
    given = {field.lower(): value for field, value in vars(message).items()}
    values: dict[str, Any] = {}
    for field, (kind, detail) in types.fielddefs[name][1]:
        value = given[field.lower()]
        if kind == Nodetype.NAME:
            value = _as_ros2(value, str(detail), types)
        elif kind != Nodetype.BASE and detail[0][0] == Nodetype.NAME:
            value = [_as_ros2(item, str(detail[0][1]), types) for item in value]
        values[field] = value
    return types.types[name](**values)


def unpacked(unpacker: Callable[[], Any], path: Path, data: bytes) -> bytes:
    """Unpack a chunk of a bag piece by piece; refuse it when it is too large or cut short."""
    unpack, pieces, size = unpacker(), [], 0
    while not unpack.eof:
        piece = unpack.decompress(data, PIECE)
        if not piece and unpack.needs_input:
            raise InvalidInputError(
                f"a chunk of the bag {path} ends too soon; expected a whole one: it was cut short"
            )
        data = b""
        pieces.append(piece)
        size += len(piece)
        check_limit("largest_unpacked", size, f"bytes of a chunk of the bag {path}")
    return b"".join(pieces)
