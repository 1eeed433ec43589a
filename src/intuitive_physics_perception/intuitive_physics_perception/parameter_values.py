"""Settings from values by name, as the node's parameters or a parameter file have them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from intuitive_physics.errors import InvalidInputError
from intuitive_physics_perception.settings import KnownObject, PerceptionSettings

NO_OBJECT = KnownObject("none", 1.0, "none")
"""Stands in the lists of known objects, which ROS cannot have empty, when there are none."""

NO_DIRECTION = (0.0, 0.0, 0.0)


def settings_from_values(values: Mapping[str, Any]) -> PerceptionSettings:
    """Return the settings that values by name describe.

    Parameters
    ----------
    values : every setting that is a number, word or choice by its own name; `up_hint`, zeros for
        none; `known_object_names`, `known_object_radii` in m and `known_object_materials`. Others
        are left alone.

    Raises
    ------
    InvalidInputError
        When the lists of known objects differ in length or a value is out of range.
    """
    columns = [list(values[f"known_object_{name}"]) for name in ("names", "radii", "materials")]
    if len({len(column) for column in columns}) != 1:
        raise InvalidInputError(
            f"known_object_names, _radii and _materials have {[len(c) for c in columns]} entries; "
            "expected as many of each"
        )
    known = [KnownObject(*row) for row in zip(*columns, strict=True)]
    hint = tuple(values["up_hint"])
    if len(hint) != 3:
        raise InvalidInputError(f"up_hint has {len(hint)} numbers; expected x, y and z")
    plain = {
        setting.name: values[setting.name]
        for setting in fields(PerceptionSettings)
        if isinstance(setting.default, bool | int | float | str)
    }
    return PerceptionSettings(
        up_hint=None if hint == NO_DIRECTION else hint,
        known_objects=() if known == [NO_OBJECT] else tuple(known),
        **plain,
    )
