"""Objects and environments as parameters and files describe them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.frames.change_of_frame import RigidTransform
from intuitive_physics.limits import check_limit
from intuitive_physics.scene import Environment, SceneObject
from intuitive_physics.shapes import Box, Capsule, Shape, Sphere

SHAPES = {"sphere": ("radius",), "box": ("x", "y", "z"), "capsule": ("radius", "length")}
"""Numbers of each shape in a description, m: whole edge lengths, and a capsule's length without its
caps."""


@dataclass(frozen=True)
class TaggedObject:
    """An object that carries a tag or markers.

    Parameters
    ----------
    object : what it is
    centre : pose of the object's centre in the frame whose pose is measured
    """

    object: SceneObject
    centre: RigidTransform = field(default_factory=RigidTransform)


def described_objects(
    names: Sequence[str], shapes: Sequence[str], materials: Sequence[str], offsets: Sequence[str]
) -> tuple[TaggedObject, ...]:
    """Return the objects that lists describe, which have one entry for each object.

    `shapes`: such as "sphere 0.05", "box 0.1 0.2 0.3" or "capsule 0.03 0.2", m; `offsets`: x y z,
    or x y z and a quaternion qx qy qz qw, of the object's centre in the frame whose pose is
    measured, m; empty text: the same frame.

    Raises
    ------
    InvalidInputError
        When the lists do not fit together or one entry cannot be read.
    """
    for what, entries in (("shapes", shapes), ("materials", materials), ("offsets", offsets)):
        if len(entries) != len(names):
            raise InvalidInputError(
                f"objects have {len(names)} names and {len(entries)} {what}; expected as many"
            )
    return tuple(
        TaggedObject(SceneObject(name, material, shape_from_text(shape)), _offset(offset))
        for name, shape, material, offset in zip(names, shapes, materials, offsets, strict=True)
    )


def shape_from_text(text: str) -> Shape:
    """Return the shape that a text names, such as "box 0.1 0.2 0.3".

    Raises
    ------
    InvalidInputError
        When it names none.
    """
    kind, *rest = text.split() or [""]
    numbers = _numbers(rest, f"shape {text!r}")
    if kind not in SHAPES or len(numbers) != len(SHAPES[kind]):
        kinds = " or ".join(
            f"{name!r} and {', '.join(numbers_of_kind)}" for name, numbers_of_kind in SHAPES.items()
        )
        raise InvalidInputError(f"shape is {text!r}; expected {kinds} in m")
    if kind == "sphere":
        return Sphere(*numbers)
    if kind == "capsule":
        return Capsule(numbers[0], numbers[1])
    return Box((numbers[0], numbers[1], numbers[2]))


def _offset(text: str) -> RigidTransform:
    numbers = _numbers(text.split(), f"offset {text!r}")
    if len(numbers) not in (0, 3, 7):
        raise InvalidInputError(
            f"offset is {text!r}; expected x y z in m, and qx qy qz qw where it is turned"
        )
    return RigidTransform(numbers[:3] or (0.0, 0.0, 0.0), numbers[3:] or (0.0, 0.0, 0.0, 1.0))


def _numbers(words: Sequence[str], what: str) -> list[float]:
    try:
        return [float(word) for word in words]
    except ValueError as error:
        raise InvalidInputError(f"{what} cannot be read: {error}; expected numbers") from None


def environment_from_file(path: str) -> Environment:
    """Return the environment that a JSON file has, as `Environment.to_dict` makes it.

    An observation that perception made has one too; its file can be given as well.

    Raises
    ------
    InvalidInputError
        When the file cannot be read.
    """
    file = Path(path).expanduser()
    try:
        check_limit("longest_text", file.stat().st_size, f"bytes of {path}")
        data = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, ValueError) as error:
        raise InvalidInputError(
            f"environment file {path!r} cannot be read: {error}; expected JSON"
        ) from None
    if not isinstance(data, dict):
        raise InvalidInputError(f"environment file {path!r} has no object of JSON; expected one")
    return Environment.from_dict(data.get("environment", data))
