"""Fit noise scales to the past: those whose predictions of it have the best energy score."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from intuitive_physics.errors import InvalidInputError, UnknownNameError
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.simulation import Simulator, make_simulator
from intuitive_physics_predictor.noise_scales import NOISE_SCALES, NoiseScales
from intuitive_physics_predictor.outcomes import (
    Outcome,
    Prediction,
    noisy_prediction,
    predict_outcomes,
)
from intuitive_physics_predictor.scores import energy_scores

FITTED_SCALES = ("state", "static_parameters", "unidentified")
"""Scales that observations of any kind can tell."""

FIRST_STEP = np.log(0.5)
"""A scale is first tried at half its value."""

SMALLEST_SCALE, LARGEST_SCALE = 1e-3, 1e3
DOUBT = 0.2
"""Score, over the number of objects, that a scale costs which is e times that of the start. It is
the prior that log scales are about those of the start by ±0.5: one object tells a log scale about
as well as six normal numbers do (curvature 6 of the log score), and there the relative energy score
has the curvature 0.6, so the prior's 1 / (2 · 0.5²) becomes 0.2."""

SMALLEST_SPREAD = 1e-3
"""m; a prediction surer than that is not weighed more."""

PRECISION = 0.02
"""Relative, of a scale; the score is flat about its best."""


@dataclass(frozen=True)
class NoiseFit:
    """What a fit found.

    Parameters
    ----------
    scales : the best ones
    score : their energy score, relative to that of the scales the fit began with
    evaluations : sets of scales that were tried
    """

    scales: NoiseScales
    score: float
    evaluations: int


def fit_noise_scales(
    outcomes: Sequence[Outcome],
    learned: LearnedParameters,
    *,
    names: Sequence[str] = FITTED_SCALES,
    start: NoiseScales | None = None,
    seed: int = 0,
    sample_count: int = 50,
    max_evaluations: int = 50,
    simulator: Simulator | None = None,
) -> NoiseFit:
    """Fit some of the noise scales, each on a logarithmic scale, by Nelder and Mead.

    Every object counts alike at every time, however far it may have got by then: its score is
    relative to the spread that is predicted for it by `start`, and the scores at each time to
    those of `start`. (Constant weights leave a score proper.)

    Parameters
    ----------
    outcomes : the past, at least one, all with the same number of times
    learned : θ_s with the uncertainty that is to be scaled
    names : scales to fit; the others keep their value in `start`
    start : where the fit begins; scales to fit must be above zero there; default: `NoiseScales()`
    seed : of the noise, the same for all scales tried
    sample_count : simulations of each outcome

    Raises
    ------
    InvalidInputError
        When there is no outcome or a scale to fit starts at zero.
    UnknownNameError
        When there is no such scale.
    """
    begin = start or NoiseScales()
    first = _checked_start(begin, names)
    if not outcomes or len({len(outcome.times) for outcome in outcomes}) > 1:
        raise InvalidInputError(
            f"there are {len(outcomes)} outcomes; expected at least one, all at as many times"
        )
    engine = simulator or make_simulator("auto")

    def scaled(logarithms: NDArray[np.float64]) -> NoiseScales:
        values = np.clip(np.exp(logarithms), SMALLEST_SCALE, LARGEST_SCALE)
        found = dict(zip(names, map(float, values), strict=True))
        if "unidentified" in found:
            found["unidentified"] = min(found["unidentified"], 1.0)
        return replace(begin, **found)

    def prediction(scales: NoiseScales) -> Prediction:
        return noisy_prediction(learned, scales, sample_count, engine)

    objects = sum(len(outcome.scene.objects) for outcome in outcomes)
    weights = spread_weights(outcomes, prediction(begin), seed)
    reference = weighted_energy_scores(outcomes, prediction(begin), weights, seed)

    def relative_score(logarithms: NDArray[np.float64]) -> float:
        way = prediction(scaled(logarithms))
        scores = weighted_energy_scores(outcomes, way, weights, seed)
        moved = float(np.square(logarithms - first).sum())
        return float(np.nanmean(scores / reference)) + DOUBT * moved / objects

    found = minimize(
        relative_score,
        first,
        method="Nelder-Mead",
        options={
            "initial_simplex": np.vstack([first, first + FIRST_STEP * np.eye(len(names))]),
            "maxfev": max_evaluations,
            "xatol": PRECISION,
            "fatol": 0.01 * PRECISION,
        },
    )
    return NoiseFit(scaled(found.x), float(found.fun), int(found.nfev))


def spread_weights(
    outcomes: Sequence[Outcome], prediction: Prediction, seed: int
) -> list[NDArray[np.float64]]:
    """One over the predicted spread of each object at each time, (n_objects, n_times) 1/m."""
    return [
        1.0 / np.sqrt(samples.var(axis=0).sum(axis=-1) + SMALLEST_SPREAD**2)
        for samples in predict_outcomes(outcomes, prediction, seed)
    ]


def weighted_energy_scores(
    outcomes: Sequence[Outcome],
    prediction: Prediction,
    weights: Sequence[NDArray[np.float64]],
    seed: int,
) -> NDArray[np.float64]:
    """Mean of the energy scores of all objects, each with its weight, (n_times,)."""
    scores = [
        weight * energy_scores(samples, outcome.positions)
        for samples, outcome, weight in zip(
            predict_outcomes(outcomes, prediction, seed), outcomes, weights, strict=True
        )
    ]
    return np.asarray(np.nanmean(np.concatenate(scores), axis=0))


def _checked_start(start: NoiseScales, names: Sequence[str]) -> NDArray[np.float64]:
    unknown = [name for name in names if name not in NOISE_SCALES]
    if unknown or not names:
        raise UnknownNameError(
            f"noise scales to fit are {list(names)}; expected some of {', '.join(NOISE_SCALES)}"
        )
    values = np.array([getattr(start, name) for name in names])
    if (values <= 0.0).any():
        raise InvalidInputError(
            f"noise scales start at {dict(zip(names, values.tolist(), strict=True))}; "
            "expected all that are fitted above zero"
        )
    return np.log(values)
