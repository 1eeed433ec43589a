"""How much room there is for a database, on its disk and below its largest size."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from intuitive_physics.settings import check_settings, number

WAYS_OUT = (
    "delete observations, raise largest_database (a parameter of the node; --input-limit of the "
    "command), or take another database"
)
"""Advice to users whose database has its largest size."""

NEARLY = 0.9
"""Part of its largest size from which on a database is warned of."""


@dataclass(frozen=True)
class RoomSettings:
    """When a disk is warned of; our choice: hours of throws, and room for the write-ahead log."""

    least_free_space: int = number(
        500_000_000,
        0,
        1_000_000_000_000,
        "free space of a disk below which it is warned of; 0: never",
        unit="bytes",
    )

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True)
class Room:
    """Sizes at one moment.

    Parameters
    ----------
    path : of the database
    size : of its file, bytes
    free : on its disk, bytes
    largest : limit of its size, bytes; 0: none
    """

    path: Path
    size: int
    free: int
    largest: int

    def warning(self, least_free: int) -> str:
        """Return in one sentence what will soon be missing, and what to do; empty: nothing.

        `least_free` in bytes on the disk below which it is warned of.
        """
        if self.largest and self.size >= NEARLY * self.largest:
            return (
                f"{self.path} has {self.size} of at most {self.largest} bytes, beyond which no "
                f"observation is added; {WAYS_OUT}"
            )
        if self.free < least_free:
            return (
                f"the disk of {self.path} has {self.free} bytes free, expected at least "
                f"{least_free}; make room, or take a database on another disk"
            )
        return ""
