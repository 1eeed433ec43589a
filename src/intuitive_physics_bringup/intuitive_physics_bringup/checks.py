"""Checks of launch arguments before anything is started; each refusal is one sentence."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import yaml

from intuitive_physics.errors import InvalidInputError
from intuitive_physics_bringup.connections import NODES

RATES = (0.01, 100.0)
"""Least and largest rate of a replay, those of the replay node's parameter."""

METADATA_FILE = "metadata.yaml"
"""File that makes a folder a bag."""

BAG_SUFFIXES = (".mcap", ".db3", ".bag")
"""Endings of single files that are bags."""


def check_names(words: Sequence[str], file: str, arguments: Collection[str]) -> None:
    """Refuse arguments that a launch file does not have, which `ros2 launch` would ignore.

    Where another launch file includes `file`, the words are not for it alone and all are accepted.
    """
    if not any(Path(word).name == file for word in words):
        return
    for word in words:
        name, is_set, _ = word.partition(":=")
        if is_set and name not in arguments:
            near = get_close_matches(name, arguments, 1)
            expected = near[0] if near else f"one of {', '.join(arguments)}"
            if "params_file" in arguments:
                expected += "; parameters of the nodes are set in the file that params_file names"
            raise InvalidInputError(f"there is no launch argument {name!r}; expected {expected}")


def check_rate(text: str) -> None:
    """Refuse a rate that is not a number within `RATES`."""
    least, most = RATES
    try:
        is_good = least <= float(text) <= most
    except ValueError:
        is_good = False
    if not is_good:
        raise InvalidInputError(f"rate is {text!r}; expected a number from {least:g} to {most:g}")


def check_bag(path: str) -> None:
    """Refuse a path that is neither a folder with metadata nor a bag's file; empty: no bag."""
    if not path:
        return
    bag = Path(path)
    if bag.is_dir() and not (bag / METADATA_FILE).is_file():
        raise InvalidInputError(
            f"bag is {path!r}, a folder without {METADATA_FILE}; expected the folder of a whole "
            "recording (ros2 bag reindex writes the file again)"
        )
    if not bag.is_dir() and not (bag.is_file() and bag.suffix in BAG_SUFFIXES):
        raise InvalidInputError(
            f"bag is {path!r}; expected the path of a bag, its folder or a file that ends in "
            f"{', '.join(BAG_SUFFIXES)}"
        )


def check_parameter_file(path: str, prefix: str) -> None:
    """Refuse a YAML file that cannot be read, or has a key that matches none of the nodes.

    `prefix` is the namespace of the nodes with a slash before it; empty: none.
    """
    try:
        parameters = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        reason = " ".join(str(error).split())
        raise InvalidInputError(
            f"params_file is {path!r}, which cannot be read: {reason}"
        ) from None
    if not isinstance(parameters, dict):
        raise InvalidInputError(f"params_file is {path!r}; expected names of nodes, such as /**:")
    for key in _keys(parameters):
        if not any(_matches(key, f"{prefix}/{node}") for node in NODES):
            raise InvalidInputError(
                f"params_file {path!r} has the key {key}, which is none of the nodes; expected "
                f"{_expected(key, prefix)}"
            )


def _keys(parameters: Mapping[Any, Any], above: str = "") -> Iterator[str]:
    """Yield the name of each node, which may stand in several levels of namespaces."""
    for key, value in parameters.items():
        name = f"{above}/{str(key).strip('/')}" if above else str(key)
        if isinstance(value, dict) and value and "ros__parameters" not in value:
            yield from _keys(value, name)
        else:
            yield name


def _matches(key: str, full_name: str) -> bool:
    """Whether a key, in which * stands for one part of a name and ** for any, is that of a node."""
    parts = {"*": r"/\w+", "**": r"(/\w+)*"}
    pattern = "".join(parts.get(part, f"/{re.escape(part)}") for part in key.strip("/").split("/"))
    return re.fullmatch(pattern, full_name) is not None


def _expected(key: str, prefix: str) -> str:
    """Return the keys that hold and are most like one that does not."""
    near = get_close_matches(key.rpartition("/")[2], NODES, 1)
    if not near:
        return f"/**, or /**/ and one of {', '.join(NODES)}"
    return f"/**/{near[0]} or {prefix}/{near[0]}"
