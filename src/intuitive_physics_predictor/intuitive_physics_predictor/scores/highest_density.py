"""Highest-density regions of sampled predictions, which may lie in several pieces.

The region of probability p is the smallest that holds it (Hyndman: Computing and graphing highest
density regions, The American Statistician 50, 1996), so two futures are two pieces with nothing
between them. Density is estimated from the distance to the k-th nearest neighbour, k = √n
(Loftsgaarden, Quesenberry 1965).

Whether an outcome lies in it is read from the rank of its density among those of the samples, all
of them estimated in the pool of outcome and samples. If the outcome is one more draw from the
samples' distribution, the pool is exchangeable and every rank as likely as any other, whatever the
distribution and however rough the estimate (Gneiting et al.: Assessing probabilistic forecasts of
multivariate quantities, TEST 17, 2008).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import KDTree

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.validation import finite_array

WITHIN_TWO_SIGMA = 8.0249
"""Squared error of a vector of three, in variances, that a normal one exceeds as seldom as a single
number exceeds two standard deviations."""

FEWEST_SAMPLES = 2
"""Samples that a density needs at least: one has no neighbour."""


def highest_density_levels(samples: ArrayLike, outcome: ArrayLike) -> tuple[float, float]:
    """Between which probabilities the smallest region lies that holds an outcome.

    Parameters
    ----------
    samples : (n, d), n ≥ 2, equally likely
    outcome : (d,), what happened

    Returns
    -------
    below, at : in [0, 1]; the level is uniform between them. They are 1 / (n + 1) apart, or more
        where densities are the same.
    """
    drawn = finite_array(samples, "samples", (None, None))
    if len(drawn) < FEWEST_SAMPLES:
        raise InvalidInputError(f"there are {len(drawn)} samples; expected at least 2")
    point = finite_array(outcome, "outcome", (drawn.shape[1],))
    pool = np.vstack([point, drawn])
    k = round(np.sqrt(len(drawn)))
    # The nearest one to each point is itself.
    distances = KDTree(pool).query(pool, [k + 1])[0][:, 0]
    denser = int((distances < distances[0]).sum())
    as_dense = int((distances == distances[0]).sum())
    return denser / len(pool), (denser + as_dense) / len(pool)


def coverage(levels: ArrayLike, probability: float) -> float:
    """Share of outcomes inside their region of that probability, NaN when there are none.

    Parameters
    ----------
    levels : (n, 2) of `highest_density_levels`; one that straddles the probability counts in part
    probability : of the region, in [0, 1]
    """
    pairs: NDArray[np.float64] = np.asarray(levels, dtype=np.float64).reshape(-1, 2)
    if not len(pairs):
        return float("nan")
    below, at = pairs.T
    return float(np.clip((probability - below) / (at - below), 0.0, 1.0).mean())
