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
DYNAMIC = PAIR_COEFFICIENTS.index("dynamic_friction")
AT_CONTACT = ("static_friction", "dynamic_friction", "restitution")
"""Coefficients that contact noise moves: what acts in an impact."""

SMALLEST_DEVIATION = 1e-12
"""What is known better than this is known exactly."""


class UncertainParameters:
    """A distribution of θ_s about what was learned.

    A parameter that the observations could tell has a normal distribution with the learner's
    standard deviation (of its logarithm where its scale is logarithmic), cut off at its bounds; or
    is anywhere between the ends that the learner gives it. One that they could not tell is anywhere
    within its bounds, as the search supposed before it began: a value that nobody learned must not
    make a prediction look sure. Of the two frictions of a pair the better known is drawn first and
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
        told = learned.identified & ~np.isnan(deviation)
        self._deviation = np.where(told, deviation, np.inf) / slopes
        reach = np.where(told, 1.0, min(share, 1.0))
        self._lower = self._mean + reach * (self._lower - self._mean)
        self._upper = self._mean + reach * (self._upper - self._mean)
        self._draw_between(told & (scale > 0.0) & ~np.isnan(learned.intervals[:, 0]), mean)
        self._pairs = np.triu_indices(len(learned.materials))
        static, dynamic = (
            np.arange(len(learned.materials) + kind, mean.size, len(PAIR_COEFFICIENTS))
            for kind in (STATIC, DYNAMIC)
        )
        self._draws_static = self._unsure[dynamic] < self._unsure[static]
        self._less_known = np.where(self._draws_static, static, dynamic)
        self._better_known = np.where(self._draws_static, dynamic, static)

    def _draw_between(self, chosen: NDArray[np.bool_], mean: NDArray[np.float64]) -> None:
        """Let parameters be anywhere between the ends that the learner gives them."""
        ends = np.where(chosen[:, None], self.learned.intervals, mean[:, None])
        low = np.clip(self._to_scale(ends[:, 0]), self._lower, self._mean)
        high = np.clip(self._to_scale(ends[:, 1]), self._mean, self._upper)
        self._lower = np.where(chosen, low, self._lower)
        self._upper = np.where(chosen, high, self._upper)
        # They are drawn before what nobody learned.
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
        drawn = _truncated_normal(uniform, self._mean, self._deviation, self._lower, self._upper)
        self._order_frictions(drawn, uniform)
        values = np.where(self._logarithmic, np.exp(drawn * self._logarithmic), drawn)
        coefficients = np.empty((count, len(PAIR_COEFFICIENTS), m, m))
        rows, columns = self._pairs
        by_pair = values[:, m:].reshape(count, rows.size, len(PAIR_COEFFICIENTS)).swapaxes(1, 2)
        coefficients[:, :, rows, columns] = coefficients[:, :, columns, rows] = by_pair
        return np.ascontiguousarray(values[:, :m]), coefficients

    def _order_frictions(self, drawn: NDArray[np.float64], uniform: NDArray[np.float64]) -> None:
        """Draw the less known friction of each pair again, where the other one leaves room."""
        less, known = self._less_known, drawn[:, self._better_known]
        lower, upper = self._lower[less], self._upper[less]
        lower = np.where(self._draws_static, np.maximum(lower, known), lower)
        upper = np.where(self._draws_static, np.maximum(upper, lower), np.minimum(upper, known))
        lower = np.minimum(lower, upper)
        drawn[:, less] = _truncated_normal(
            uniform[:, less], self._mean[less], self._deviation[less], lower, upper
        )

    def _to_scale(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        logarithms = np.log(np.maximum(values, np.finfo(float).tiny))
        return np.where(self._logarithmic, logarithms, values)


def _truncated_normal(
    uniform: NDArray[np.float64],
    mean: NDArray[np.float64],
    deviation: NDArray[np.float64],
    lower: NDArray[np.float64],
    upper: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Quantiles of normal distributions between two bounds; uniform where `deviation` is infinite.

    All arrays broadcast; where `deviation` is next to zero the answer is the mean.
    """
    wide, exact = np.isinf(deviation), deviation < SMALLEST_DEVIATION
    spread = np.where(wide | exact, 1.0, deviation)
    low, high = (lower - mean) / spread, (upper - mean) / spread
    # The upper tail is read as the lower one of the mirrored distribution, where ndtr is precise.
    mirrored = low > 0.0
    a, b = np.where(mirrored, -high, low), np.where(mirrored, -low, high)
    share = np.where(mirrored, 1.0 - uniform, uniform)
    z = ndtri(ndtr(a) + share * (ndtr(b) - ndtr(a)))
    normal = mean + np.where(exact, 0.0, np.where(mirrored, -z, z) * spread)
    drawn = np.where(wide, lower + uniform * (upper - lower), normal)
    return np.asarray(np.clip(drawn, lower, upper))
