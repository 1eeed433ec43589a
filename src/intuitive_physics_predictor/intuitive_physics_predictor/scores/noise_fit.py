"""Fit noise scales to the past: those whose predictions of it have the best energy score.

Numbers fitted to few outcomes are partly chance, and the start, which takes the uncertainties of
perception and learner as they are, is the better guess where the outcomes do not contradict it. So
the logarithms are shrunk towards the start, by as much as chance alone would have moved them: k
numbers, fitted δ away with the covariance C, keep the share 1 - k / (δᵀ C⁻¹ δ), or nothing (James,
Stein: Estimation with quadratic loss, 1961; positive part).

The effect of chance is taken from the differences in gain of score between outcomes. Near its best
the mean score of n outcomes is a parabola with the Hessian H, and C = H⁻¹ G H⁻¹ / n, where G is the
covariance of the single outcomes' slopes (Godambe: An optimum property of regular maximum
likelihood estimation, 1960). The gain over the start is δᵀ H δ / 2 on average, and its standard
error √(δᵀ G δ / n). So of one number, δᵀ C⁻¹ δ is the square of twice the gain over its standard
error; for several the same is assumed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import minimize

from intuitive_physics.errors import InvalidInputError, UnknownNameError
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.simulation import Simulator, make_simulator
from intuitive_physics.validation import finite_array
from intuitive_physics_predictor.noise_scales import NOISE_SCALES, NoiseScales
from intuitive_physics_predictor.scores.outcomes import (
    Outcome,
    Prediction,
    noisy_prediction,
    predict_outcomes,
)
from intuitive_physics_predictor.scores.proper_scores import energy_scores

FITTED_SCALES = ("state", "static_parameters", "unidentified")
"""Scales that observations of any kind identify."""

FIRST_STEP = np.log(0.5)
"""A scale is first tried at half its value."""

SMALLEST_SCALE, LARGEST_SCALE = 1e-3, 1e3
"""Bounds of a scale. Our choice."""

SMALLEST_SPREAD = 1e-3
"""m; a prediction surer than that is not weighed more."""

PRECISION = 0.02
"""Relative, of a scale; the score is flat about its best."""


@dataclass(frozen=True)
class NoiseFit:
    """Result of a fit.

    Parameters
    ----------
    scales : the best ones
    score : their energy score, relative to that of the scales the fit began with
    kept : by name of a scale, share of the way from the start to the scale of the best score that
        is more than chance
    evaluations : sets of scales that were tried
    """

    scales: NoiseScales
    score: float
    kept: dict[str, float]
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
    """Fit some of the noise scales, each on a logarithmic scale, by Nelder and Mead, and shrink.

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
        tried = dict(zip(names, map(float, values), strict=True))
        if "unidentified" in tried:
            tried["unidentified"] = min(tried["unidentified"], 1.0)
        return replace(begin, **tried)

    def prediction(scales: NoiseScales) -> Prediction:
        return noisy_prediction(learned, scales, sample_count, engine)

    weights = spread_weights(outcomes, prediction(begin), seed)
    reference = weighted_energy_scores(outcomes, prediction(begin), weights, seed)
    unit = [weight / reference for weight in weights]

    def relative_scores(
        logarithms: NDArray[np.float64], samples_seed: int = seed
    ) -> NDArray[np.float64]:
        way = prediction(scaled(logarithms))
        return _scores_of_outcomes(outcomes, way, unit, samples_seed)

    def other_scores(logarithms: NDArray[np.float64]) -> NDArray[np.float64]:
        # The best of many tries is best by the luck of its samples, too; others do not share it.
        return relative_scores(logarithms, seed + 1)

    minimum = minimize(
        lambda logarithms: float(relative_scores(logarithms).mean()),
        first,
        method="Nelder-Mead",
        options={
            "initial_simplex": np.vstack([first, first + FIRST_STEP * np.eye(len(names))]),
            "maxfev": max_evaluations,
            "xatol": PRECISION,
            "fatol": 0.01 * PRECISION,
        },
    )
    shares = _shares_beyond_chance(other_scores, first, minimum.x)
    settled = first + shares * (minimum.x - first)
    kept = dict(zip(names, shares.tolist(), strict=True))
    score = float(other_scores(settled).mean() / other_scores(first).mean())
    return NoiseFit(scaled(settled), score, kept, int(minimum.nfev))


def _shares_beyond_chance(
    scores: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    start: NDArray[np.float64],
    fitted: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Share of the way from `start` to `fitted` (k,) that each number is worth by itself, (k,).

    One that is informative must not carry along others that are not, so each is put back alone.
    """
    fitted_scores = scores(fitted)
    shares = np.zeros(len(fitted))
    for k in range(len(fitted)):
        without = fitted.copy()
        without[k] = start[k]
        shares[k] = share_beyond_chance(scores(without) - fitted_scores, 1)
    return shares


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
    """Return the mean of the energy scores of all objects, each with its weight, (n_times,).

    Parameters
    ----------
    weights : of each outcome (n_objects, n_times) 1/m
    """
    scores = _weighted_scores(outcomes, prediction, weights, seed)
    return np.asarray(np.nanmean(np.concatenate(scores), axis=0))


def _scores_of_outcomes(
    outcomes: Sequence[Outcome],
    prediction: Prediction,
    weights: Sequence[NDArray[np.float64]],
    seed: int,
) -> NDArray[np.float64]:
    """Return what each outcome adds to the weighted scores of all objects and times, (n_outcomes,).

    Their mean is that of all objects and times; objects of one outcome share their fate, so it is
    outcomes that chance draws.
    """
    scores = _weighted_scores(outcomes, prediction, weights, seed)
    count = sum(int(np.isfinite(each).sum()) for each in scores)
    return np.array([np.nansum(each) for each in scores]) * (len(scores) / max(count, 1))


def _weighted_scores(
    outcomes: Sequence[Outcome],
    prediction: Prediction,
    weights: Sequence[NDArray[np.float64]],
    seed: int,
) -> list[NDArray[np.float64]]:
    """Energy scores, each with its weight, (n_objects, n_times) of each outcome."""
    predicted = predict_outcomes(outcomes, prediction, seed)
    return [
        weight * energy_scores(samples, outcome.positions)
        for samples, outcome, weight in zip(predicted, outcomes, weights, strict=True)
    ]


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


def share_beyond_chance(gains: ArrayLike, numbers: int) -> float:
    """Return the share of the way from the start of a fit to its result that is to be kept.

    Parameters
    ----------
    gains : (n,) by how much the score of each outcome, independent of the others, became better
    numbers : that were fitted

    Returns
    -------
    float
        In [0, 1]; 0 where nothing was gained, or there is a single outcome.

    Raises
    ------
    InvalidInputError
        When there is no outcome, a gain is not finite, or no number was fitted.
    """
    gained = finite_array(gains, "gains", (None,))
    if numbers < 1 or not len(gained):
        raise InvalidInputError(
            f"{numbers} numbers were fitted to {len(gained)} outcomes; expected at least one each"
        )
    largest = float(np.abs(gained).max())
    if len(gained) < 2 or largest == 0.0:
        return 0.0
    gained = gained / largest  # the squares of very small gains are zero
    mean = float(gained.mean())
    if mean <= 0.0:
        return 0.0
    by_chance = numbers * float(gained.var(ddof=1)) / len(gained)
    squared = 4.0 * mean**2
    return 1.0 - by_chance / squared if by_chance < squared else 0.0
