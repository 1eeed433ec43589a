"""Fit the noise to the past and score predictions, ours and baselines, of what was held out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import minimize_scalar

from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.simulation import Simulator
from intuitive_physics.state import ObjectState
from intuitive_physics_cli.evaluation.evaluation import free_flight
from intuitive_physics_predictor.noise import StateNoise, StateSpread
from intuitive_physics_predictor.noise_scales import NOISE_SCALES, NoiseScales
from intuitive_physics_predictor.noisy_newton import predict
from intuitive_physics_predictor.scores.highest_density import (
    FEWEST_SAMPLES,
    coverage,
    highest_density_levels,
)
from intuitive_physics_predictor.scores.noise_fit import (
    FITTED_SCALES,
    NoiseFit,
    fit_noise_scales,
    spread_weights,
    weighted_energy_scores,
)
from intuitive_physics_predictor.scores.outcomes import (
    Outcome,
    Prediction,
    noisy_prediction,
    predict_outcomes,
)
from intuitive_physics_predictor.scores.proper_scores import crps, energy_scores

REGIONS = (0.5, 0.9)  # Probabilities of the regions whose coverage is reported


@dataclass(frozen=True, eq=False)
class Scores:
    """Scores of one way to predict, for each trajectory at each horizon."""

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
        by_horizon = self.levels.swapaxes(0, 1)
        known = [levels[~np.isnan(levels).any(axis=1)] for levels in by_horizon]
        return np.array([coverage(levels, probability) for levels in known])

    @staticmethod
    def pooled(parts: Sequence[Scores]) -> Scores:
        """Return those of all trajectories of several sets, at least one."""
        names = [field.name for field in fields(Scores)]
        return Scores(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


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


def _levels(samples: NDArray[np.float64], positions: NDArray[np.float64]) -> NDArray[np.float64]:
    levels = np.full((*positions.shape[:2], 2), np.nan)
    if len(samples) < FEWEST_SAMPLES:
        return levels
    for which, time in np.argwhere(~np.isnan(positions).any(axis=-1)):
        levels[which, time] = highest_density_levels(
            samples[:, which, time], positions[which, time]
        )
    return levels


# m, rad, m/s and rad/s. The paper has one noise model, N(0, 0.02); it does not say what it adds to
# each part of θ_d.
FIXED_NOISE = 0.02

LARGEST_FIXED_NOISE = 10.0  # m, upper bound of the search for the fixed noise


def fixed_noise(
    learned: LearnedParameters, deviation: float, sample_count: int, simulator: Simulator
) -> Prediction:
    """Return the paper's noisy Newton: Gaussian noise of one size on θ_d, θ_s as learned."""
    noise = StateNoise(False, deviation, deviation, deviation, deviation)

    def sample(outcome: Outcome, rng: np.random.Generator) -> NDArray[np.float64]:
        return predict(
            outcome.scene,
            learned.parameters.extended(outcome.scene.materials),
            outcome.times,
            rng=rng,
            sample_count=sample_count,
            noise=noise,
            simulator=simulator,
        ).positions

    return sample


def fitted_fixed_noise(
    outcomes: Sequence[Outcome],
    learned: LearnedParameters,
    sample_count: int,
    simulator: Simulator,
    seed: int,
) -> float:
    """Return the fixed noise whose predictions of `outcomes` have the best energy score."""

    def way(deviation: float) -> Prediction:
        return fixed_noise(learned, deviation, sample_count, simulator)

    weights = spread_weights(outcomes, way(FIXED_NOISE), seed)
    reference = weighted_energy_scores(outcomes, way(FIXED_NOISE), weights, seed)

    def relative_score(logarithm: float) -> float:
        scores = weighted_energy_scores(outcomes, way(np.exp(logarithm)), weights, seed)
        return float(np.nanmean(scores / reference))

    fit = minimize_scalar(
        relative_score,
        bounds=(np.log(0.1 * FIXED_NOISE), np.log(LARGEST_FIXED_NOISE)),
        method="bounded",
        options={"maxiter": 15},
    )
    return float(np.exp(fit.x))


def free_flights(sample_count: int) -> Prediction:
    """Return flights from noisy states, as uncertain as perceived, to the first plane they reach.

    Nothing of θ_s is used; objects count as their bounding spheres.
    """

    def sample(outcome: Outcome, rng: np.random.Generator) -> NDArray[np.float64]:
        scene = outcome.scene
        states = StateSpread.of(scene.states, StateNoise()).draw(sample_count, rng)
        return np.array(
            [
                [
                    free_flight(
                        scene.environment,
                        scene_object.shape.bounding_radius,
                        ObjectState.from_vector(state),
                        outcome.times,
                    )
                    for scene_object, state in zip(scene.objects, world, strict=True)
                ]
                for world in states
            ]
        )

    return sample


OURS = "noisy Newton"  # Name of the predictions that are calibrated, beside the baselines

# One simulation, noisy Newton as in the paper, and no material parameters at all.
BASELINES = ("single rollout", "fixed noise", "free flight")

# The paper's noisy Newton with what ours has, too: noise of the size that suits the past.
FITTED = "fixed noise, fitted"


# Outcomes that are drawn from each prediction, to see how it would score if it were true.
IDEAL_DRAWS = 10


@dataclass(frozen=True, eq=False)
class Calibration:
    """Result of a calibration, of one set that was held out or of several together."""

    horizons: NDArray[np.float64]  # (n_horizons,) s after the last point that was seen
    scores: dict[str, Scores]  # of each way to predict, by name; `OURS` and the baselines
    fits: tuple[NoiseFit, ...]  # noise scales, fitted to the past of each set
    # m, rad, m/s and rad/s, of the fixed noise that suits the past of each best
    fixed_deviations: tuple[float, ...]
    # (n, n_horizons) m, by name, energy scores of `OURS` and `FITTED` if what happened were drawn
    # from `OURS`
    ideal: dict[str, NDArray[np.float64]]

    @staticmethod
    def pooled(parts: Sequence[Calibration]) -> Calibration:
        """Return that of several sets, at least one, which were held out in turn."""
        return Calibration(
            parts[0].horizons,
            {
                name: Scores.pooled([part.scores[name] for part in parts])
                for name in parts[0].scores
            },
            tuple(fit for part in parts for fit in part.fits),
            tuple(deviation for part in parts for deviation in part.fixed_deviations),
            {name: np.concatenate([part.ideal[name] for part in parts]) for name in parts[0].ideal},
        )

    @property
    def scales(self) -> NoiseScales:
        """Noise scales: the median of each over the sets."""
        return NoiseScales(
            **{
                name: float(np.median([getattr(fit.scales, name) for fit in self.fits]))
                for name in NOISE_SCALES
            }
        )

    @property
    def energy_score_vs_best_baseline(self) -> NDArray[np.float64]:
        """Mean energy score over that of the best of `BASELINES` at each horizon, (n_horizons,)."""
        means = np.array([np.nanmean(self.scores[name].energy, axis=0) for name in BASELINES])
        return np.asarray(np.nanmean(self.scores[OURS].energy, axis=0) / means.min(axis=0))

    @property
    def energy_score_vs_fitted_noise(self) -> NDArray[np.float64]:
        """Energy score over that of the fitted fixed noise at each horizon, (n_horizons,).

        Where all states are perceived alike, one size of noise can do all that their covariances
        do, and the best there is has a ratio of 1.
        """
        ratios, _ = ratios_of_means(self.scores[OURS].energy, self.scores[FITTED].energy)
        return ratios

    @property
    def ideal_energy_score_vs_fitted_noise(self) -> NDArray[np.float64]:
        """`energy_score_vs_fitted_noise` (n_horizons,) of outcomes that are drawn from `OURS`.

        The score is proper, so that nothing then scores better: with what is known of states and
        θ_s, a true prediction has this ratio, and only knowing more makes it smaller.
        """
        ratios, _ = ratios_of_means(self.ideal[OURS], self.ideal[FITTED])
        return ratios


def ratios_of_means(
    scores: NDArray[np.float64], others: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return ratios (n_horizons,) of mean scores, and their standard errors to first order.

    The `scores` (n, n_horizons) m and `others` (n, n_horizons) m are of the same trajectories, NaN
    where the outcome is not known.
    """
    mean = np.nanmean(others, axis=0)
    ratios = np.nanmean(scores, axis=0) / mean
    off = (scores - ratios * others) / mean
    count = (~np.isnan(off)).sum(axis=0)
    return np.asarray(ratios), np.asarray(np.sqrt(np.nanmean(off**2, axis=0) / count))


def ideal_energy_scores(
    outcomes: Sequence[Outcome], truth: Prediction, prediction: Prediction, seed: int
) -> NDArray[np.float64]:
    """Return mean energy scores (n, n_horizons) m of a prediction if another one is the truth.

    The truth draws `IDEAL_DRAWS` outcomes for each; NaN where the position was not seen.
    """
    rows = []
    for outcome, happened, samples in zip(
        outcomes,
        predict_outcomes(outcomes, truth, seed + 1),
        predict_outcomes(outcomes, prediction, seed),
        strict=True,
    ):
        drawn = np.where(np.isnan(outcome.positions), np.nan, happened[:IDEAL_DRAWS])
        rows.append(np.mean([energy_scores(samples, positions) for positions in drawn], axis=0))
    return np.concatenate(rows)


def calibrate(
    past: Sequence[Outcome],
    held_out: Sequence[Outcome],
    learned: LearnedParameters,
    horizons: ArrayLike,
    *,
    scales_to_fit: Sequence[str] = FITTED_SCALES,
    start: NoiseScales | None = None,
    sample_count: int,
    seed: int,
    simulator: Simulator,
) -> Calibration:
    """Fit the noise to the past, then score predictions of held-out outcomes.

    The past may be the outcomes that θ_s was learned from; their times are `horizons` (n_horizons,)
    s. `scales_to_fit` and `start` are those of `fit_noise_scales`; the fits take half of
    `sample_count` simulations.
    """
    few = max(sample_count // 2, FEWEST_SAMPLES)
    fit = fit_noise_scales(
        past,
        learned,
        names=scales_to_fit,
        start=start,
        seed=seed,
        sample_count=few,
        simulator=simulator,
    )
    fixed = fitted_fixed_noise(past, learned, few, simulator, seed)
    once, paper, flight = BASELINES
    ways: dict[str, Prediction] = {
        OURS: noisy_prediction(learned, fit.scales, sample_count, simulator),
        once: fixed_noise(learned, 0.0, 1, simulator),
        paper: fixed_noise(learned, FIXED_NOISE, sample_count, simulator),
        flight: free_flights(sample_count),
        FITTED: fixed_noise(learned, fixed, sample_count, simulator),
    }
    scores = {name: score(held_out, way, seed + 1) for name, way in ways.items()}
    ideal = {
        name: ideal_energy_scores(held_out, ways[OURS], ways[name], seed + 1)
        for name in (OURS, FITTED)
    }
    return Calibration(np.asarray(horizons, dtype=np.float64), scores, (fit,), (fixed,), ideal)
