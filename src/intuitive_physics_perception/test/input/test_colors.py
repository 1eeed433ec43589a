"""Colours of readings: read as they were written, and never in the way of geometry."""

from __future__ import annotations

from types import SimpleNamespace as Message

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from intuitive_physics.errors import InvalidInputError
from intuitive_physics_perception.detection.detections import DetectedSphere
from intuitive_physics_perception.detection.solids import with_color
from intuitive_physics_perception.input.colors import CHANNELS, colors_of_cloud, colors_of_image
from intuitive_physics_perception.pipeline import PerceptionPipeline
from intuitive_physics_perception.settings import PerceptionSettings

FLOAT32, UINT32 = 7, 6


@given(
    encoding=st.sampled_from([name for name in CHANNELS if name != "mono8"]),
    height=st.integers(1, 4),
    width=st.integers(1, 5),
    padding=st.integers(0, 3),
    seed=st.integers(0, 2**31),
)
def test_red_green_and_blue_of_images_of_all_encodings(
    encoding, height, width, padding, seed
) -> None:
    colors = np.random.default_rng(seed).integers(0, 256, (height, width, 3), dtype=np.uint8)
    # The name of an encoding spells the order of its channels.
    written = np.full((height, width, len(encoding) - 1), 255, np.uint8)
    for k, letter in enumerate(encoding[:-1]):
        if letter != "a":
            written[:, :, k] = colors[:, :, "rgb".index(letter)]
    rows = [row.tobytes() + bytes(padding) for row in written]
    step = width * written.shape[2] + padding
    read = colors_of_image(
        Message(data=b"".join(rows), width=width, height=height, encoding=encoding, step=step)
    )
    np.testing.assert_array_equal(read, colors)


def test_grey_is_as_much_red_as_green_and_blue() -> None:
    grey = Message(data=bytes(range(6)), width=3, height=2, encoding="mono8", step=3)
    read = colors_of_image(grey)
    assert read[1].tolist() == [[3, 3, 3], [4, 4, 4], [5, 5, 5]]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"encoding": "16UC1"}, "expected a colour image, rgb8"),
        ({"height": 3}, "truncated"),
        ({"step": 8}, "expected at least 9"),
    ],
)
def test_images_that_are_no_colour_are_refused(changes, message) -> None:
    header = {"width": 3, "height": 2, "encoding": "rgb8", "step": 9}
    with pytest.raises(InvalidInputError, match=message):
        colors_of_image(Message(data=bytes(18), **{**header, **changes}))


@pytest.mark.parametrize("name", ["rgb", "rgba"])
@pytest.mark.parametrize("datatype", [FLOAT32, UINT32])
def test_packed_colours_of_a_cloud(name, datatype) -> None:
    """0xAARRGGBB, as PCL packs it."""
    words = np.array([[0x00FF8001, 0xFF102030]], "<u4")
    data = np.zeros((1, 2, 4), "<u4")
    data[:, :, 3] = words
    fields = [
        Message(name="x", offset=0, datatype=FLOAT32, count=1),
        Message(name=name, offset=12, datatype=datatype, count=1),
    ]
    read = colors_of_cloud(
        Message(data=data.tobytes(), width=2, height=1, point_step=16, row_step=32, fields=fields)
    )
    assert read.tolist() == [[[0xFF, 0x80, 0x01], [0x10, 0x20, 0x30]]]


@given(
    name=st.sampled_from(["rgb", "rgba", "intensity"]),
    offset=st.integers(-8, 40),
    datatype=st.integers(0, 9),
    count=st.integers(0, 3),
)
def test_fields_that_hold_no_packed_colour_are_none(name, offset, datatype, count) -> None:
    field = Message(name=name, offset=offset, datatype=datatype, count=count)
    read = colors_of_cloud(
        Message(data=bytes(64), width=2, height=2, point_step=16, row_step=32, fields=[field])
    )
    good = name != "intensity" and datatype in (6, 7) and count < 2 and 0 <= offset <= 12
    assert (read is None) == (not good)


def test_the_colour_of_a_ball_is_that_of_the_readings_on_it() -> None:
    ball = DetectedSphere(np.array([0.0, 0.0, 1.0]), 0.1, np.eye(4), 2, 1.0)
    points = np.array([[0, 0, 0.9], [0.1, 0, 1.0], [0.5, 0, 1.0]], np.float32)
    colors = np.array([[255, 0, 0], [0, 0, 255], [9, 9, 9]], np.uint8)
    everywhere, outside = np.arange(3), np.array([2])
    assert with_color(ball, everywhere, points[None], colors[None]).color == pytest.approx(
        [0.5, 0.0, 0.5]
    )
    assert with_color(ball, outside, points[None], colors[None]).color is None


def test_geometry_is_the_same_to_the_bit_with_and_without_colours(make_small_room) -> None:
    room = make_small_room(tilt=25.0, seed=5, focal=262.5)
    places = [()] * 4 + [[((1.4, -0.3 + 0.03 * k, 0.45), 0.07)] for k in range(6)]
    frames = [room.points(balls) for balls in places]
    green = np.zeros(frames[0].shape, np.uint8)
    green[:, :, 1] = 255
    results = []
    for colors in (None, green):
        pipeline = PerceptionPipeline(
            PerceptionSettings(environment_frames=4), np.random.default_rng(0)
        )
        results.append([pipeline.process(f, k / 30.0, colors) for k, f in enumerate(frames)][-1])
    without, colored = results
    assert [o.state.to_dict() for o in without.objects] == [
        o.state.to_dict() for o in colored.objects
    ]
    assert [o.color for o in without.objects] == [None]
    assert colored.objects[0].color.tolist() == [0.0, 1.0, 0.0]
    with pytest.raises(InvalidInputError, match="same shape"):
        pipeline.process(frames[0], 9.0, green[:10])
