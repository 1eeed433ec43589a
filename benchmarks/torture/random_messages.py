"""Messages made from their definitions: extreme fields and lengths, or valid ones bent."""

from __future__ import annotations

import copy
import importlib
import re
from typing import Any

import numpy as np

# Numbers that formulas are not made for, beside some that they are
FLOATS = (0.0, -0.0, 1.0, -1.0, np.nan, np.inf, -np.inf, 1.7e308, -1.7e308, 5e-324, 1e-310, 1e-9)
# Strings that are not names, beside some that are
TEXTS = (
    "",
    "a",
    "ball",
    "environment",
    "/",
    "../../../etc/passwd",
    "'; DROP TABLE observations; --",
    "\n\t\x7f",
    "ü€𝄞",
    "%s%n{0}",
)

LENGTHS = (0, 0, 1, 1, 2, 3, 7, 36)  # of lists, mostly
# Numbers in a list now and then; messages in one; lists of messages within one another
LONGEST, LONGEST_OF_MESSAGES, DEEPEST = 3000, 40, 3
RARELY = 0.05  # how often a list or a string is long
SEQUENCE = re.compile(r"sequence<([^,>]+)(?:, (\d+))?>")
ARRAY = re.compile(r"(.+)\[(\d+)\]")


def random_message(kind: Any, rng: np.random.Generator, depth: int = 0) -> Any:
    """Return a message of a type with random fields."""
    message = kind()
    for name, definition in kind.get_fields_and_field_types().items():
        setattr(message, name, _value(definition, rng, depth))
    return message


def bent(message: Any, rng: np.random.Generator) -> Any:
    """Return a copy of a valid message with one to three random fields in it."""
    changed = copy.deepcopy(message)
    for _ in range(int(rng.integers(1, 4))):
        part = changed
        while True:
            names = list(part.get_fields_and_field_types().items())
            name, definition = names[int(rng.integers(len(names)))]
            value = getattr(part, name)
            is_list = isinstance(value, list) and value
            inner = value[int(rng.integers(len(value)))] if is_list else value
            if hasattr(inner, "get_fields_and_field_types") and rng.random() < 0.9:
                part = inner
                continue
            setattr(part, name, _value(definition, rng, 0))
            break
    return changed


def _value(definition: str, rng: np.random.Generator, depth: int) -> Any:
    if match := SEQUENCE.fullmatch(definition):
        return _list(match[1], _length(match[1], int(match[2] or LONGEST), rng, depth), rng, depth)
    if match := ARRAY.fullmatch(definition):
        return _list(match[1], int(match[2]), rng, depth)
    if definition.startswith(("string", "wstring")):
        long = "x" * int(10 ** rng.uniform(1, 6)) if rng.random() < RARELY else None
        return long or TEXTS[int(rng.integers(len(TEXTS)))]
    if definition == "boolean":
        return bool(rng.integers(2))
    if definition == "octet":
        return bytes([int(rng.integers(256))])
    if definition in ("float", "double", "float32", "float64"):
        return _float(rng, single=definition in ("float", "float32"))
    if "/" in definition:
        package, name = definition.split("/")
        kind = getattr(importlib.import_module(f"{package}.msg"), name)
        return random_message(kind, rng, depth)
    return _integer(definition, rng)


def _length(item: str, most: int, rng: np.random.Generator, depth: int) -> int:
    if "/" in item and depth >= DEEPEST:
        return 0
    longest = min(LONGEST_OF_MESSAGES if "/" in item else LONGEST, most)
    if rng.random() < RARELY:
        return int(rng.integers(longest + 1))
    return min(LENGTHS[int(rng.integers(len(LENGTHS)))], longest)


def _list(item: str, length: int, rng: np.random.Generator, depth: int) -> list[Any]:
    return [_value(item, rng, depth + ("/" in item)) for _ in range(length)]


def _float(rng: np.random.Generator, *, single: bool) -> float:
    if rng.random() < 0.5:
        return float(rng.normal() * 10.0 ** rng.uniform(-3.0, 4.0))
    value = FLOATS[int(rng.integers(len(FLOATS)))]
    return float(np.clip(value, -3.4e38, 3.4e38)) if single and np.isfinite(value) else value


def _integer(definition: str, rng: np.random.Generator) -> int:
    bits = int(re.sub(r"\D", "", definition) or 8)
    least, most = (
        (0, 2**bits - 1) if definition[0] == "u" else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    )
    usual = min(most, int(rng.integers(0, 10)))
    return int(rng.choice(np.array([usual, usual, least, most, max(least, -1)], dtype=object)))
