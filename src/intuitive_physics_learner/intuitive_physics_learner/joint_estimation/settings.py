"""Settings in which fits to trajectories differ, by their purpose."""

from __future__ import annotations

from dataclasses import dataclass, replace

from intuitive_physics.settings import check_settings, number, other

ENDLESS_PATIENCE = 1000
"""Steps with a misfit that a fit up to a given horizon bears: more than it takes."""


@dataclass(frozen=True)
class JointEstimationSettings:
    """The schedule of a fit. All other numbers of the estimation are constants beside their use.

    A number that says "set by hand" has no derivation: it was set when the estimator was written,
    and the synthetic sets of `make bench-learning` are what it was run on with that value. Lengths
    in σ are in standard deviations of the noise of an observed position on one axis. Lengths in
    widths are parts of the unit interval that each parameter of θ_s is searched on.
    """

    largest_advance: float = number(
        0.2, 0.0, 1e4, "by which a fit horizon advances at most in one step; set by hand", unit="s"
    )
    misfit_patience: int = number(
        1, 1, 1000, "steps with a misfit after which the fit horizon retreats; set by hand"
    )
    scan_steps: tuple[int, ...] = other(
        (2, 5, 9, 14), "numbers of steps after which the fit scans each parameter; set by hand"
    )
    widens_spins: bool = other(
        True,
        "after each step, the prior of initial spins that were guesses is as wide as the spread "
        "that the observations show, where that is wider than the guess; false: it stays as it is",
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
