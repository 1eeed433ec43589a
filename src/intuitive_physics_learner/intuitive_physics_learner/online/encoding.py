"""Plain data of what recursive learning remembers, every number to its last digit."""

from __future__ import annotations

import base64
import zlib
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

FASTEST = 1
"""Level of zlib: matrices are mostly zeros where materials are many, and that is all it finds."""


def encoded(value: Any) -> Any:
    """Return plain data from which `decoded` makes the value again."""
    if isinstance(value, list | tuple):
        items = [encoded(item) for item in value]
        return items if isinstance(value, list) else {"tuple": items}
    if isinstance(value, np.ndarray):
        numbers = np.ascontiguousarray(value)
        packed = base64.b64encode(zlib.compress(numbers.tobytes(), FASTEST)).decode("ascii")
        return {"shape": list(value.shape), "type": numbers.dtype.str, "zlib": packed}
    name = type(value).__name__
    if hasattr(value, "to_dict"):
        return {"class": name, "dict": value.to_dict()}
    if is_dataclass(value):
        parts = {field.name: encoded(getattr(value, field.name)) for field in fields(value)}
        return {"class": name, "fields": parts}
    return value.item() if isinstance(value, np.generic) else value


def decoded(data: Any, classes: Mapping[str, Any]) -> Any:
    """Return the value that `encoded` was given; `classes` by their names."""
    if isinstance(data, list):
        return [decoded(item, classes) for item in data]
    if not isinstance(data, dict):
        return data
    if "tuple" in data:
        return tuple(decoded(data["tuple"], classes))
    if "zlib" in data:
        raw = zlib.decompress(base64.b64decode(data["zlib"]))
        return np.frombuffer(raw, dtype=data["type"]).reshape(data["shape"]).copy()
    made = classes[data["class"]]
    if "dict" in data:
        return made.from_dict(data["dict"])
    return made(**{name: decoded(part, classes) for name, part in data["fields"].items()})
