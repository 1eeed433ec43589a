"""Are the predicted probabilities true? Coverage and proper scores on held-out outcomes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.simulation import Simulator, make_simulator
from intuitive_physics_experiments.calibration_baselines import (
    FIXED_NOISE,
    fitted_fixed_noise,
    fixed_noise,
    free_flights,
    single_rollout,
)
from intuitive_physics_predictor.highest_density import (
    FEWEST_SAMPLES,
    coverage,
    highest_density_levels,
)
from intuitive_physics_predictor.noise_fit import NoiseFit, fit_noise_scales
from intuitive_physics_predictor.noise_scales import NoiseScales
from intuitive_physics_predictor.outcomes import (
    Outcome,
    Prediction,
    noisy_prediction,
    predict_outcomes,
)
from intuitive_physics_predictor.scores import crps, energy_scores

OURS = "noisy Newton"
REGIONS = (0.5, 0.9)
"""Probabilities of the regions whose coverage is reported."""


@dataclass(frozen=True, eq=False)
class Scores:
    """How one way to predict did, for each trajectory at each horizon.

    Parameters
    ----------
    levels : (n, n_horizons, 2) of `highest_density_levels`; NaN where there is one sample only, or
        the outcome is not known
    energy : (n, n_horizons) m, energy score
    crps : (n, n_horizons) m, mean over the axes
    error : (n, n_horizons) m, distance of the samples' mean
    spread : (n, n_horizons) m, root mean square distance of the samples from their mean
    """

    levels: NDArray[np.float64]
    energy: NDArray[np.float64]
    crps: NDArray[np.float64]
    error: NDArray[np.float64]
    spread: NDArray[np.float64]

    def coverage(self, probability: float) -> NDArray[np.float64]:
        """Share of outcomes inside the region of that probability, (n_horizons,)."""
        return np.array([coverage(known(at), probability) for at in self.levels.swapaxes(0, 1)])


def score(outcomes: Sequence[Outcome], prediction: Prediction, seed: int) -> Scores:
    """Predict every outcome and compare.

    Parameters
    ----------
    outcomes : at least one, all with the same number of times: the horizons
    """
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
    """Rows (n, 2) without those of outcomes that are not known."""
    return levels[~np.isnan(levels).any(axis=1)]


def _levels(samples: NDArray[np.float64], positions: NDArray[np.float64]) -> NDArray[np.float64]:
    levels = np.full((*positions.shape[:2], 2), np.nan)
    if len(samples) < FEWEST_SAMPLES:
        return levels
    for thing, time in np.argwhere(~np.isnan(positions).any(axis=-1)):
        levels[thing, time] = highest_density_levels(
            samples[:, thing, time], positions[thing, time]
        )
    return levels


@dataclass(frozen=True, eq=False)
class Calibration:
    """What a calibration found.

    Parameters
    ----------
    horizons : (n_horizons,) s after the last point that was seen
    scores : of each way to predict, by name; `OURS` and the baselines
    fit : noise scales, fitted to the past
    fixed_deviation : of the fixed noise that suits the past best
    """

    horizons: NDArray[np.float64]
    scores: dict[str, Scores]
    fit: NoiseFit
    fixed_deviation: float

    @property
    def energy_score_vs_best_baseline(self) -> NDArray[np.float64]:
        """Mean energy score over that of the best baseline at each horizon, (n_horizons,)."""
        means = {name: np.nanmean(kept.energy, axis=0) for name, kept in self.scores.items()}
        ours = means.pop(OURS)
        return np.asarray(ours / np.min(list(means.values()), axis=0))


def calibrate(
    past: Sequence[Outcome],
    held_out: Sequence[Outcome],
    learned: LearnedParameters,
    horizons: ArrayLike,
    *,
    scales_to_fit: Sequence[str] = ("state", "static_parameters"),
    start: NoiseScales | None = None,
    sample_count: int = 100,
    seed: int = 0,
    simulator: Simulator | None = None,
) -> Calibration:
    """Fit the noise to the past, then score predictions of what was held out.

    Parameters
    ----------
    past : outcomes that θ_s was learned from, or others that are not held out
    held_out : outcomes to score on
    learned : θ_s
    horizons : (n_horizons,) s, what the outcomes' times mean
    scales_to_fit, start : as in `fit_noise_scales`
    sample_count : of all predictions but the single rollout; fits take half of it
    """
    engine = simulator or make_simulator("auto")
    few = max(sample_count // 2, FEWEST_SAMPLES)
    fit = fit_noise_scales(
        past,
        learned,
        names=scales_to_fit,
        start=start,
        seed=seed,
        sample_count=few,
        simulator=engine,
    )
    fixed = fitted_fixed_noise(past, learned, few, engine, seed)
    ways: dict[str, Prediction] = {
        OURS: noisy_prediction(learned, fit.scales, sample_count, engine),
        "single rollout": single_rollout(learned, engine),
        "fixed noise": fixed_noise(learned, FIXED_NOISE, sample_count, engine),
        "fixed noise, fitted": fixed_noise(learned, fixed, sample_count, engine),
        "free flight": free_flights(sample_count),
    }
    scores = {name: score(held_out, way, seed + 1) for name, way in ways.items()}
    return Calibration(np.asarray(horizons, dtype=np.float64), scores, fit, fixed)
