"""The worker takes the newest frames and never makes their bringer wait."""

from __future__ import annotations

import threading
import time

from intuitive_physics_perception.nodes.frame_worker import FrameWorker


def test_items_are_handled_in_order_and_the_oldest_dropped() -> None:
    handled: list[int] = []
    begun, go_on = threading.Event(), threading.Event()

    def handle(item: int) -> None:
        begun.set()
        go_on.wait(60.0)
        handled.append(item)

    worker = FrameWorker(handle, waiting=3)
    worker.put(0)
    assert begun.wait(60.0)
    for item in range(1, 8):
        worker.put(item)
    # Nobody waited for the first, which is still under way.
    assert not handled
    assert worker.dropped == 4
    go_on.set()
    deadline = time.monotonic() + 60.0
    while len(handled) < 4 and time.monotonic() < deadline:
        time.sleep(0.01)
    worker.stop()
    assert handled == [0, 5, 6, 7]


def test_it_stops_at_once() -> None:
    worker = FrameWorker[str](lambda _: None)
    assert worker.stop(60.0)
