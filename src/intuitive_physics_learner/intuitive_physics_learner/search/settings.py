"""Numbers that identifiability was tuned with, each with its unit and where it comes from."""

from __future__ import annotations

from dataclasses import dataclass

from intuitive_physics.settings import check_settings, number, other


@dataclass(frozen=True)
class IdentifiabilitySettings:
    """How `identify` decides which parameters the observations determine.

    Widths are parts of the interval of a parameter's bounds. A field that says "set by hand" has no
    derivation.
    """

    scan_levels: tuple[float, ...] = other(
        (0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0),
        "places on its interval at which J is asked whether it responds to a parameter; set by "
        "hand",
    )
    jacobian_step: float = number(
        0.01,
        1e-9,
        0.5,
        "width of the differences of the residuals to each side: large against the kinks of single "
        "contacts; set by hand",
    )
    response_threshold: float = number(
        2.0, 0.0, 100.0, "standard errors of J by which it must rise to respond to a parameter"
    )
    smallest_noise: float = number(
        1e-4,
        1e-9,
        1.0,
        "noise of the residuals at least: no camera measures better, and the information matrix "
        "stays well conditioned",
        unit="m",
    )
    largest_rise: float = number(
        1.2,
        0.0,
        100.0,
        "standard errors by which J may rise where a parameter is still acceptable: with one "
        "observation that gets worse among others that do not respond it rises by exactly one",
    )
    largest_rise_share: float = number(
        0.1,
        0.0,
        1.0,
        "part of itself by which J may rise at most there: a number that is fitted to an "
        "observation with a handful of independent errors gains as much by chance",
    )
    move_rounds: int = number(
        5, 1, 100, "rounds of moving a parameter outwards from the optimum; set by hand"
    )
    move_growth: float = number(
        3.0, 1.0, 100.0, "factor on the distance from one round to the next; set by hand"
    )
    one_sided_deviations: float = number(
        2.0,
        1.0,
        100.0,
        "distance, in those of a uniform distribution with the parameter's standard deviation, "
        "beyond which an acceptable move gives a one-sided interval; set by hand",
    )

    def __post_init__(self) -> None:
        check_settings(self)
