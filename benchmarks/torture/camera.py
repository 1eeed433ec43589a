"""A depth camera without an end: rendered throws again and again, as long as somebody looks."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType

from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, Image

from benchmarks.perception.end_to_end import recorded_images, with_stamp
from intuitive_physics_experiments.rendering.rendered_bag import RenderSettings, render_bag
from intuitive_physics_recordings.bag_reader import BagMessage, BagReader
from intuitive_physics_recordings.depth_bag_writer import CAMERA_INFO_TOPIC, DEPTH_TOPIC
from intuitive_physics_ros.qos import SENSOR_DATA
from intuitive_physics_ros.scripting import Peer

RATE = 30.0  # images a second
# In a round, and s without a ball after each: something can be predicted nearly always
THROWS, PAUSE = 6, 0.1
SECOND = 1_000_000_000  # ns
# With which perception takes what this camera publishes
PERCEPTION_ARGUMENTS = (
    *("-p", "input:=depth", "-r", f"~/depth/image:={DEPTH_TOPIC}"),
    *("-r", f"~/depth/camera_info:={CAMERA_INFO_TOPIC}"),
)


class Camera:
    """Publishes images in a thread, those of a round one after another, until it is closed."""

    def __init__(self, folder: Path, seed: int, *, has_clock: bool = False) -> None:
        bag = folder / f"throws_{seed}"
        if not bag.exists():
            render_bag(bag, RenderSettings(throws=THROWS, seed=seed, frame_rate=RATE, pause=PAUSE))
        with BagReader(bag) as reader:
            self._images = [pair for _, pair in recorded_images(reader)]
        self._peer = Peer("camera")
        self._publishers = {
            CAMERA_INFO_TOPIC: self._peer.node.create_publisher(
                CameraInfo, CAMERA_INFO_TOPIC, SENSOR_DATA
            ),
            DEPTH_TOPIC: self._peer.node.create_publisher(Image, DEPTH_TOPIC, SENSOR_DATA),
        }
        self._clock = self._peer.node.create_publisher(Clock, "/clock", 1) if has_clock else None
        self._closed = threading.Event()
        self._is_on = threading.Event()
        self._is_on.set()
        self.frames = 0
        self._offset = 0.0
        self._thread = threading.Thread(target=self._run, name="camera", daemon=True)
        self._thread.start()

    def unplug(self) -> None:
        """Publish nothing from now on."""
        self._is_on.clear()

    def plug_in(self) -> None:
        """Publish again."""
        self._is_on.set()

    def jump(self, seconds: float) -> None:
        """Let the time of stamps and clock jump."""
        self._offset += seconds

    @property
    def time(self) -> float:
        """Of an image that is published at this moment, s since the epoch."""
        return time.time() + self._offset

    def _run(self) -> None:
        due = time.monotonic()
        while not self._closed.is_set():
            if not self._is_on.wait(0.1):
                continue
            self._publish(self._images[self.frames % len(self._images)])
            self.frames += 1
            due = max(due + 1.0 / RATE, time.monotonic() - 1.0)
            self._closed.wait(max(0.0, due - time.monotonic()))

    def _publish(self, image: Sequence[BagMessage]) -> None:
        now = round(self.time * SECOND)
        if self._clock is not None:
            message = Clock()
            message.clock.sec, message.clock.nanosec = divmod(now, SECOND)
            self._clock.publish(message)
        for one in image:
            self._publishers[one.topic].publish(with_stamp(one.data, now))

    def close(self) -> None:
        """End the thread."""
        self._closed.set()
        self._is_on.set()
        self._thread.join()
        self._peer.close()

    def __enter__(self) -> Camera:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()
