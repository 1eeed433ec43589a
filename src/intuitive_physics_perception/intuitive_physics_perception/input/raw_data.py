"""Raw data of images and clouds: rows of pixels of some bytes each."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError

RawData: TypeAlias = bytes | memoryview
"""Data of a message; what else has a buffer of bytes, as array.array and NumPy's, is as good."""

MAX_PIXELS = 16_000_000
"""Largest image or cloud that is taken; more would only be a broken header."""


def checked_bytes(
    message: Any, *, pixel_step: int, row_step: int, what: str, is_bigendian: bool = False
) -> NDArray[np.uint8]:
    """Return a message's data as read-only bytes (n,) after checking that they hold its pixels.

    `pixel_step` and `row_step` in bytes from one pixel, or row, to the next; `what` it is.

    Raises
    ------
    InvalidInputError
        When the data is big-endian, too large, or its length does not fit.
    """
    width, height = message.width, message.height
    if width < 0 or height < 0 or width * height > MAX_PIXELS:
        raise InvalidInputError(
            f"{what} has {width} x {height} pixels; expected none below 0 and at most "
            f"{MAX_PIXELS:,} in all"
        )
    if is_bigendian:
        raise InvalidInputError(
            f"{what} is big-endian; expected little-endian data: convert it where it is published"
        )
    if row_step < width * pixel_step:
        raise InvalidInputError(
            f"{what} has rows of {row_step} bytes; expected at least {width * pixel_step} "
            f"for {width} times {pixel_step} bytes"
        )
    view = np.frombuffer(memoryview(message.data).cast("B"), dtype=np.uint8)
    if view.size < height * row_step:
        raise InvalidInputError(
            f"{what} has {view.size} bytes of data; expected {height * row_step} for {height} "
            f"rows of {row_step} bytes: it is truncated"
        )
    # To a compiled kernel data that may be written to would be another type.
    view.flags.writeable = False
    return view
