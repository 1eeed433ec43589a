"""Frames of all cameras, one after the other in the order of their stamps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

from intuitive_physics_perception.input.frame_order import FrameOrder
from intuitive_physics_perception.nodes.frame_input import Frame, FrameInput
from intuitive_physics_perception.nodes.frame_worker import FrameWorker
from intuitive_physics_ros.conversions import seconds_from_stamp

WAITING = 3
"""Frames of each camera that may wait."""

NamedFrame: TypeAlias = tuple[str, Frame]


class CameraInputs:
    """Has the frames of all cameras handled in a thread of its own.

    Parameters
    ----------
    cameras : names, of which the first is empty
    window : s that a frame waits at most for earlier ones of other cameras
    """

    def __init__(self, cameras: Sequence[str], window: float) -> None:
        self._order = FrameOrder[NamedFrame](tuple(cameras), window)
        several = len(cameras) > 1
        self._worker = FrameWorker[NamedFrame](
            self._take,
            WAITING * len(cameras),
            idle=self._flush if several else None,
            pause=window if several else None,
        )
        self._inputs: dict[str, FrameInput] = {}

    def add(self, camera: str, frames: FrameInput) -> None:
        """Have the messages of a camera, which are given to `put`, handled by its input."""
        self._inputs[camera] = frames

    @property
    def dropped(self) -> int:
        """Frames left out because newer ones came before they could be handled."""
        return self._worker.dropped

    @property
    def late(self) -> int:
        """Frames left out because later ones of other cameras had been handled already."""
        return self._order.late

    def stop(self, patience: float) -> bool:
        """End the thread once the frame under way is done; return whether it has ended.

        `patience` in s to wait for it at most.
        """
        return self._worker.stop(patience)

    def put(self, camera: str, message: Frame) -> None:
        """Take a message of a camera and return at once."""
        self._worker.put((camera, message))

    def _take(self, item: NamedFrame) -> None:
        """Handle the frames that are due; runs in the worker's thread."""
        camera, message = item
        time = float(seconds_from_stamp(message.header.stamp))
        self._handle(self._order.put(camera, time, item))

    def _flush(self) -> None:
        self._handle(self._order.flush())

    def _handle(self, items: Sequence[NamedFrame]) -> None:
        for camera, message in items:
            self._inputs[camera].handle(message)
