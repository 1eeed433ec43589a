"""Numbers that the choice of the next throw depends on, each with its unit and its source."""

from __future__ import annotations

from dataclasses import dataclass

from intuitive_physics.settings import check_settings, number


@dataclass(frozen=True)
class DesignSettings:
    """How candidate throws are drawn and judged.

    A field that says "set by hand" has no derivation. Widths are parts of the unit interval that
    each parameter of θ_s is searched on.
    """

    candidates: int = number(
        96,
        1,
        100_000,
        "throws spread over the ranges that are compared first; the best of 96 random ones is "
        "within the best 5 % with probability 0.99",
    )
    draws: int = number(
        8,
        1,
        10_000,
        "draws of θ_s from the posterior that the expected information is averaged over; set by "
        "hand",
    )
    execution_error: float = number(
        0.05,
        0.0,
        1.0,
        "standard deviation by which a throw misses what was suggested, a part of the width of "
        "each range: a suggestion must not depend on a perfect throw; set by hand",
    )

    def __post_init__(self) -> None:
        check_settings(self)
