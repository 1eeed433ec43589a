"""Playing a bag in time: when each message and each tick of the clock is due. Knows no ROS."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.validation import finite_float, positive_float
from intuitive_physics_recordings.bag_reader import BagMessage, BagReader

CLOCK_RATE = 100.0
"""Hz of real time at most: faster clocks cost every subscriber much of a core."""

NANOSECONDS = 1e-9
"""s in a nanosecond."""


@dataclass(frozen=True)
class ReplaySettings:
    """Settings of a replay.

    Parameters
    ----------
    rate : bag seconds in one real second
    loop : whether to start again at the end
    start_offset : s of the bag left out at its start
    """

    rate: float = 1.0
    loop: bool = False
    start_offset: float = 0.0

    def __post_init__(self) -> None:
        positive_float(self.rate, "rate")
        if finite_float(self.start_offset, "start offset") < 0.0:
            raise InvalidInputError(
                f"start offset is {self.start_offset:g} s; expected 0 or more seconds"
            )


class Replay:
    """One bag being played; `run` belongs in a thread of its own.

    Parameters
    ----------
    bag : an open bag
    topics : names of the topics to play
    settings : how
    publish : takes each message when it is due
    publish_clock : takes bag time in ns, at most `CLOCK_RATE` times a second; None where no clock
        is wanted
    now : s of a clock that never goes back
    wait : waits for a number of seconds and returns whether to stop; None makes `stop` do it

    Raises
    ------
    InvalidInputError
        When the start offset lies beyond the end.
    """

    def __init__(
        self,
        bag: BagReader,
        topics: Sequence[str],
        settings: ReplaySettings,
        publish: Callable[[BagMessage], None],
        publish_clock: Callable[[int], None] | None = None,
        *,
        now: Callable[[], float] = time.monotonic,
        wait: Callable[[float], bool] | None = None,
    ) -> None:
        if settings.start_offset > bag.duration:
            raise InvalidInputError(
                f"start offset is {settings.start_offset:g} s and the bag {bag.path} lasts "
                f"{bag.duration:g} s; expected an offset within the bag"
            )
        self._bag = bag
        self._topics = list(topics)
        self._settings = settings
        self._publish = publish
        self._publish_clock = publish_clock
        self._now = now
        self._stop = threading.Event()
        self._wait = self._stop.wait if wait is None else wait
        self._next_tick = -float("inf")
        self._bag_origin = bag.start_time + round(settings.start_offset / NANOSECONDS)
        self._position = settings.start_offset

    @property
    def position(self) -> float:
        """Bag time in s after the bag's start that was played last."""
        return self._position

    def stop(self) -> None:
        """Make `run` return soon; may be called from any thread."""
        self._stop.set()

    def run(self) -> bool:
        """Play to the end, again and again when looping; return False when stopped before.

        Raises
        ------
        InvalidInputError
            When the bag turns out to be damaged.
        """
        self._play_latched_before_start()
        while self._play_once():
            if not self._settings.loop:
                return True
        return False

    def _play_latched_before_start(self) -> None:
        """Publish the newest latched messages from before the start, for late subscribers."""
        latched = [t.name for t in self._bag.topics if t.latched and t.name in self._topics]
        if not latched or self._settings.start_offset == 0.0:
            return
        newest: dict[str, BagMessage] = {}
        for message in self._bag.messages(latched):
            if message.time >= self._bag_origin:
                break
            newest[message.topic] = message
        for message in newest.values():
            self._publish(message)

    def _play_once(self) -> bool:
        wall_origin = self._now()
        for message in self._bag.messages(self._topics, self._settings.start_offset):
            due = (message.time - self._bag_origin) * NANOSECONDS / self._settings.rate
            if not self._wait_until(wall_origin + due, wall_origin):
                return False
            self._position = (message.time - self._bag.start_time) * NANOSECONDS
            self._tick(self._now(), message.time)
            self._publish(message)
        return not self._stop.is_set()

    def _wait_until(self, due: float, wall_origin: float) -> bool:
        while True:
            if self._stop.is_set():
                return False
            now = self._now()
            if now >= due:
                return True
            elapsed = (now - wall_origin) * self._settings.rate
            self._tick(now, self._bag_origin + round(elapsed / NANOSECONDS))
            tick = self._next_tick if self._publish_clock is not None else float("inf")
            if self._wait(max(min(due, tick) - now, 0.0)):
                return False

    def _tick(self, now: float, bag_time: int) -> None:
        """Publish bag time in ns where the clock is due."""
        if self._publish_clock is not None and now >= self._next_tick:
            self._publish_clock(bag_time)
            self._next_tick = now + 1.0 / CLOCK_RATE
