"""Compressed images: what is packed as image_transport does it comes out as it was."""

from __future__ import annotations

import struct
from io import BytesIO
from types import SimpleNamespace as Message

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from PIL import Image

from intuitive_physics.errors import InvalidInputError
from intuitive_physics_perception.input import compressed
from intuitive_physics_perception.input.compressed import (
    colors_from_compressed_data,
    depth_from_compressed_data,
)
from intuitive_physics_perception.input.frame_decoder import FrameDecoder

from .camera_infos import info

SHAPES = array_shapes(min_dims=2, max_dims=2, min_side=1, max_side=12)
DEPTHS = arrays(np.uint16, SHAPES, elements=st.sampled_from([0, 0, 1, 700, 701, 40000, 65535]))
PNG, RVL = "16UC1; compressedDepth png", "16UC1; compressedDepth rvl"


def as_png(image) -> bytes:
    file = BytesIO()
    Image.fromarray(image).save(file, "PNG")
    return file.getvalue()


def as_rvl(image) -> bytes:
    """Pack as A. Wilson's paper says, in plain Python."""
    groups = []

    def put(number):
        while True:
            number, low = number >> 3, number & 7
            groups.append(low | (8 if number else 0))
            if not number:
                return

    pixels, at, previous = [int(value) for value in image.ravel()], 0, 0
    while at < len(pixels):
        for is_zero in (True, False):
            end = at
            while end < len(pixels) and (pixels[end] == 0) == is_zero:
                end += 1
            put(end - at)
            for value in [] if is_zero else pixels[at:end]:
                change, previous = value - previous, value
                put(2 * change if change >= 0 else -2 * change - 1)
            at = end
    groups += [0] * (-len(groups) % 8)
    eights = np.reshape(groups, (-1, 8)).tolist()
    words = [sum(group << (28 - 4 * k) for k, group in enumerate(eight)) for eight in eights]
    return struct.pack(f"<ii{len(words)}I", image.shape[1], image.shape[0], *words)


def message(packed, a=0.0, b=0.0) -> bytes:
    return struct.pack("<iff", 0, a, b) + packed


@given(DEPTHS)
@example(np.zeros((2, 3), np.uint16))
def test_millimetres_come_out_as_they_were(depth) -> None:
    for image_format, pack in ((PNG, as_png), (RVL, as_rvl), ("16UC1; compressedDepth", as_png)):
        np.testing.assert_array_equal(
            depth_from_compressed_data(message(pack(depth)), image_format), depth
        )


@given(arrays(np.float32, SHAPES, elements=st.floats(0.25, 10.0, width=32)), st.booleans())
def test_metres_come_out_within_a_step_of_their_quantisation(depth, rvl) -> None:
    # i = A / z + B, so dz = z² / A for a step of one; A and B as the transport chooses them for
    # depths up to 10 m and a quantisation of 100.
    a = 100.0 * 101.0
    b = 1.0 - a / 10.0
    packed = np.floor(a / depth + b).astype(np.uint16)
    packed[0, 0] = 0
    pack, name = (as_rvl, "rvl") if rvl else (as_png, "png")
    image_format = f"32FC1; compressedDepth {name}"
    found = depth_from_compressed_data(message(pack(packed), a, b), image_format)
    assert found.dtype == np.float32
    assert np.isnan(found[0, 0])
    seen = packed > 0
    error = np.abs(found - depth)[seen]
    # The depth that comes out is the farther end of the step, hence its square.
    assert (error <= 1.01 * found[seen] ** 2 / a + 1e-4).all()


def test_a_frame_is_that_of_the_image_before_it_was_packed() -> None:
    depth = np.full((6, 8), 1500, np.uint16)
    decoder = FrameDecoder()
    decoder.take_camera(info())
    points = decoder.compressed_image_points(Message(data=message(as_png(depth)), format=PNG))
    np.testing.assert_allclose(points[0, 0], [-3.5 / 10 * 1.5, -2.5 / 10 * 1.5, 1.5], rtol=1e-6)


@given(arrays(np.uint8, SHAPES.map(lambda shape: (*shape, 3))))
def test_colours_come_out_as_they_were(colors) -> None:
    np.testing.assert_array_equal(colors_from_compressed_data(as_png(colors)), colors)


def test_colours_of_a_jpeg_are_those_that_were_seen() -> None:
    file = BytesIO()
    Image.new("RGB", (40, 30), (200, 30, 60)).save(file, "JPEG")
    found = colors_from_compressed_data(file.getvalue())
    assert found.shape == (30, 40, 3)
    assert np.abs(found.astype(int) - [200, 30, 60]).max() <= 3


@pytest.mark.parametrize(
    ("data", "image_format", "words"),
    [
        (message(b""), "jpeg", "expected 16UC1 or 32FC1, and compressedDepth"),
        (message(b""), "8UC1; compressedDepth png", "expected 16UC1 or 32FC1"),
        (b"\0" * 5, PNG, "has 5 bytes; expected a header of 12"),
        (message(b"GIF89a..."), PNG, "expected a PNG of at most"),
        (message(as_png(np.zeros((4, 4), np.uint8))), PNG, "expected one channel of 16 bits"),
        (message(as_png(np.ones((40, 40), np.uint16))[:-30]), PNG, "cut short or damaged"),
        (message(b"\0\0\0"), RVL, "expected its size first"),
        (message(struct.pack("<ii", 100_000, 100_000)), RVL, "at most 16,000,000"),
        (message(as_rvl(np.ones((4, 4), np.uint16))[:8]), RVL, "ends too soon"),
    ],
)
def test_what_is_none_is_refused_in_a_sentence(data, image_format, words) -> None:
    with pytest.raises(InvalidInputError, match=words):
        depth_from_compressed_data(data, image_format)


@given(st.binary(max_size=200), st.sampled_from([PNG, RVL]), st.integers(1, 40))
def test_any_bytes_give_an_image_or_one_sentence(data, image_format, side) -> None:
    start = struct.pack("<ii", side, side) if image_format == RVL else b"\x89PNG\r\n\x1a\n"
    try:
        sentence = ""
        image = depth_from_compressed_data(message(start + data), image_format)
    except InvalidInputError as error:
        sentence = str(error)
    assert "expected" in sentence or image.shape == (side, side)


def test_an_image_is_not_unpacked_before_its_size_is_known(monkeypatch) -> None:
    # 40 million pixels of zeros are 40 kB as a PNG.
    large = as_png(np.zeros((8000, 5000), np.uint16))
    assert len(large) < 200_000
    monkeypatch.setattr(compressed, "_loaded", None)
    with pytest.raises(InvalidInputError, match="5000 x 8000 pixels; expected at most 16,000,000"):
        depth_from_compressed_data(message(large), PNG)
