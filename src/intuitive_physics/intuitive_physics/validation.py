"""Checks of input, each of which raises `InvalidInputError` with what was got and expected.

The argument `name` names the value in the message.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.errors import InvalidInputError

LONGEST_NAME = 256
"""Characters of a name at most; names stand in every message, row and log line."""

UNIT_QUATERNION_TOLERANCE = 1e-3
"""Largest deviation of a quaternion's norm from one: more is a mistake, not rounding."""


def positive_float(value: Any, name: str) -> float:
    """Return `value` as a float after checking that it is finite and above zero."""
    number = finite_float(value, name)
    if number <= 0.0:
        raise InvalidInputError(f"{name} is {number:g}; expected a number above zero")
    return number


def finite_float(value: Any, name: str) -> float:
    """Return `value` as a float after checking that it is finite."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise InvalidInputError(f"{name} is {value!r}; expected a number") from None
    if not np.isfinite(number):
        raise InvalidInputError(f"{name} is {number}; expected a finite number")
    return number


def non_negative_float(value: Any, name: str) -> float:
    """Return `value` as a float, which must be finite and not below zero."""
    number = finite_float(value, name)
    if number < 0.0:
        raise InvalidInputError(f"{name} is {number:g}; expected zero or above")
    return number


def name_string(value: Any, name: str) -> str:
    """Return `value` after checking that it is a string with something in it.

    NUL is refused: to SQLite and to C a string ends there, and two names would be one.
    """
    if not isinstance(value, str) or not value.strip():
        raise InvalidInputError(
            f"{name} is {value!r:.80}; expected a name with at least one character"
        )
    if "\0" in value:
        raise InvalidInputError(f"{name} is {value!r:.80}; expected a name without NUL characters")
    if len(value) > LONGEST_NAME:
        raise InvalidInputError(
            f"{name} is {value!r:.80}… of {len(value)} characters; expected at most {LONGEST_NAME}"
        )
    return value


def finite_array(value: ArrayLike, name: str, shape: Sequence[int | None]) -> NDArray[np.float64]:
    """Return a C-contiguous float64 copy of `value` (…) after checking shape and finiteness.

    None in the expected shape stands for any length of that axis.
    """
    try:
        array = np.array(value, dtype=np.float64, order="C")
    except (TypeError, ValueError):
        raise InvalidInputError(
            f"{name} is {value!r:.80}; expected an array of numbers of shape {_shown(shape)}"
        ) from None
    if array.ndim != len(shape) or any(
        expected is not None and got != expected
        for got, expected in zip(array.shape, shape, strict=True)
    ):
        raise InvalidInputError(f"{name} has shape {array.shape}; expected {_shown(shape)}")
    if not np.isfinite(array).all():
        bad = int(array.size - np.isfinite(array).sum())
        raise InvalidInputError(f"{name} has {bad} values that are not finite; expected none")
    return array


def edge_vector(value: ArrayLike, name: str) -> NDArray[np.float64]:
    """Return `value` (3,) m after checking that all are above zero."""
    edges = finite_array(value, name, (3,))
    if (edges <= 0.0).any():
        raise InvalidInputError(f"{name} are {edges.tolist()}; expected all above zero")
    return edges


def unit_quaternion(value: ArrayLike, name: str) -> NDArray[np.float64]:
    """Return `value` (4,) as (x, y, z, w), normalised to machine precision.

    Its norm may differ from one by `UNIT_QUATERNION_TOLERANCE`.
    """
    quaternion = finite_array(value, name, (4,))
    norm = float(np.linalg.norm(quaternion))
    if abs(norm - 1.0) > UNIT_QUATERNION_TOLERANCE:
        raise InvalidInputError(
            f"{name} has norm {norm:.6g}; expected a unit quaternion (x, y, z, w)"
        )
    return _scaled_to_one(quaternion, norm)


def unit_vector(value: ArrayLike, name: str) -> NDArray[np.float64]:
    """Return `value` (3,), of any length but zero, scaled to length one."""
    vector = finite_array(value, name, (3,))
    norm = float(np.linalg.norm(vector))
    if norm < 1e-12:
        raise InvalidInputError(f"{name} is {vector.tolist()}; expected a vector with a direction")
    return _scaled_to_one(vector, norm)


def covariance_matrix(value: ArrayLike, name: str, size: int) -> NDArray[np.float64]:
    """Return `value` (size, size) after checking that it is symmetric, positive semi-definite."""
    matrix = finite_array(value, name, (size, size))
    scale = max(float(np.abs(matrix).max()), 1e-300)
    if np.abs(matrix - matrix.T).max() > 1e-6 * scale:
        raise InvalidInputError(f"{name} is not symmetric; expected a covariance matrix")
    matrix = 0.5 * (matrix + matrix.T)
    smallest = float(np.linalg.eigvalsh(matrix)[0])
    if smallest < -1e-6 * scale:
        raise InvalidInputError(
            f"{name} has the eigenvalue {smallest:.3g}; expected a covariance matrix, "
            "whose eigenvalues are never negative"
        )
    return matrix


def covariance_matrices(
    value: ArrayLike, name: str, count: int, *, size: int
) -> NDArray[np.float64]:
    """Return `value` (count, size, size) after checking each matrix as `covariance_matrix` does."""
    matrices = finite_array(value, name, (count, size, size))
    transposed = matrices.swapaxes(1, 2)
    scales = np.maximum(np.abs(matrices).max(axis=(1, 2)), 1e-300)
    skewed = np.abs(matrices - transposed).max(axis=(1, 2)) > 1e-6 * scales
    smallest = np.linalg.eigvalsh(0.5 * (matrices + transposed))[:, 0]
    for wrong, reason in ((skewed, "symmetric"), (smallest < -1e-6 * scales, "a covariance")):
        if wrong.any():
            raise InvalidInputError(
                f"{name} has at index {int(wrong.argmax())} a matrix that is not {reason}; "
                "expected covariance matrices: symmetric, with eigenvalues that are never negative"
            )
    return 0.5 * (matrices + transposed)


def increasing_times(value: ArrayLike, name: str) -> NDArray[np.float64]:
    """Return `value` (n_times,) s, at least one time, after checking that it strictly increases."""
    times = finite_array(value, name, (None,))
    if times.size == 0:
        raise InvalidInputError(f"{name} is empty; expected at least one time")
    backward = times[1:] <= times[:-1]
    if backward.any():
        at = int(backward.argmax())
        raise InvalidInputError(
            f"{name} goes from {times[at]:.9g} to {times[at + 1]:.9g} at index {at + 1}; "
            "expected times that strictly increase"
        )
    return times


def set_fields(target: Any, **values: Any) -> None:
    """Set fields of a frozen dataclass from its `__init__`; arrays become read-only."""
    for name, value in values.items():
        if isinstance(value, np.ndarray):
            value.setflags(write=False)
        object.__setattr__(target, name, value)


def plain_data(record: Any) -> dict[str, Any]:
    """Return the fields of a dataclass as numbers, strings and lists, for JSON."""
    return {item.name: _plain(getattr(record, item.name)) for item in fields(record)}


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value.to_dict() if hasattr(value, "to_dict") else value


def _scaled_to_one(array: NDArray[np.float64], norm: float) -> NDArray[np.float64]:
    """Scale to norm one, but leave a normalised array as it is: files then read back equal."""
    return array if abs(norm - 1.0) < 1e-15 else array / norm


def _shown(shape: Sequence[int | None]) -> str:
    inside = ", ".join("any" if n is None else str(n) for n in shape)
    return f"({inside},)" if len(shape) == 1 else f"({inside})"
