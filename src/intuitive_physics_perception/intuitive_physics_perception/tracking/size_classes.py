"""Materials of balls without a name: one for each size that can be distinguished.

A radius is all that a depth image shows of a material. Classes of radius have the same limits in
every run, so that what is learned of a size from one recording holds in the next.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

REFERENCE_RADIUS = 0.05
"""m, in the middle of a class. With the default ratio no ball of a common sport, nor of 30, 50 or
70 mm, is nearer to a limit than the error of its radius up to 2 m."""

LIMIT_SIGMAS = 3.0
"""Standard deviations of a radius beyond a limit within which a ball may be of the class."""

CLEAR_SPREAD = 0.25
"""Part of a class's width that three standard deviations may be for others to follow the ball."""


@dataclass(frozen=True)
class SizeClass:
    """Radii that share a material.

    Parameters
    ----------
    number : counted from the class of the reference radius, 0
    smallest, largest : radii, m
    """

    number: int
    smallest: float
    largest: float

    def material(self, kind: str) -> str:
        """Return the name of its material, such as `ball_46_55mm`."""
        digits = 0 if self.smallest >= 0.01 else 1
        lower, upper = (f"{1000.0 * limit:.{digits}f}" for limit in (self.smallest, self.largest))
        return f"{kind}_{lower}_{upper}mm"


class SizeClasses:
    """The classes of radius of one run.

    Class k has the radii from R r^(k - 1/2) to R r^(k + 1/2), R the reference radius and r the
    ratio. A ball at a limit, whose radius is measured on either side from throw to throw, stays in
    the class in which it, or another one before it, was first.

    `ratio`: of the largest to the smallest radius of a class, above 1.
    """

    def __init__(self, ratio: float) -> None:
        self._log_ratio = math.log(ratio)
        self._met: set[int] = set()

    def class_of(
        self, radius: float, deviation: float, present: SizeClass | None = None
    ) -> SizeClass:
        """Return a ball's class.

        `radius` and `deviation` in m, measured, and its standard deviation; `present`: the class
        that the ball has had so far.
        """
        place = math.log(radius / REFERENCE_RADIUS) / self._log_ratio
        spread = LIMIT_SIGMAS * deviation / radius / self._log_ratio
        nearest_first = sorted(self._met, key=lambda number: abs(number - place))
        for number in [*([] if present is None else [present.number]), *nearest_first]:
            if abs(number - place) <= 0.5 + spread:
                return self._numbered(number)
        number = round(place)
        if spread < CLEAR_SPREAD:
            self._met.add(number)
        return self._numbered(number)

    def _numbered(self, number: int) -> SizeClass:
        smallest, largest = (
            REFERENCE_RADIUS * math.exp((number + half) * self._log_ratio) for half in (-0.5, 0.5)
        )
        return SizeClass(number, smallest, largest)
