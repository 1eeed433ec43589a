"""Whether predicted regions hold what they claim: how often a p-region contains what was seen."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_cli.evaluation.prediction_case import PredictionCase
from intuitive_physics_predictor.scores.highest_density import coverage, highest_density_levels

LEVELS = np.linspace(0.05, 0.95, 19)
POINTS_JUDGED = 30
"""Of each case, evenly over its time: neighbours tell the same."""


def region_coverage(
    cases: Sequence[PredictionCase], noise: float, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Share of points inside the highest-density region of each of `LEVELS`, shape (19,).

    Every case counts the same.

    Parameters
    ----------
    cases : at least one
    noise : m, standard deviation of a point that was seen, which its prediction does not have
    """
    shares = []
    for case in cases:
        count = case.times.size
        judged = np.unique(np.linspace(0, count - 1, POINTS_JUDGED).round().astype(int))
        samples = case.samples[:, judged]
        samples = samples + rng.normal(0.0, noise, samples.shape)
        levels = [
            highest_density_levels(samples[:, k], case.observed[point])
            for k, point in enumerate(judged)
        ]
        shares.append([coverage(levels, level) for level in LEVELS])
    return np.asarray(np.mean(shares, axis=0))
