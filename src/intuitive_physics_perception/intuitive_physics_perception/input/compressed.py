"""Compressed images as image_transport publishes them: PNG and RVL depth, PNG and JPEG colour."""

from __future__ import annotations

import struct
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.kernels import allocating_entry, kernel
from intuitive_physics_perception.input.raw_data import MAX_PIXELS, RawData

CONFIG = struct.Struct("<iff")
"""Before a depth image's data: what wrote them, and the quantisation (A, B) of an inverse depth."""

RVL_SIZE = struct.Struct("<ii")
"""Before RVL's words: columns and rows."""

MOST_GROUPS = 11
"""Groups of three bits in a number of 32 bits."""

PNG_DEPTH_MODES = ("I;16", "I;16B", "I")
"""Modes of Pillow for a PNG with one channel of 16 bits; the last in versions before 11."""


def depth_from_compressed_data(data: RawData, image_format: str) -> NDArray[Any]:
    """Return the depth image of a CompressedImage of the transport compressedDepth.

    16 bits are mm as they were (16UC1), or an inverse depth (32FC1): a value i is A / (i - B) m,
    with A and B from the header, and zero is a missing reading. Such are the source and the
    documentation of compressed_depth_image_transport.

    `data`: the header of 12 bytes, then a PNG, or columns, rows and RVL's words; `image_format`:
    such as "16UC1; compressedDepth png" or "32FC1; compressedDepth rvl"; without its last word it
    is PNG. Returns (height, width), uint16 in mm or float32 in m.

    Raises
    ------
    InvalidInputError
        When the format is another one, or the data are not of it.
    """
    encoding, _, transport = (part.strip() for part in image_format.partition(";"))
    words = transport.split()
    if encoding not in ("16UC1", "32FC1") or words[:1] != ["compressedDepth"]:
        raise InvalidInputError(
            f"format of a compressed depth image is {image_format!r:.60}; expected 16UC1 or 32FC1, "
            "and compressedDepth: is it the topic with /compressedDepth at its end?"
        )
    content = bytes(data)
    if len(content) < CONFIG.size:
        raise InvalidInputError(
            f"compressed depth image has {len(content)} bytes; expected a header of {CONFIG.size} "
            "and an image after it"
        )
    _, a, b = CONFIG.unpack_from(content)
    raw = _rvl if words[1:] == ["rvl"] else _png_depth
    image = raw(content[CONFIG.size :])
    return image if encoding == "16UC1" else _from_inverse(image, a, b)


def colors_from_compressed_data(data: RawData) -> NDArray[np.uint8]:
    """Return red, green and blue, (height, width, 3), of a CompressedImage of colours.

    Raises
    ------
    InvalidInputError
        When the data are neither.
    """
    with _opened(bytes(data), ("JPEG", "PNG")) as image:
        return np.asarray(_loaded(image).convert("RGB"))


def _png_depth(content: bytes) -> NDArray[np.uint16]:
    with _opened(content, ("PNG",)) as image:
        if image.mode not in PNG_DEPTH_MODES:
            raise InvalidInputError(
                f"compressed depth image is a PNG of mode {image.mode}; expected one channel of 16 "
                "bits"
            )
        return np.asarray(_loaded(image)).astype(np.uint16)


def _opened(content: bytes, formats: tuple[str, ...]) -> Image.Image:
    """Return an image of which only the header is read, and its size checked."""
    try:
        image = Image.open(BytesIO(content), formats=formats)
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError):
        raise InvalidInputError(
            f"compressed image of {len(content)} bytes begins with {content[:8]!r}; expected a "
            f"{' or '.join(formats)} of at most {MAX_PIXELS:,} pixels"
        ) from None
    if image.width * image.height > MAX_PIXELS:
        raise InvalidInputError(
            f"compressed image has {image.width} x {image.height} pixels; expected at most "
            f"{MAX_PIXELS:,} in all"
        )
    return image


def _loaded(image: Image.Image) -> Image.Image:
    try:
        image.load()
    except (OSError, SyntaxError, ValueError, struct.error) as error:
        raise InvalidInputError(
            f"compressed image cannot be unpacked: {error}; expected a whole one: it was cut short "
            "or damaged"
        ) from None
    return image


def _from_inverse(image: NDArray[np.uint16], a: float, b: float) -> NDArray[np.float32]:
    with np.errstate(all="ignore"):
        depth = np.float32(a) / (image.astype(np.float32) - np.float32(b))
    return np.where(image == 0, np.float32(np.nan), depth)


def _rvl(content: bytes) -> NDArray[np.uint16]:
    """Unpack RVL (A. Wilson, Fast Lossless Depth Image Compression, ISS 2017)."""
    if len(content) < RVL_SIZE.size:
        raise InvalidInputError(f"RVL image has {len(content)} bytes; expected its size first")
    width, height = RVL_SIZE.unpack_from(content)
    if width < 1 or height < 1 or width * height > MAX_PIXELS:
        raise InvalidInputError(
            f"RVL image has {width} x {height} pixels; expected both above 0 and at most "
            f"{MAX_PIXELS:,} in all"
        )
    words = content[RVL_SIZE.size :]
    image, whole = unpack_rvl(
        np.frombuffer(words[: len(words) // 4 * 4], dtype="<u4"), width * height
    )
    if not whole:
        raise InvalidInputError(
            f"RVL image of {width} x {height} pixels ends too soon; expected a whole one: it was "
            "cut short or damaged"
        )
    return np.asarray(image.reshape(height, width))


@allocating_entry
def unpack_rvl(words: Any, count: Any) -> Any:
    """Return the pixels (count,) uint16 of RVL's words, and whether there were as many.

    Runs of zeros and of other values take turns, each after its length. The values are differences
    to the one before, 0, -1, 1, -2, … written as 0, 1, 2, 3, …; numbers are groups of three bits,
    the lowest first, with a fourth that says whether another follows.

    `words` (n,) uint32, eight groups each, the first in the highest bits.
    """
    pixels = np.zeros(count, dtype=np.uint16)
    state = np.zeros(1, dtype=np.int64)
    done, previous = 0, 0
    while done < count:
        zeros = _next_number(words, state)
        if zeros < 0 or zeros > count - done:
            return pixels, False
        done += zeros
        others = _next_number(words, state)
        if others < 0 or others > count - done or zeros + others == 0:
            return pixels, False
        for _ in range(others):
            code = _next_number(words, state)
            if code < 0:
                return pixels, False
            previous += code >> 1 if code & 1 == 0 else -((code + 1) >> 1)
            pixels[done] = previous & 0xFFFF
            done += 1
    return pixels, True


@kernel
def _next_number(words: Any, state: Any) -> Any:
    """Return the number at group state[0], and move on; -1 where the words end before it does."""
    value = 0
    for k in range(MOST_GROUPS):
        group = state[0]
        if group >= 8 * len(words):
            return -1
        bits = (np.int64(words[group // 8]) >> (28 - 4 * (group % 8))) & 0xF
        state[0] = group + 1
        value |= (bits & 7) << (3 * k)
        if bits & 8 == 0:
            return value
    return -1
