"""Fields of messages: numbers filled and read in one copy, errors that name the field."""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.errors import IntuitivePhysicsError, InvalidInputError


class InvalidFieldError(InvalidInputError):
    """A field of a message is not what it must be.

    Parameters
    ----------
    path : from the message to the field, such as "objects[2].shape"
    reason : what was got and what was expected
    """

    def __init__(self, path: str, reason: str) -> None:
        super().__init__(f"{path}: {reason}")
        self.path = path
        self.reason = reason


@contextmanager
def in_field(name: str) -> Iterator[None]:
    """Turn any error of the suite that is raised inside into one that names the field.

    Used one inside the other, they make the whole path.
    """
    try:
        yield
    except InvalidFieldError as error:
        raise InvalidFieldError(f"{name}.{error.path}", error.reason) from None
    except IntuitivePhysicsError as error:
        raise InvalidFieldError(name, str(error)) from None


def float64_field(values: ArrayLike) -> array[float]:
    """Return what a `float64[]` field takes, in one copy.

    Parameters
    ----------
    values : (…) of any shape, taken flat
    """
    return _field("d", np.float64, values)


def float32_field(values: ArrayLike) -> array[float]:
    """Return what a `float32[]` field takes, in one copy.

    Parameters
    ----------
    values : (…) of any shape, taken flat
    """
    return _field("f", np.float32, values)


def flat_array(field: Sequence[float], shape: Sequence[int]) -> NDArray[np.float64]:
    """Return a number field as a finite array (…) of the given shape.

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
