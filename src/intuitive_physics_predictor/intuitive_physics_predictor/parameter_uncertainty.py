"""Draws of θ_s: material parameters with the uncertainty that the learner states."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.materials import PAIR_COEFFICIENTS
from intuitive_physics.parameter_posterior import UNIFORM_PRECISION, ParameterPosterior
from intuitive_physics.parameter_space import ParameterSpace
from intuitive_physics.prior_knowledge import with_pair_prior
from intuitive_physics.truncated_gaussian import truncated_normal_quantiles
from intuitive_physics.validation import non_negative_float

STATIC = PAIR_COEFFICIENTS.index("static_friction")
"""Index of μ_s among the coefficients of a pair."""

DYNAMIC = PAIR_COEFFICIENTS.index("dynamic_friction")
"""Index of μ_d among the coefficients of a pair."""

RESTITUTION = PAIR_COEFFICIENTS.index("restitution")
"""Index of e among the coefficients of a pair."""

LARGEST_POOL = 4096
"""Draws of each θ_s: they add an error of at most 0.8 % of probability, one standard error, to a
quantile of a prediction."""

SMALLEST_POOL = 1024
"""Draws where there are many parameters: an error of 1.6 % of probability, likewise."""

POOL_NUMBERS = 2**20
"""Largest size of a pool, 8 MB: with more than 256 parameters there are fewer draws."""

POOL_SEED = 0
"""Seed of the draws: the same θ_s has the same draws."""


class UncertainParameters:
    """A distribution of θ_s about what was learned.

    θ_s has the learner's posterior, a Gaussian distribution with all correlations, cut off at its
    bounds (`ParameterPosterior`). A parameter without any information is uniform within its bounds:
    a value that was not learned must not make a prediction look certain. A pair that was not
    observed has a prior from other pairs of its materials (`with_pair_prior`), unless
    `unidentified` is below 1.

    A pool of θ_s is drawn once; each call of `draw` takes some of it, so its cost does not depend
    on the number of parameters and their correlations.

    Parameters
    ----------
    learned : θ_s and its uncertainty
    scale : factor on the standard deviations of identified parameters; 0: they are known exactly
    unidentified : largest distance of an unidentified parameter from its value, as a share of the
        distance to its bounds; 1: anywhere, 0: it is held. With little information the share counts
        in part, by the remaining variance relative to that of a uniform number.
    contact : standard deviation, added to frictions and restitution of every pair, of differences
        from one contact to the next: unevenness, dust, spin that the model lacks. A sample has the
        same deviation at all its contacts.
    materials : that are drawn; default: those of `learned`

    Attributes
    ----------
    learned : θ_s, of these materials
    bounds : of the unit cube, by kind of parameter
    units : (count, |θ_s|) the pool on the unit cube, without contact noise
    """

    def __init__(
        self,
        learned: LearnedParameters,
        *,
        scale: float = 1.0,
        unidentified: float = 1.0,
        contact: float = 0.0,
        materials: Sequence[str] | None = None,
    ) -> None:
        factor = non_negative_float(scale, "scale of θ_s")
        share = min(non_negative_float(unidentified, "share of what is not identified"), 1.0)
        deviation = non_negative_float(contact, "contact noise")
        materials = learned.materials if materials is None else tuple(materials)
        self.learned = learned.extended(materials)
        posterior, box = learned.whole_posterior(), None
        if share < 1.0:
            posterior = posterior.extended(materials)
            box = _narrowed_box(posterior, share)
        if factor != 1.0:
            posterior = posterior.scaled(factor)
        if share == 1.0:
            posterior = with_pair_prior(posterior, materials)
        rng = np.random.default_rng(POOL_SEED)
        space = posterior.space
        count = int(np.clip(POOL_NUMBERS // space.size, SMALLEST_POOL, LARGEST_POOL))
        self.bounds = space.bounds
        self.units = posterior.draw(count, rng, box)
        self._pool = space.to_values(self.units)
        if deviation > 0.0:
            _add_contact_noise(self._pool, deviation, space, rng)
        self._elements = _elements_of_coefficients(len(materials))

    def draw(
        self, count: int, rng: np.random.Generator
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Draw θ_s: of the pool, each as often as any other.

        Returns
        -------
        density : (count, m) kg/m³
        coefficients : (count, 4, m, m), as `StaticParameters.coefficients`
        """
        size = len(self._pool)
        orders = [rng.permutation(size) for _ in range(-(-count // size))]
        values = self._pool[np.concatenate(orders)[:count]]
        m = len(self.learned.materials)
        return np.ascontiguousarray(values[:, :m]), values.take(self._elements, axis=1)


def _narrowed_box(posterior: ParameterPosterior, share: float) -> NDArray[np.float64]:
    """Return the ends (n, 2), widths, of the possible values; see `unidentified`."""
    mean = posterior.mean
    alike = ParameterPosterior(posterior.materials, mean, posterior.factor, posterior.bounds)
    left = np.minimum(alike.standard_deviations() ** 2 * UNIFORM_PRECISION, 1.0)
    left[~posterior.factor.any(axis=0)] = 1.0
    reach = 1.0 - (1.0 - share) * left
    return np.stack([mean - reach * mean, mean + reach * (1.0 - mean)], axis=1)


def _add_contact_noise(
    values: NDArray[np.float64],
    deviation: float,
    space: ParameterSpace,
    rng: np.random.Generator,
) -> None:
    """Move frictions and restitution in values (count, |θ_s|), within bounds and with μ_d ≤ μ_s."""
    by_pair = values[:, len(space.materials) :].reshape(len(values), -1, len(PAIR_COEFFICIENTS))
    for index in (DYNAMIC, STATIC, RESTITUTION):
        coefficients, limits = by_pair[..., index], space.bounds[PAIR_COEFFICIENTS[index]]
        lower, upper = limits.lower, limits.upper
        if index == DYNAMIC:
            upper = min(upper, space.bounds["static_friction"].upper)
        least = np.maximum(by_pair[..., DYNAMIC], lower) if index == STATIC else lower
        shares = rng.random(coefficients.shape)
        by_pair[..., index] = truncated_normal_quantiles(
            shares, coefficients, deviation, least, upper
        )


def _elements_of_coefficients(m: int) -> NDArray[np.int64]:
    """Return which parameter each element of the coefficients is, shape (4, m, m)."""
    rows, columns = np.triu_indices(m)
    kinds = len(PAIR_COEFFICIENTS)
    elements = np.empty((kinds, m, m), dtype=np.int64)
    of_pairs = m + np.arange(rows.size * kinds).reshape(rows.size, kinds).T
    elements[:, rows, columns] = elements[:, columns, rows] = of_pairs
    return elements
