"""Fit the noise to the past and score predictions, ours and baselines, of what was held out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import minimize_scalar

from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.simulation import Simulator, make_simulator
from intuitive_physics.state import ObjectState
from intuitive_physics_cli.evaluation.evaluation import free_flight
from intuitive_physics_experiments.calibration.verification import Scores, score
from intuitive_physics_predictor.noise import StateNoise, StateSpread
from intuitive_physics_predictor.noise_scales import NoiseScales
from intuitive_physics_predictor.noisy_newton import predict
from intuitive_physics_predictor.scores.highest_density import FEWEST_SAMPLES
from intuitive_physics_predictor.scores.noise_fit import (
    FITTED_SCALES,
    NoiseFit,
    fit_noise_scales,
    spread_weights,
    weighted_energy_scores,
)
from intuitive_physics_predictor.scores.outcomes import Outcome, Prediction, noisy_prediction

FIXED_NOISE = 0.02
"""m, rad, m/s and rad/s. The paper has one noise model, N(0, 0.02); it does not say what it adds to
each part of θ_d."""

LARGEST_FIXED_NOISE = 10.0
"""m, upper bound of the search for the fixed noise."""


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
    evaluations: int = 15,
) -> float:
    """Return the fixed noise whose predictions of `outcomes` have the best energy score."""

    def way(deviation: float) -> Prediction:
        return fixed_noise(learned, deviation, sample_count, simulator)

    weights = spread_weights(outcomes, way(FIXED_NOISE), seed)
    reference = weighted_energy_scores(outcomes, way(FIXED_NOISE), weights, seed)

    def relative_score(logarithm: float) -> float:
        scores = weighted_energy_scores(outcomes, way(np.exp(logarithm)), weights, seed)
        return float(np.nanmean(scores / reference))

    found = minimize_scalar(
        relative_score,
        bounds=(np.log(0.1 * FIXED_NOISE), np.log(LARGEST_FIXED_NOISE)),
        method="bounded",
        options={"maxiter": evaluations},
    )
    return float(np.exp(found.x))


def single_rollout(learned: LearnedParameters, simulator: Simulator) -> Prediction:
    """Return one simulation from the states as perceived, with θ_s as learned."""
    return fixed_noise(learned, 0.0, 1, simulator)


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


OURS = "noisy Newton"
"""Name of the predictions that are calibrated, beside the baselines."""

BASELINES = ("single rollout", "fixed noise", "free flight")
"""One simulation, noisy Newton as in the paper, and no material parameters at all."""

FITTED = "fixed noise, fitted"
"""The paper's noisy Newton with what ours has, too: noise of the size that suits the past."""


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
        """Mean energy score over that of the best of `BASELINES` at each horizon, (n_horizons,)."""
        return self._energy_score_over(BASELINES)

    @property
    def energy_score_vs_fitted_noise(self) -> NDArray[np.float64]:
        """The same over fixed noise that was fitted to the past, as ours was, (n_horizons,).

        Where all states are perceived alike, one size of noise can do all that their covariances
        do, and the best there is has a ratio of 1.
        """
        return self._energy_score_over((FITTED,))

    def _energy_score_over(self, names: Sequence[str]) -> NDArray[np.float64]:
        ours, *others = (np.nanmean(self.scores[n].energy, axis=0) for n in (OURS, *names))
        return np.asarray(ours / np.min(others, axis=0))


def calibrate(
    past: Sequence[Outcome],
    held_out: Sequence[Outcome],
    learned: LearnedParameters,
    horizons: ArrayLike,
    *,
    scales_to_fit: Sequence[str] = FITTED_SCALES,
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
    once, paper, flight = BASELINES
    ways: dict[str, Prediction] = {
        OURS: noisy_prediction(learned, fit.scales, sample_count, engine),
        once: single_rollout(learned, engine),
        paper: fixed_noise(learned, FIXED_NOISE, sample_count, engine),
        flight: free_flights(sample_count),
        FITTED: fixed_noise(learned, fixed, sample_count, engine),
    }
    scores = {name: score(held_out, way, seed + 1) for name, way in ways.items()}
    return Calibration(np.asarray(horizons, dtype=np.float64), scores, fit, fixed)
