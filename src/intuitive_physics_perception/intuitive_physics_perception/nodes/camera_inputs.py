"""Frames of all cameras, one after the other in the order of their stamps."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TypeAlias

from rclpy.node import Node

from intuitive_physics_perception.input.frame_order import FrameOrder
from intuitive_physics_perception.nodes.frame_input import INPUTS, Frame, FrameInput, UseFrame
from intuitive_physics_perception.nodes.frame_worker import FrameWorker
from intuitive_physics_ros.conversions import seconds_from_stamp
from intuitive_physics_ros.diagnostics import Diagnostics
from intuitive_physics_ros.lifecycle.kernel_loading import KernelLoading

WAITING = 3
"""Frames of each camera that may wait."""

NamedFrame: TypeAlias = tuple[str, Frame]


class CameraInputs:
    """Subscribes to all cameras and has their frames handled in a thread of its own.

    Parameters
    ----------
    node : that subscribes
    diagnostics : of the node
    cameras : names, of which the first is empty
    messages : value of the parameter `input`
    window : s that a frame waits at most for earlier ones of other cameras
    is_placed, rectified, color, row_time, kernels, use : as of `FrameInput`
    """

    def __init__(
        self,
        node: Node,
        diagnostics: Diagnostics,
        cameras: Sequence[str],
        messages: str,
        *,
        window: float,
        is_placed: bool,
        rectified: bool,
        color: bool,
        row_time: float,
        kernels: KernelLoading,
        use: UseFrame,
    ) -> None:
        self._order = FrameOrder[NamedFrame](tuple(cameras), window)
        several = len(cameras) > 1
        self._worker = FrameWorker[NamedFrame](
            self._take,
            WAITING * len(cameras),
            idle=self._flush if several else None,
            pause=window if several else None,
        )
        self._inputs = {
            camera: FrameInput(
                node,
                diagnostics,
                camera,
                INPUTS[messages],
                is_placed=is_placed,
                rectified=rectified,
                color=color,
                row_time=row_time,
                kernels=kernels,
                put=partial(self._put, camera),
                use=use,
            )
            for camera in cameras
        }

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

    def _put(self, camera: str, message: Frame) -> None:
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
