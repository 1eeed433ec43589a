"""Whether the predicted probabilities are true, on a small synthetic set."""

from __future__ import annotations

from dataclasses import dataclass

from intuitive_physics_experiments.calibration.options import CalibrationOptions
from intuitive_physics_experiments.calibration.paper_calibration import calibrate_on_paper_set


@dataclass(frozen=True)
class Truth:
    """What a calibration found."""

    # runs of each object in the synthetic set; θ_s is learned from a part of the runs, the noise is
    # fitted to another, the rest is held out
    samples: int
    coverage_90: dict[str, float]  # share of what happened that lay in the 90 % region, by s ahead
    # largest over the times ahead of the mean energy score over that of the best baseline; below 1
    # ours is better than all of them at all times
    score_ratio: float


def truth(options: CalibrationOptions) -> Truth:
    """Learn, fit the noise and score predictions on the paper's synthetic set."""
    found = calibrate_on_paper_set(options).summary()
    ratio = found["energy_score_vs_best_baseline"]
    return Truth(options.throws, found["coverage_90"], ratio)
