"""Frames of several cameras in the order of their stamps, whenever they arrive, and whether time
goes back."""

from __future__ import annotations

from collections import deque
from collections.abc import Hashable
from typing import Generic, TypeVar

import numpy as np

Frame = TypeVar("Frame")

SILENT = 0.5
"""Time, s, by which a camera's newest frame is behind those of others when nobody waits for it any
more. Set by hand: a camera of 5 Hz may drop a frame."""

RESTART = 1.0
"""Time, s, by which a stamp is earlier than those before when time itself has gone back, as in a
bag that is played again. Set by hand: no driver is as late."""

INTERVALS = 5
"""Newest intervals of a camera of which the shortest shows when its next frame is due."""

SOONEST = 0.7
"""Part of that interval after which the next frame may come. Set by hand: stamps jitter."""


class Timeline:
    """Notices that time goes back, by the times of the frames of all sensors.

    The stamps of each sensor increase. Frames of several come in any order that their readings
    explain: one that lasts, as a LiDAR's scan does, may have begun before others that have come
    already, but none ends before another one that has come began.

    `newest_begin`: s, the latest time at which a frame that has come began.
    """

    def __init__(self) -> None:
        self._stamps: dict[str, float] = {}
        self.newest_begin = -np.inf

    def has(self, sensor: str, stamp: float) -> bool:
        """Return whether the newest frame of a sensor has this stamp, s."""
        return self._stamps.get(sensor) == stamp

    def goes_back(self, sensor: str, stamp: float, first: float, last: float) -> bool:
        """Take the next frame; return whether time has gone back before it.

        `stamp` in s; `first` and `last`: of its readings, s after the stamp.
        """
        # The stamp is a time of the frame even where its first or last rays met nothing.
        begin, end = stamp + min(first, 0.0), stamp + max(last, 0.0)
        back = stamp < self._stamps.get(sensor, -np.inf) or end < self.newest_begin
        if back:
            self._stamps, self.newest_begin = {}, -np.inf
        self._stamps[sensor] = stamp
        self.newest_begin = max(self.newest_begin, begin)
        return back


class FrameOrder(Generic[Frame]):
    """Holds frames back until no other camera can bring an earlier one, for a bounded time.

    With one camera all frames pass at once.

    Parameters
    ----------
    cameras : names of all that bring frames
    window : s by which the newest stamp may be later than that of a frame that is held back
    """

    def __init__(self, cameras: tuple[Hashable, ...], window: float) -> None:
        self.late = 0
        self._window = window
        self._newest = dict.fromkeys(cameras, -np.inf)
        self._intervals = {camera: deque[float](maxlen=INTERVALS) for camera in cameras}
        self._held: list[tuple[float, Frame]] = []
        self._passed = -np.inf

    def put(self, camera: Hashable, time: float, frame: Frame) -> list[Frame]:
        """Take a frame with the time of its stamp, s; return those that are due, in their order.

        One that is earlier than what has passed is counted in `late` and left out.
        """
        if len(self._newest) == 1:
            return [frame]
        before: list[Frame] = []
        if time < max(self._newest.values()) - RESTART:
            before = self.flush()
            self._newest = dict.fromkeys(self._newest, -np.inf)
            self._passed = -np.inf
        if time > self._newest[camera]:
            if np.isfinite(self._newest[camera]):
                self._intervals[camera].append(time - self._newest[camera])
            self._newest[camera] = time
        if time < self._passed:
            self.late += 1
            return before
        self._held.append((time, frame))
        self._held.sort(key=lambda item: item[0])
        return before + self._due()

    def flush(self) -> list[Frame]:
        """Return all that is held back, in its order, as when nothing more comes."""
        return self._pass_until(np.inf)

    def _due(self) -> list[Frame]:
        newest = max(self._newest.values())
        awaited = [
            self._next_of(camera) for camera, t in self._newest.items() if t > newest - SILENT
        ]
        return self._pass_until(max(newest - self._window, min(awaited)))

    def _next_of(self, camera: Hashable) -> float:
        """Earliest time, s, at which a camera's next frame may be."""
        intervals = self._intervals[camera]
        return self._newest[camera] + (SOONEST * min(intervals) if intervals else 0.0)

    def _pass_until(self, time: float) -> list[Frame]:
        due = [item for item in self._held if item[0] <= time]
        del self._held[: len(due)]
        if due:
            self._passed = due[-1][0]
        return [frame for _, frame in due]
