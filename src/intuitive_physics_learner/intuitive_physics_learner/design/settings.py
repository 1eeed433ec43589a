"""Numbers that the choice of the next throw depends on, each with its unit and its source."""

from __future__ import annotations

from dataclasses import dataclass

from intuitive_physics.settings import check_settings, number, other
from intuitive_physics_learner.joint_estimation import JointEstimationSettings


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
    refinements: tuple[float, ...] = other(
        (0.15, 0.05),
        "standard deviations, parts of the ranges' widths, by which throws that are compared next "
        "differ from the best so far, round after round; set by hand",
    )
    refined: int = number(
        6, 1, 1000, "best throws that are refined, as many as are suggested at least; set by hand"
    )
    neighbours: int = number(
        8, 0, 10_000, "throws near each of them in each round of refinement; set by hand"
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
    parameter_step: float = number(
        0.005,
        1e-9,
        0.5,
        "width of the differences along parameters: small, as draws cover the posterior; set by "
        "hand",
    )
    state_step: float = number(
        0.002,
        1e-9,
        1.0,
        "width of the differences along components of initial states (m, m/s, rad or rad/s); set "
        "by hand",
    )
    query_draws: int = number(
        256,
        8,
        100_000,
        "draws of θ_s by which the dependence of a query's answer on θ_s is found; set by hand",
    )
    most_observations: int = number(
        500,
        1,
        1_000_000,
        "newest stored observations at most from which ranges, noise and view are read, so that a "
        "suggestion takes as long after years as after a day; set by hand",
    )
    view_margin: float = number(
        0.1,
        0.0,
        10.0,
        "by which the region in view is larger than what was seen of it, a part of its largest "
        "extent: few tracks reach its edges; set by hand",
    )
    estimation: JointEstimationSettings = other(
        JointEstimationSettings(),
        "of the estimation that the throw is for: which detections it can predict, and so use",
    )

    def __post_init__(self) -> None:
        check_settings(self)
