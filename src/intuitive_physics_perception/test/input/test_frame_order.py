"""Frames of several cameras pass in the order of their stamps, and none waits for long."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from intuitive_physics_perception.input.frame_order import FrameOrder, Timeline

WINDOW = 0.1


def sent(rng: np.random.Generator, latency: dict[str, float], until: float = 3.0):
    """Arrival, camera and stamp of frames at 30 Hz, later by a latency (s) that jitters."""
    frames = []
    for number, (camera, delay) in enumerate(latency.items()):
        stamps = np.arange(0.011 * number, until, 1.0 / 30.0) + rng.uniform(0.0, 0.002)
        arrivals = np.maximum.accumulate(stamps + delay + rng.uniform(0.0, 0.01, len(stamps)))
        frames += list(zip(arrivals, [camera] * len(stamps), stamps, strict=True))
    return sorted(frames)


def test_all_frames_pass_in_the_order_of_their_stamps(rng) -> None:
    frames = sent(rng, {"a": 0.02, "b": 0.08, "c": 0.05})
    order = FrameOrder[float](("a", "b", "c"), WINDOW)
    passed = [out for _, camera, stamp in frames for out in order.put(camera, stamp, stamp)]
    passed += order.flush()
    # A camera that has not been heard yet is not awaited.
    stamps = sorted(stamp for _, _, stamp in frames)
    assert passed == sorted(passed)
    assert passed[-(len(stamps) - 15) :] == stamps[15:]
    assert order.late + len(passed) == len(stamps)


def test_a_frame_waits_no_longer_than_the_window(rng) -> None:
    """Also where one camera has stopped; what it sends later is counted and left out."""
    frames = sent(rng, {"a": 0.02, "b": 0.08})
    silent = [frame for frame in frames if frame[1] == "a" or frame[2] < 1.0]
    order = FrameOrder[float](("a", "b"), WINDOW)
    newest = -np.inf
    for _, camera, stamp in silent:
        newest = max(newest, stamp)
        for out in order.put(camera, stamp, stamp):
            assert newest - out <= WINDOW + 1.0 / 30.0
    before = order.late
    assert order.put("b", 2.5, 2.5) == []
    assert order.late == before + 1


def test_who_is_awaited_is_not_waited_for_in_vain() -> None:
    """The second camera's next frame cannot come before the first one's that is there."""
    order = FrameOrder[float](("a", "b"), WINDOW)
    waited = []
    for k in range(30):
        waited += order.put("a", k / 30.0, k / 30.0)
        if k > 2:
            assert waited[-1] == k / 30.0
        waited += order.put("b", k / 30.0 + 0.015, k / 30.0 + 0.015)


def test_one_camera_passes_at_once_and_time_may_go_back() -> None:
    order = FrameOrder[int](("a",), WINDOW)
    assert [order.put("a", time, n) for n, time in enumerate([1.0, 2.0, 0.5])] == [[0], [1], [2]]
    order = FrameOrder[int](("a", "b"), WINDOW)
    assert order.put("a", 100.0, 0) == [0]
    # A bag is played again.
    assert order.put("a", 1.0, 1) == [1]
    assert order.put("b", 1.01, 2) + order.flush() == [2]
    assert order.late == 0


FRAMES = st.lists(
    st.tuples(st.sampled_from("abc"), st.floats(0.001, 0.1), st.floats(-0.1, 0.1), st.floats(0, 1)),
    min_size=1,
    max_size=40,
)
"""Sensor, time since the frame before, and when in relation to the stamp readings begin and for how
long they last, s."""


@given(FRAMES)
def test_frames_in_the_order_of_their_stamps_never_turn_time_back(frames) -> None:
    """Whether stamps are those of first readings, of last ones, or of none of them; but what is
    played again does."""
    timeline, stamp = Timeline(), 0.0
    for sensor, step, first, duration in frames:
        stamp += step
        assert not timeline.goes_back(sensor, stamp, first, first + duration)
        assert timeline.has(sensor, stamp)
    assert timeline.goes_back(frames[-1][0], 0.0, -0.1, 0.0)
    assert not timeline.has("a", stamp)


@given(st.floats(0.01, 0.2), st.floats(0.0, 0.5))
def test_a_scan_may_come_as_late_as_it_lasts(duration, late) -> None:
    """A scan that comes by its end is used; one that ended before the last frame began is of
    another time. A camera's own frames increase."""
    timeline = Timeline()
    assert not timeline.goes_back("camera", 1.0, 0.0, 0.0)
    end = 1.0 + duration - late
    assert timeline.goes_back("lidar", end - duration, 0.0, duration) == (
        end - duration < 1.0 > end
    )
    timeline = Timeline()
    assert not timeline.goes_back("camera", 1.0, 0.0, duration)
    assert timeline.goes_back("camera", 1.0 - 1e-3, 0.0, duration)
