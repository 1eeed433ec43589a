"""Writers of bags: MCAP, compressed in chunks, with a quality of service for each topic."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

BAG_VERSION: Final = 9
"""Version of the bag's metadata, that of ROS 2 Jazzy."""

ENDLESS = QosTime(9223372036, 854775807)
"""The longest duration there is, 2⁶³ − 1 ns: no deadline, lifespan or lease."""


def mcap_writer(path: Path) -> Writer:
    """Return a writer of a bag in a new folder, which is not open yet."""
    writer = Writer(path, version=BAG_VERSION, storage_plugin=StoragePlugin.MCAP)
    # Chunks, not messages: other MCAP readers know only compressed chunks.
    writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    return writer


def offered_qos(depth: int, *, transient_local: bool = False) -> Qos:
    """Return a reliable quality of service that keeps `depth` messages for subscribers."""
    durability = QosDurability.TRANSIENT_LOCAL if transient_local else QosDurability.VOLATILE
    return Qos(
        QosHistory.KEEP_LAST,
        depth,
        QosReliability.RELIABLE,
        durability,
        ENDLESS,
        ENDLESS,
        QosLiveliness.AUTOMATIC,
        ENDLESS,
        False,
    )
