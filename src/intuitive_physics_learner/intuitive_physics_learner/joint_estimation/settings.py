"""Numbers that joint estimation was tuned with, each with its unit and where it comes from."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.settings import check_settings, number, other


def _hand_set(
    default: float, lower: float, upper: float, description: str, *, unit: str = ""
) -> Any:
    """A number without a derivation."""
    return number(default, lower, upper, f"{description}; set by hand", unit=unit)


ENDLESS_PATIENCE = 1000
"""Steps with a misfit that a fit up to a given horizon bears: more than it takes."""


@dataclass(frozen=True)
class JointEstimationSettings:
    """How θ_s and initial states are estimated together.

    A field that says "set by hand" has no derivation: it was set when the estimator was written,
    and the synthetic sets of `make bench-learning` are what it was run on with that value. Lengths
    in σ are in standard deviations of the noise of an observed position on one axis. Lengths in
    widths are parts of the unit interval that each parameter of θ_s is searched on.
    """

    smallest_noise: float = number(
        1e-4,
        1e-9,
        1.0,
        "noise of an observed position at least: no camera measures better, and what is divided by "
        "it stays well conditioned",
        unit="m",
    )
    pooled_differences: float = number(
        20.0,
        0.0,
        1e6,
        "differences as which the noise of all tracks counts beside a track's own: the median of "
        "as many has a relative error of a quarter",
    )
    prior_widening: float = _hand_set(
        10.0,
        1.0,
        1e6,
        "factor on the standard deviations of the observed initial position and velocity: most of "
        "what is known of them comes from points of the very trajectory they are to explain, which "
        "must not count twice",
    )

    widens_spins: bool = other(
        True,
        "after each step, the prior of initial spins that were guesses is as wide as the spread "
        "that the observations show, where that is wider than the guess; false: it stays as it is",
    )

    difference_step: float = _hand_set(
        0.5,
        1e-3,
        10.0,
        "step of a finite difference to each side: a slope is that of the region where the truth "
        "is likely to be",
        unit="standard deviations of what is moved",
    )
    smallest_difference: float = _hand_set(
        1e-6,
        1e-12,
        1e-2,
        "step of a finite difference at least, in the unit of what is moved (width, m, m/s, rad or "
        "rad/s)",
    )
    largest_difference: float = _hand_set(
        0.05,
        1e-6,
        1.0,
        "step of a finite difference at most, in the unit of what is moved (width, m, m/s, rad or "
        "rad/s)",
    )
    largest_state_deviation: float = _hand_set(
        0.3,
        1e-3,
        100.0,
        "standard deviation of a component of an initial state (m, m/s, rad or rad/s) that the "
        "first finite differences assume at most",
    )

    outlier_length: float = _hand_set(
        3.0,
        0.1,
        100.0,
        "length of a residual from which on Huber's loss grows linearly",
        unit="σ",
    )

    agreement_freedom: float = number(
        4.0,
        0.1,
        1e6,
        "degrees of freedom of Student's distribution by which observations that contradict all "
        "others count less; the value that is usual for robust regression (Lange, Little and "
        "Taylor 1989)",
    )
    held_steps: int = _hand_set(
        3, 1, 1000, "steps of initial states alone by which two θ_s are compared"
    )
    largest_vote: float = number(
        3.0,
        0.1,
        1e6,
        "loss that a single observation counts at most when two θ_s are compared: a likelihood "
        "ratio of e³ ≈ 20, hardly chance",
    )

    first_damping: float = _hand_set(
        1e-2, 1e-12, 1e12, "damping of the first Levenberg-Marquardt step, a part of the diagonal"
    )
    damping_factors: tuple[float, ...] = other(
        (0.1, 1.0, 10.0, 100.0),
        "factors on the last damping that are tried in one step; set by hand",
    )
    smallest_damping: float = _hand_set(1e-6, 0.0, 1e12, "damping at least")
    largest_damping: float = _hand_set(1e4, 0.0, 1e12, "damping at most")
    largest_move: float = _hand_set(
        0.2, 1e-3, 1.0, "by which a parameter moves at most in one step", unit="widths"
    )
    settled_move: float = _hand_set(
        0.02,
        0.0,
        10.0,
        "largest move of any parameter of a step that has converged",
        unit="standard deviations of the parameter",
    )
    settled_steps: int = _hand_set(
        2, 1, 1000, "consecutive converged steps after which the fit has converged"
    )

    first_points: int = _hand_set(
        10, 1, 10_000, "points of each object that the first fit horizon includes at most"
    )
    first_duration: float = _hand_set(0.5, 0.0, 1e4, "the first fit horizon at most", unit="s")
    largest_advance: float = _hand_set(
        0.2, 0.0, 1e4, "by which a fit horizon advances at most in one step", unit="s"
    )
    largest_spread: float = _hand_set(
        0.15,
        0.0,
        1e4,
        "standard deviation of a predicted position up to which it may enter the fit",
        unit="m",
    )
    largest_bend: float = _hand_set(
        2.0,
        0.0,
        1e4,
        "linearisation error of a predicted position up to which it may enter the fit",
        unit="σ",
    )
    largest_bend_share: float = _hand_set(
        1.0,
        0.0,
        1e4,
        "further linearisation error allowed, a part of the standard deviation of the predicted "
        "position",
    )
    misfit_false_alarm: float = number(
        1e-3,
        1e-9,
        0.5,
        "misfits that noise alone is expected to feign in one observation: fewer than one in the "
        "hundreds of observations of a large set",
    )
    misfit_points: int = _hand_set(
        9, 1, 1000, "neighbouring points whose median length is compared with that of noise"
    )
    retreat: float = _hand_set(
        0.3, 0.0, 1e4, "before the first misfit, to where a fit horizon retreats", unit="s"
    )
    misfit_patience: int = _hand_set(
        1, 1, 1000, "steps with a misfit after which the fit horizon retreats"
    )

    scan_levels: tuple[float, ...] = other(
        (0.02, 0.14, 0.26, 0.38, 0.5, 0.62, 0.74, 0.86, 0.98),
        "places on the unit interval at which a scan tries each parameter: equal steps that leave "
        "out the bounds themselves",
    )
    scan_steps: tuple[int, ...] = other(
        (2, 5, 9, 14), "numbers of steps after which the fit scans each parameter; set by hand"
    )
    separate_steps: int = number(
        20,
        1,
        1000,
        "steps at most of the fits to objects that moved alone, each object by itself, before all "
        "observations are fitted jointly; in the same time 20 and 40 gave the same excess on four "
        "sets of ten objects",
    )
    smallest_separate_share: float = number(
        0.3,
        0.0,
        1.0,
        "share of the observations that are of objects alone from which on these are fitted first; "
        "half of those of the paper's sets are, where that is better; set by hand; 1: jointly from "
        "the beginning unless all moved alone",
    )
    smallest_scan_gain: float = number(
        3.0,
        0.0,
        1e6,
        "loss that a scanned value must gain to be taken: a likelihood ratio of e³ ≈ 20, hardly "
        "chance",
    )

    curvature_widening: float = _hand_set(
        3.0,
        0.1,
        100.0,
        "factor on the steps of the finite differences from which the posterior is computed",
    )
    move_rounds: int = _hand_set(
        8,
        1,
        100,
        "rounds of moving a parameter outwards from the estimate, and of bisecting the end",
    )
    move_growth: float = _hand_set(
        3.0, 1.0, 100.0, "factor on the distance from one round outwards to the next"
    )
    largest_move_rise: float = number(
        4.5,
        0.0,
        5.9,
        "rise of the loss up to which a move is plausible, that of three standard deviations: a "
        "fit may gain more than that of two by making a ball slip that does not; below the 6 of a "
        "parabola at 2 √3 standard deviations",
    )
    one_sided_deviations: float = number(
        2.0,
        1.0,
        100.0,
        "distance, in those of a uniform distribution with the parameter's standard deviation, "
        "beyond which a plausible move gives a one-sided interval; as that of J",
    )
    fewest_observations: int = number(
        4, 2, 1000, "observations from which on fits to two halves are compared: two in each half"
    )
    family_weight: float = _hand_set(
        3.0,
        0.0,
        1e6,
        "number of parameters as which the typical disagreement of the halves counts against that "
        "of a parameter's own family",
    )
    largest_chance_ratio: float = _hand_set(
        2.0,
        1.0,
        1e6,
        "ratio of the halves' distance from the estimate to its expectation beyond which that "
        "distance is itself the uncertainty",
    )

    largest_misfit_share: float = number(
        0.3,
        0.0,
        1.0,
        "mean share of observations with a misfit above which the simulation must lack an effect: "
        "just below the third that a fit horizon counts which advances twice and retreats once for "
        "ever",
    )
    misfit_steps: int = _hand_set(3, 1, 1000, "steps that this mean is over")

    descent_dampings: tuple[float, ...] = other(
        (1e-3, 1e-2, 0.1, 1.0, 10.0),
        "dampings, parts of the diagonal, that a descent of J tries in one step; set by hand",
    )
    descent_lengths: tuple[float, ...] = other(
        (0.5, 1.0, 2.0),
        "factors on each damped step that are tried: J has kinks, which a step may fall short of; "
        "set by hand",
    )
    first_width: float = _hand_set(
        0.1,
        1e-6,
        1.0,
        "over which a descent of J takes its first slopes: wide against the kinks of single "
        "contacts",
        unit="widths",
    )
    smallest_width: float = _hand_set(
        0.002, 1e-9, 1.0, "below which a descent of J takes no more slopes", unit="widths"
    )
    width_factor: float = _hand_set(
        0.4, 1e-3, 0.999, "factor on that width when steps along slopes gain nothing"
    )
    neighbours: tuple[float, ...] = other(
        (-3.0, -1.0, -0.3, 0.3, 1.0, 3.0),
        "distances, in that width, at which each parameter is tried when steps along slopes gain "
        "nothing; set by hand",
    )
    smallest_gain: float = _hand_set(1e-4, 0.0, 1.0, "part of J by which it must fall to be a gain")
    largest_sampled: int = _hand_set(
        40, 0, 10_000, "parameters up to which a descent of J ends with random trials"
    )
    sampling_patience: int = _hand_set(
        300, 1, 10_000_000, "random trials without gain after which the descent of J ends"
    )
    short_length: float = _hand_set(
        0.1,
        1e-6,
        1.0,
        "part of the median distance below which distances count as squares in a descent of J: a "
        "sum of distances has no slope at zero",
    )

    def __post_init__(self) -> None:
        check_settings(self)

    def with_fixed_horizons(self) -> JointEstimationSettings:
        """Return the settings of a fit whose horizons stay, and that scans nothing."""
        return replace(
            self,
            largest_advance=0.0,
            misfit_patience=ENDLESS_PATIENCE,
            scan_steps=(),
            widens_spins=False,
        )

    def difference_steps(self, deviations: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the steps (...,) of finite differences, in the unit of each deviation.

        `deviations` (...,) standard deviations of what is moved, in the unit of each.
        """
        steps = self.difference_step * deviations
        return np.clip(steps, self.smallest_difference, self.largest_difference)
