"""A depth camera without an end: rendered throws again and again, until it is closed."""

from __future__ import annotations

import threading
import time
from contextlib import ExitStack
from pathlib import Path

from rosgraph_msgs.msg import Clock

from benchmarks.running_nodes import RATE, SECOND, DepthPublisher, recorded_images
from intuitive_physics_experiments.rendering.rendered_bag import RenderSettings, render_bag
from intuitive_physics_recordings.bag_reader import BagReader
from intuitive_physics_ros.scripting import Peer

# In a round, and s without a ball after each: something can be predicted nearly always
THROWS, PAUSE = 6, 0.1


class EndlessCamera(ExitStack):
    """Publishes the images of a rendered bag in a thread, in rounds, until it is closed.

    The bag is made in the folder where it does not exist. With a clock, the time of each image is
    published on /clock too, for nodes whose parameter `use_sim_time` is set.
    """

    def __init__(self, folder: Path, seed: int, *, has_clock: bool = False) -> None:
        super().__init__()
        bag = folder / f"throws_{seed}"
        if not bag.exists():
            render_bag(bag, RenderSettings(throws=THROWS, seed=seed, frame_rate=RATE, pause=PAUSE))
        with BagReader(bag) as reader:
            self._images = [pair for _, pair in recorded_images(reader)]
        peer = self.enter_context(Peer("camera"))
        self._publisher = DepthPublisher(peer)
        self._clock = peer.node.create_publisher(Clock, "/clock", 1) if has_clock else None
        self._closed = threading.Event()
        self._is_on = threading.Event()
        self._is_on.set()
        self.frames = 0
        self._offset = 0.0
        thread = threading.Thread(target=self._run, name="camera", daemon=True)
        thread.start()
        self.callback(thread.join)
        self.callback(self._closed.set)

    def unplug(self) -> None:
        """Publish nothing from this moment on."""
        self._is_on.clear()

    def plug_in(self) -> None:
        """Publish again."""
        self._is_on.set()

    def jump(self, seconds: float) -> None:
        """Let the time of stamps and clock jump."""
        self._offset += seconds

    @property
    def time(self) -> float:
        """Stamp of an image that is published at this moment, s since the epoch."""
        return time.time() + self._offset

    def _run(self) -> None:
        due = time.monotonic()
        while not self._closed.is_set():
            if not self._is_on.wait(0.1):
                continue
            now = round(self.time * SECOND)
            if self._clock is not None:
                message = Clock()
                message.clock.sec, message.clock.nanosec = divmod(now, SECOND)
                self._clock.publish(message)
            self._publisher.publish(self._images[self.frames % len(self._images)], now)
            self.frames += 1
            due = max(due + 1.0 / RATE, time.monotonic() - 1.0)
            self._closed.wait(max(0.0, due - time.monotonic()))
