"""Numbers by which observations are assessed."""

from __future__ import annotations

from dataclasses import dataclass

from intuitive_physics.settings import check_settings, number, numbers


@dataclass(frozen=True)
class AssessmentSettings:
    """Numbers by which observations are assessed."""

    flight_points: tuple[int, ...] = numbers(
        (7, 12, 24), 4, 1000, "numbers of neighbouring points to which a free flight is fitted"
    )
    clearance: float = number(
        0.02, 0.0, 1.0, "gap that a free flight keeps to what it may touch, set by hand", unit="m"
    )
    clear_noises: float = number(2.0, 0.0, 100.0, "the same, besides, in units of the noise")
    flight_acceleration: float = number(
        0.5,
        0.0,
        10.0,
        "standard deviation of an acceleration beyond g: drag of a tennis ball at 5 m/s, or a "
        "vertical that is 3 degrees off",
        unit="m/s²",
    )
    air_acceleration: float = number(
        10.0,
        0.0,
        100.0,
        "the same of an object with drag or Magnus force, which may be as light as a balloon",
        unit="m/s²",
    )
    jump_duration: float = number(
        0.15, 0.0, 10.0, "longest time between points over which a jump is looked for", unit="s"
    )
    impulse_points: int = number(
        12, 4, 1000, "points before and after an impulse: 0.4 s at 30 Hz and 2 cm of noise"
    )
    impulse_duration: float = number(
        1.2, 0.01, 100.0, "longest time of all these points together", unit="s"
    )
    contact_acceleration: float = number(
        6.0,
        0.01,
        100.0,
        "standard deviation of the acceleration of what touches its support: friction coefficients "
        "up to 1, thus 10 m/s² at most, uniformly",
        unit="m/s²",
    )
    natural_impulse: float = number(
        0.5,
        0.0,
        10.0,
        "change of velocity that a box rocking on its edges may make, set by hand: on the sets of "
        "seeds 500 to 509 0.3 raises twice as many false alarms, 0.7 as many",
        unit="m/s",
    )
    steady_p: float = number(
        0.01, 1e-6, 0.5, "p value of the scatter of points above which these are steady"
    )
    side_gap: float = number(
        0.1, 0.0, 10.0, "gap to walls and other objects that a contact test asks for", unit="m"
    )
    hop_height: float = number(
        0.04,
        0.0,
        1.0,
        "rise that rocking may make from a steady height, set by hand on the sets of seeds 500 to "
        "509",
        unit="m",
    )
    rest_points: int = number(24, 4, 1000, "points over which an object rests at a height")
    height_error: float = number(
        0.05, 0.0, 1.0, "error of a resting object's height, of shape and plane", unit="m"
    )
    hold_duration: float = number(
        1.0, 0.0, 10.0, "time that a hand takes to catch and carry an object", unit="s"
    )
    least_points: int = number(3, 1, 1000, "points of each object that are left in any case")
    smallest_stop_spread: float = number(
        0.2,
        0.01,
        10.0,
        "standard deviation at least of the logarithm of a misfit: the median length of nine "
        "normal residuals has 0.13, two of three neighbouring medians apart",
    )
    stop_freedom: float = number(
        3.0,
        0.1,
        100.0,
        "degrees of freedom of Student's distribution of these logarithms: of 2 to 4, which found "
        "as many disturbed throws and 5 to 7 false ones of 320 on the sets of seeds 500 to 509",
    )
    smallest_log_p: float = number(
        -25.0, -700.0, -1.0, "logarithm of a p value at least: no noise model holds further out"
    )
    alternative_power: float = number(
        0.2, 1e-3, 1.0, "a of the density Beta(a, 1) of p of disturbed ones, set by hand"
    )
    disturbed_prior: tuple[float, ...] = numbers(
        (1.0, 9.0), 0.0, 1e6, "Beta prior of the share of disturbed observations, set by hand"
    )
    largest_share: float = number(
        0.5, 1e-3, 1.0, "share of disturbed observations at most: most are good"
    )
    least_good: float = number(
        0.5, 0.0, 1.0, "probability of being good below which an observation is doubtful"
    )

    def __post_init__(self) -> None:
        check_settings(self)
