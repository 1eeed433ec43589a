"""Fixtures that tests of several packages use."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from tools.needs import RECORDINGS


@pytest.fixture(scope="session")
def recording() -> Callable[[str], Path]:
    """Path of a recording of others by its name; who uses it needs "recordings"."""
    return RECORDINGS.joinpath


@pytest.fixture(scope="session")
def write_chatter() -> Callable[[Path], None]:
    """Writes an SQLite bag of 200 strings on /chatter."""

    def write(path: Path) -> None:
        typestore = get_typestore(Stores.ROS2_JAZZY)
        string = typestore.types["std_msgs/msg/String"]
        with Writer(path, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
            connection = writer.add_connection("/chatter", string.__msgtype__, typestore=typestore)
            for i in range(200):
                data = typestore.serialize_cdr(string(data=f"hello {i}" * 50), string.__msgtype__)
                writer.write(connection, 10**18 + i, data)

    return write
