"""Scores of predictions against what then happened."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_predictor.scores.highest_density import (
    FEWEST_SAMPLES,
    coverage,
    highest_density_levels,
)
from intuitive_physics_predictor.scores.outcomes import Outcome, Prediction, predict_outcomes
from intuitive_physics_predictor.scores.proper_scores import crps, energy_scores

REGIONS = (0.5, 0.9)
"""Probabilities of the regions whose coverage is reported."""


@dataclass(frozen=True, eq=False)
class Scores:
    """How one way to predict did, for each trajectory at each horizon."""

    # (n, n_horizons, 2) of `highest_density_levels`; NaN where there is one sample only, or the
    # outcome is not known
    levels: NDArray[np.float64]
    energy: NDArray[np.float64]  # (n, n_horizons) m, energy score
    crps: NDArray[np.float64]  # (n, n_horizons) m, mean over the axes
    error: NDArray[np.float64]  # (n, n_horizons) m, distance of the samples' mean
    # (n, n_horizons) m, root mean square distance of the samples from their mean
    spread: NDArray[np.float64]

    def coverage(self, probability: float) -> NDArray[np.float64]:
        """Share of outcomes inside the region of that probability, (n_horizons,)."""
        return np.array([coverage(known(at), probability) for at in self.levels.swapaxes(0, 1)])

    @staticmethod
    def pooled(parts: Sequence[Scores]) -> Scores:
        """Return those of all trajectories of several sets, at least one."""
        names = [field.name for field in fields(Scores)]
        return Scores(*(np.concatenate([getattr(one, name) for one in parts]) for name in names))


def score(outcomes: Sequence[Outcome], prediction: Prediction, seed: int) -> Scores:
    """Predict every outcome and compare; all have the same number of times, the horizons."""
    parts = []
    for outcome, samples in zip(
        outcomes, predict_outcomes(outcomes, prediction, seed), strict=True
    ):
        mean = samples.mean(axis=0)
        parts.append(
            (
                _levels(samples, outcome.positions),
                energy_scores(samples, outcome.positions),
                crps(samples, outcome.positions).mean(axis=-1),
                np.linalg.norm(mean - outcome.positions, axis=-1),
                np.sqrt(((samples - mean) ** 2).sum(axis=-1).mean(axis=0)),
            )
        )
    return Scores(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def known(levels: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rows (n_known, 2) of levels (n, 2) whose outcome is known: those without NaN."""
    return levels[~np.isnan(levels).any(axis=1)]


def _levels(samples: NDArray[np.float64], positions: NDArray[np.float64]) -> NDArray[np.float64]:
    levels = np.full((*positions.shape[:2], 2), np.nan)
    if len(samples) < FEWEST_SAMPLES:
        return levels
    for which, time in np.argwhere(~np.isnan(positions).any(axis=-1)):
        levels[which, time] = highest_density_levels(
            samples[:, which, time], positions[which, time]
        )
    return levels
