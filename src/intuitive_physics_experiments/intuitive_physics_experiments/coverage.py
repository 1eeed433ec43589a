"""Whether predicted regions hold what they claim: how often a p-region contains what was seen."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_experiments.prediction_case import PredictionCase

LEVELS = np.linspace(0.05, 0.95, 19)


def coverage(
    cases: Sequence[PredictionCase], noise: float, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Share of points inside the predicted region of each of `LEVELS`, shape (19,).

    The p-region about the mean is that of the Mahalanobis distance that holds the share p of the
    samples, so nothing is taken to be Gaussian but its outline. Every case counts the same.

    Parameters
    ----------
    cases : at least one
    noise : m, standard deviation of a point that was seen, which its prediction does not have
    """
    shares = []
    for case in cases:
        seen_share = _shares_nearer(case, noise, rng)
        shares.append((seen_share[:, None] < LEVELS).mean(axis=0))
    return np.asarray(np.mean(shares, axis=0))


def _shares_nearer(
    case: PredictionCase, noise: float, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Share of the samples that are nearer to the mean than the point seen, (n_times,)."""
    samples = case.samples + rng.normal(0.0, noise, case.samples.shape)
    mean = samples.mean(axis=0)
    offsets = samples - mean
    covariance = np.einsum("sti,stj->tij", offsets, offsets) / max(len(samples) - 1, 1)
    # A direction in which nothing spreads must not make every distance infinite.
    covariance += 1e-12 * np.eye(3)
    inverse = np.linalg.inv(covariance)
    of_samples = np.einsum("sti,tij,stj->st", offsets, inverse, offsets)
    seen = case.observed - mean
    of_seen = np.einsum("ti,tij,tj->t", seen, inverse, seen)
    return np.asarray((of_samples < of_seen).mean(axis=0))
