"""Draws of θ_s: material parameters that are as uncertain as the learner says."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.materials import PAIR_COEFFICIENTS
from intuitive_physics.parameter_space import Bounds, ParameterSpace, parameter_vector
from intuitive_physics.validation import non_negative_float

STATIC = PAIR_COEFFICIENTS.index("static_friction")
"""Index of μ_s among the coefficients of a pair."""

DYNAMIC = PAIR_COEFFICIENTS.index("dynamic_friction")
"""Index of μ_d among the coefficients of a pair."""

AT_CONTACT = ("static_friction", "dynamic_friction", "restitution")
"""Coefficients that contact noise moves: what acts in an impact."""


EXACT = 1e-30
"""Smallest standard deviation; smaller ones count as this, which is nothing beside any mean."""


class TruncatedNormal:
    """Independent normal distributions, each cut off at two ends.

    Parameters
    ----------
    mean : (n,) of any unit, as all below
    deviation : (n,) ≥ 0; where it is infinite, the distribution is uniform between the ends
    lower, upper : (n,) ends, on either side of the mean or at it
    """

    def __init__(
        self,
        mean: NDArray[np.float64],
        deviation: NDArray[np.float64],
        lower: NDArray[np.float64],
        upper: NDArray[np.float64],
    ) -> None:
        self._mean, self._lower, self._upper = mean, lower, upper
        self._uniform = np.isinf(deviation)
        self._deviation = np.where(self._uniform, 1.0, np.maximum(deviation, EXACT))
        # Shares of the whole normal distribution that are below the lower end and between both.
        self._below = ndtr((lower - mean) / self._deviation)
        self._between = ndtr((upper - mean) / self._deviation) - self._below

    def quantiles(self, shares: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the quantiles of the distributions.

        Parameters
        ----------
        shares : (…, n) probabilities below them

        Returns
        -------
        (…, n), in the unit of the mean
        """
        return self._quantiles(shares, self._between, self._lower, self._upper)

    def quantiles_up_to(
        self, most: NDArray[np.float64], shares: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return `quantiles` of the distributions cut off at `most` too.

        Parameters
        ----------
        most : (…, n) ends; where one is below the lower end it is the quantile
        shares : (…, n) probabilities below the quantiles

        Returns
        -------
        (…, n), in the unit of the mean
        """
        upper = np.minimum(self._upper, most)
        below_most = ndtr((most - self._mean) / self._deviation)
        between = np.minimum(self._between, below_most - self._below)
        return self._quantiles(shares, between, np.minimum(self._lower, upper), upper)

    def _quantiles(
        self,
        shares: NDArray[np.float64],
        between: NDArray[np.float64],
        lower: NDArray[np.float64],
        upper: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        normal = self._mean + self._deviation * ndtri(self._below + shares * between)
        drawn = np.where(self._uniform, lower + shares * (upper - lower), normal)
        return np.asarray(np.minimum(np.maximum(drawn, lower), upper))


class UncertainParameters:
    """A distribution of θ_s about what was learned.

    A parameter that the observations identify has a normal distribution with the learner's
    standard deviation (of its logarithm where its scale is logarithmic), cut off at its bounds; or
    is uniform in the interval that the learner gives it. One that they do not identify is uniform
    within its bounds, as before the search: a value that was not learned must not make a prediction
    look sure. Of the two frictions of a pair the better known is drawn first and
    the other one then where μ_d ≤ μ_s leaves room.

    Parameters
    ----------
    learned : θ_s and its uncertainty
    scale : factor on the standard deviations of what was identified; 0: that is known exactly
    unidentified : how far what was not identified may be from the value given, as a share of the
        way to its bounds; 1: anywhere, 0: it is held
    contact : standard deviation, added to frictions and restitution of every pair, of what differs
        from one contact to the next: unevenness, dust, spin that the model lacks. A sample has the
        same deviation at all its contacts.
    bounds : of the parameters by kind, as the learner searched; default: `DEFAULT_BOUNDS`
    """

    def __init__(
        self,
        learned: LearnedParameters,
        *,
        scale: float = 1.0,
        unidentified: float = 1.0,
        contact: float = 0.0,
        bounds: Mapping[str, Bounds] | None = None,
    ) -> None:
        space = ParameterSpace(learned.materials, bounds or {})
        kinds = [name.split("[")[0] for name in space.names]
        limits = [space.bounds[kind] for kind in kinds]
        mean = parameter_vector(learned.parameters)
        self.learned = learned
        self._logarithmic = np.array([limit.scale == "logarithmic" for limit in limits])
        self._lower = self._to_scale(np.minimum([limit.lower for limit in limits], mean))
        self._upper = self._to_scale(np.maximum([limit.upper for limit in limits], mean))
        self._mean = self._to_scale(mean)
        share = non_negative_float(unidentified, "share of what is not identified")
        at_contact = np.isin(kinds, AT_CONTACT) * non_negative_float(contact, "contact noise")
        deviation = np.hypot(
            learned.standard_deviations * non_negative_float(scale, "scale of θ_s"), at_contact
        )
        # d ln x = dx / x
        slopes = np.where(self._logarithmic, np.maximum(mean, np.finfo(float).tiny), 1.0)
        identified = learned.identified & ~np.isnan(deviation)
        self._deviation = np.where(identified, deviation, np.inf) / slopes
        reach = np.where(identified, 1.0, min(share, 1.0))
        self._lower = self._mean + reach * (self._lower - self._mean)
        self._upper = self._mean + reach * (self._upper - self._mean)
        self._draw_between(identified & (scale > 0.0) & ~np.isnan(learned.intervals[:, 0]), mean)
        self._all = TruncatedNormal(self._mean, self._deviation, self._lower, self._upper)
        self._elements = _elements_of_coefficients(len(learned.materials))
        self._pair_frictions()

    def _pair_frictions(self) -> None:
        """Find out which friction of each pair is drawn first, and how the other one is then."""
        m = len(self.learned.materials)
        static, dynamic = (
            np.arange(m + kind, self._mean.size, len(PAIR_COEFFICIENTS))
            for kind in (STATIC, DYNAMIC)
        )
        self._draws_static = self._unsure[dynamic] < self._unsure[static]
        self._better_known = np.where(self._draws_static, dynamic, static)
        self._less_known = less = np.where(self._draws_static, static, dynamic)
        # Mirrored at zero, a static friction too is at most the other one.
        self._sign = np.where(self._draws_static, -1.0, 1.0)
        lower, upper = self._lower[less], self._upper[less]
        self._less_known_one = TruncatedNormal(
            self._sign * self._mean[less],
            self._deviation[less],
            np.where(self._draws_static, -upper, lower),
            np.where(self._draws_static, -lower, upper),
        )

    def _draw_between(self, chosen: NDArray[np.bool_], mean: NDArray[np.float64]) -> None:
        """Let parameters be anywhere between the ends that the learner gives them."""
        ends = np.where(chosen[:, None], self.learned.intervals, mean[:, None])
        low = np.clip(self._to_scale(ends[:, 0]), self._lower, self._mean)
        high = np.clip(self._to_scale(ends[:, 1]), self._mean, self._upper)
        self._lower = np.where(chosen, low, self._lower)
        self._upper = np.where(chosen, high, self._upper)
        # They are drawn before what was not identified.
        self._unsure = np.where(chosen, high - low, self._deviation)
        self._deviation = np.where(chosen, np.inf, self._deviation)

    def draw(
        self, count: int, rng: np.random.Generator
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Draw θ_s.

        Returns
        -------
        density : (count, m) kg/m³
        coefficients : (count, 4, m, m), as `StaticParameters.coefficients`
        """
        m = len(self.learned.materials)
        uniform = rng.random((count, self._mean.size))
        drawn = self._all.quantiles(uniform)
        # The less known friction of each pair is drawn again, where the other one leaves room.
        shares = self._draws_static + self._sign * uniform[:, self._less_known]
        most = self._sign * drawn[:, self._better_known]
        drawn[:, self._less_known] = self._sign * self._less_known_one.quantiles_up_to(most, shares)
        values = np.exp(drawn, out=drawn, where=self._logarithmic)
        coefficients = values.take(self._elements, axis=1)
        return np.ascontiguousarray(values[:, :m]), coefficients

    def _to_scale(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        logarithms = np.log(np.maximum(values, np.finfo(float).tiny))
        return np.where(self._logarithmic, logarithms, values)


def _elements_of_coefficients(m: int) -> NDArray[np.int64]:
    """Return which parameter each element of the coefficients is, shape (4, m, m)."""
    rows, columns = np.triu_indices(m)
    kinds = len(PAIR_COEFFICIENTS)
    elements = np.empty((kinds, m, m), dtype=np.int64)
    of_pairs = m + np.arange(rows.size * kinds).reshape(rows.size, kinds).T
    elements[:, rows, columns] = elements[:, columns, rows] = of_pairs
    return elements
