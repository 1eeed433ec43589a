"""Number fields of messages, filled and read in one copy."""

from __future__ import annotations

import math
from array import array
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.errors import InvalidInputError


def float64_field(values: ArrayLike) -> array[float]:
    """Return what a `float64[]` field takes without looking at every element."""
    return _field("d", np.float64, values)


def float32_field(values: ArrayLike) -> array[float]:
    """Return what a `float32[]` field takes without looking at every element."""
    return _field("f", np.float32, values)


def flat_array(field: Sequence[float], shape: Sequence[int]) -> NDArray[np.float64]:
    """Return a number field as a finite array of the given shape.

    Raises
    ------
    InvalidInputError
        When it has more or fewer numbers than the shape, or any that is not finite.
    """
    values = np.array(field, dtype=np.float64)
    expected = math.prod(shape)
    if values.size != expected:
        raise InvalidInputError(f"has {values.size} numbers; expected {expected}")
    bad = int(values.size - np.isfinite(values).sum())
    if bad:
        raise InvalidInputError(f"has {bad} numbers that are not finite; expected none")
    return values.reshape(shape)


def _field(code: str, kind: type, values: ArrayLike) -> array[float]:
    field: array[float] = array(code)
    field.frombytes(np.ascontiguousarray(values, dtype=kind).tobytes())
    return field
