"""Reading .npz files of others, with one clear error for every mistake."""

from __future__ import annotations

import math
import zipfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.limits import check_limit
from intuitive_physics.validation import finite_array

HEADERS = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}
"""Readers of the header of an array, by the version of its format."""

Arrays = Mapping[str, NDArray]


def load_arrays(path: Path) -> dict[str, NDArray]:
    """Read an .npz file: its arrays, of any shape (...) and unit, by name.

    Raises
    ------
    InvalidInputError
        When there is no such file or it is no .npz file of plain arrays.
    """
    try:
        if zipfile.is_zipfile(path):
            _check_sizes(path)
        data = np.load(path, allow_pickle=False)
        if isinstance(data, np.ndarray):
            raise InvalidInputError(f"{path} is one bare array; expected an .npz file")
        with data:
            return {name: data[name] for name in data.files}
    except (OSError, ValueError, EOFError, zipfile.BadZipFile, KeyError) as error:
        if isinstance(error, InvalidInputError):
            raise
        detail = getattr(error, "strerror", None) or str(error)
        raise InvalidInputError(f"cannot read {path} as an .npz file: {detail}") from None


def _check_sizes(path: Path) -> None:
    """Check what a file says it unpacks to, before anything is unpacked.

    An array is made whole before it is read: a header of a few bytes can ask for terabytes.
    """
    with zipfile.ZipFile(path) as archive:
        members = archive.infolist()
        total = sum(member.file_size for member in members)
        check_limit("largest_unpacked", total, f"bytes of the arrays of {path}")
        for member in members:
            with archive.open(member) as file:
                version = np.lib.format.read_magic(file)
                read = HEADERS.get(version)
                if read is None:
                    raise InvalidInputError(f"{path} has arrays of the unknown format {version}")
                shape, _, kind = read(file)
            if math.prod(shape) * kind.itemsize > member.file_size:
                raise InvalidInputError(
                    f"{member.filename} of {path} has {member.file_size} bytes, and its header "
                    f"asks for an array of shape {shape} of {kind}; expected as many as it has"
                )


def load_cloud(path: Path) -> NDArray[np.float32]:
    """Return the points (n, 3) m of a cloud kept as the array `xyz`; NaN means no reading.

    Raises
    ------
    InvalidInputError
        When the file has no such array or it has another shape.
    """
    arrays = load_arrays(path)
    if "xyz" not in arrays:
        raise InvalidInputError(
            f"{path} has the arrays {', '.join(sorted(arrays))}; expected xyz, a cloud's points"
        )
    points = arrays["xyz"]
    if points.ndim != 2 or points.shape[1] != 3 or points.dtype.kind != "f":
        raise InvalidInputError(
            f"xyz of {path} has shape {points.shape} of {points.dtype}; expected (n, 3) floats"
        )
    return np.ascontiguousarray(points, dtype=np.float32)


def split_rows(arrays: Arrays, name: str, columns: int = 3) -> list[NDArray[np.float64]]:
    """Cut the rows of one array into recordings at `offsets`, each (n, columns) in its unit.

    Parameters
    ----------
    columns : of the array, unless it has one axis only

    Raises
    ------
    InvalidInputError
        When the offsets do not cover the rows in order.
    """
    rows = np.asarray(arrays[name], dtype=np.float64)
    offsets = np.asarray(arrays["offsets"])
    if offsets.ndim != 1 or offsets.dtype.kind not in "iu" or offsets.size < 2:
        raise InvalidInputError(
            f"offsets have shape {offsets.shape} of {offsets.dtype}; "
            "expected at least two whole numbers"
        )
    if offsets[0] != 0 or offsets[-1] != len(rows) or (np.diff(offsets) <= 0).any():
        raise InvalidInputError(
            f"offsets go from {offsets[0]} to {offsets[-1]} over {len(rows)} rows of {name}; "
            f"expected increasing numbers from 0 to {len(rows)}"
        )
    shape = (None,) if rows.ndim == 1 else (None, columns)
    checked = finite_array(rows, name, shape)
    return np.split(checked, offsets[1:-1])
