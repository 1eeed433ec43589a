"""Messages of type sensor_msgs/CameraInfo."""

from __future__ import annotations

from types import SimpleNamespace as Message

WIDTH, HEIGHT = 8, 6
K = [10.0, 0.0, 3.5, 0.0, 10.0, 2.5, 0.0, 0.0, 1.0]
P = [20.0, 0.0, 3.5, 0.0, 0.0, 20.0, 2.5, 0.0, 0.0, 0.0, 1.0, 0.0]


def region(left=0, top=0, width=0, height=0) -> Message:
    return Message(x_offset=left, y_offset=top, width=width, height=height)


def info(**changes) -> Message:
    fields = {
        "width": WIDTH,
        "height": HEIGHT,
        "k": K,
        "p": P,
        "d": [],
        "distortion_model": "plumb_bob",
        "roi": region(),
        "binning_x": 0,
        "binning_y": 0,
    }
    return Message(**{**fields, **changes})
