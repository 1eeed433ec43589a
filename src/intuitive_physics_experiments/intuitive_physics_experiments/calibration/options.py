"""Options of a calibration; the command line has them too."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf

from intuitive_physics.settings import check_settings, number, other

# s ahead at which predictions of the synthetic set, and of observations, are scored.
HORIZONS, OBSERVED_HORIZONS = (0.5, 1.0, 2.0, 5.0), (0.1, 0.2, 0.4, 0.6)


@dataclass(frozen=True)
class CalibrationOptions:
    """Options of a calibration on the paper's synthetic set, or on observations."""

    horizons: Sequence[float] = HORIZONS  # s after the last point that is seen
    kinds: Sequence[str] = ()  # shapes of the synthetic set; none: those of the paper
    # points that are seen of synthetic objects, for the error against how much was seen
    point_counts: Sequence[int] = (3, 5, 10, 15)
    splits: int = number(
        1,
        1,
        inf,
        "parts that the observations fall into, each of which is held out once and predicted with "
        "what the others taught; 1: one half is held out",
    )
    points: int = number(10, 3, inf, "points that are seen of each object")
    objects: int = number(3, 1, inf, "objects in the synthetic set")
    throws: int = number(
        60, 1, inf, "throws of each synthetic object, to learn from and to fit the noise to"
    )
    # A true 90 % is seen as 90 % ± 30 / √n % of n trajectories, and objects thrown together share
    # their fate.
    held_out: int = number(100, 1, inf, "more throws of each synthetic object, to score on")
    samples: int = number(100, 4, inf, "simulations of each prediction")
    iterations: int = number(2500, 1, inf, "evaluations of J at most")
    engine: str = other("auto", "simulator that makes the set, learns and predicts")
    cores: int = number(1, 1, inf, "splits that are made at the same time")
    seed: int = number(0, 0, inf, "of all randomness")

    def __post_init__(self) -> None:
        check_settings(self)
