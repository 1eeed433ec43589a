"""Settings in which fits to trajectories differ, by their purpose."""

from __future__ import annotations

from dataclasses import dataclass

from intuitive_physics.settings import check_settings, number, other


@dataclass(frozen=True)
class JointEstimationSettings:
    """The schedule of a fit. All other numbers of the estimation are constants beside their use.

    A number that says "set by hand" has no derivation: it was set when the estimator was written,
    and the synthetic sets of `make bench-learning` are what it was run on with that value. Lengths
    in σ are in standard deviations of the noise of an observed position on one axis. Lengths in
    widths are parts of the unit interval that each parameter of θ_s is searched on.
    """

    largest_advance: float = number(
        0.2,
        0.0,
        1e4,
        "by which a fit horizon advances at most in one step; 0: horizons stay as they are given, "
        "and so does the spread of initial spins; set by hand",
        unit="s",
    )
    scan_steps: tuple[int, ...] = other(
        (2, 5, 9, 14), "numbers of steps after which the fit scans each parameter; set by hand"
    )

    def __post_init__(self) -> None:
        check_settings(self)


FIXED_HORIZONS = JointEstimationSettings(largest_advance=0.0, scan_steps=())
"""Those of a fit up to given horizons, that scans nothing."""
