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

FIRST_STEP = np.log(2.0)
"""A scale is first tried at twice its value."""

SMALLEST_SCALE, LARGEST_SCALE = 1e-3, 1e3
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
    names: Sequence[str] = ("state", "static_parameters"),
    start: NoiseScales | None = None,
    seed: int = 0,
    sample_count: int = 50,
    max_evaluations: int = 40,
    simulator: Simulator | None = None,
) -> NoiseFit:
    """Fit some of the noise scales, each on a logarithmic scale, by Nelder and Mead.

    Every time of an outcome counts alike, however far things have spread by then: scores are
    relative to those of `start` at the same place in the times.

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

    def scores(scales: NoiseScales) -> NDArray[np.float64]:
        prediction = noisy_prediction(learned, scales, sample_count, engine)
        return mean_energy_scores(outcomes, prediction, seed)

    def scaled(logarithms: NDArray[np.float64]) -> NoiseScales:
        values = np.exp(np.clip(logarithms, np.log(SMALLEST_SCALE), np.log(LARGEST_SCALE)))
        return replace(begin, **dict(zip(names, map(float, values), strict=True)))

    reference = np.maximum(scores(begin), np.finfo(float).tiny)
    found = minimize(
        lambda logarithms: float(np.nanmean(scores(scaled(logarithms)) / reference)),
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


def mean_energy_scores(
    outcomes: Sequence[Outcome], prediction: Prediction, seed: int
) -> NDArray[np.float64]:
    """Mean energy score over all objects at each of the outcomes' times, (n_times,) m."""
    scores = [
        energy_scores(samples, outcome.positions)
        for samples, outcome in zip(
            predict_outcomes(outcomes, prediction, seed), outcomes, strict=True
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
