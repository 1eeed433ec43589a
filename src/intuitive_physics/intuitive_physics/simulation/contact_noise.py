"""Noise from one impact to the next, as in noisy Newton."""

from __future__ import annotations

from dataclasses import dataclass

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.validation import non_negative_float

LARGEST_TILT = 0.5
"""rad, of a normal's standard deviation; more is no unevenness but another surface."""


@dataclass(frozen=True)
class ContactNoise:
    """Noise from one impact to the next.

    Parameters
    ----------
    restitution : standard deviation of the coefficient of restitution, cut off at 0 and 1
    tilt : rad, standard deviation of the normal's direction about each of two axes; rebounds too
        slow to leave the surface keep its own normal
    """

    restitution: float = 0.0
    tilt: float = 0.0

    def __post_init__(self) -> None:
        for name in ("restitution", "tilt"):
            value = non_negative_float(getattr(self, name), f"contact noise {name}")
            object.__setattr__(self, name, value)
        if self.tilt > LARGEST_TILT:
            raise InvalidInputError(
                f"contact noise tilt is {self.tilt:g} rad; expected at most {LARGEST_TILT:g}"
            )

    def __bool__(self) -> bool:
        """Whether there is any."""
        return self.restitution > 0.0 or self.tilt > 0.0
