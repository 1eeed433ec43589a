"""`ParameterBounds` messages and the bounds of a search."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from intuitive_physics_msgs.msg import ParameterBounds

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.parameter_space import DEFAULT_BOUNDS, Bounds
from intuitive_physics_ros.conversions.fields import in_field

SCALES = {ParameterBounds.LINEAR: "linear", ParameterBounds.LOGARITHMIC: "logarithmic"}


def bounds_to_messages(bounds: Mapping[str, Bounds]) -> list[ParameterBounds]:
    """Return bounds by kind of parameter as messages."""
    codes = {scale: code for code, scale in SCALES.items()}
    return [
        ParameterBounds(kind=kind, lower=float(b.lower), upper=float(b.upper), scale=codes[b.scale])
        for kind, b in bounds.items()
    ]


def bounds_from_messages(messages: Sequence[ParameterBounds]) -> dict[str, Bounds]:
    """Return the bounds by kind of parameter that messages carry.

    Raises
    ------
    InvalidInputError
        When a kind is unknown or stands twice, or a range or scale is not what it must be.
    """
    bounds: dict[str, Bounds] = {}
    for i, message in enumerate(messages):
        with in_field(f"bounds[{i}]"):
            if message.kind not in DEFAULT_BOUNDS or message.kind in bounds:
                raise InvalidInputError(
                    f"kind is {message.kind!r}; expected one of {', '.join(DEFAULT_BOUNDS)}, "
                    "each once"
                )
            if message.scale not in SCALES:
                raise InvalidInputError(
                    f"scale is {message.scale}; expected {ParameterBounds.LINEAR} (linear) "
                    f"or {ParameterBounds.LOGARITHMIC} (logarithmic)"
                )
            bounds[message.kind] = Bounds(message.lower, message.upper, SCALES[message.scale])
    return bounds
