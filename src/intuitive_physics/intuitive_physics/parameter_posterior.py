"""The posterior of θ_s: a Gaussian cut off at the bounds, with all correlations.

On the unit cube of `ParameterSpace` the density is

    p(u) ∝ exp(-½ |F d(u)|²) within the cube, 0 outside,

where d is u minus the mean; for a parameter with a one-sided interval, its distance from that
interval. Fᵀ F is the information of all that was observed. Before anything was observed all of the
cube is alike, so that what nothing is known of is uniform without being told apart.

Draws are exact where they can be: a parameter that is correlated with no other is drawn by its
quantiles. Correlated ones are drawn by hit-and-run (Chen & Schmeiser 1993), many chains side by
side: from the mean, each moves along the right singular vectors of F, then along the axes, each
time to a draw of the density along that line, which is a normal distribution cut off at both ends.
Far from the bounds the first round along the singular vectors is an exact draw already.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse.csgraph import connected_components

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.materials import (
    StaticParameters,
    parameter_count,
    parameter_names,
    parameter_places,
)
from intuitive_physics.parameter_space import Bounds, ParameterSpace, parameter_vector
from intuitive_physics.truncated_normal import flat_interval_quantiles, truncated_normal_quantiles
from intuitive_physics.validation import finite_array

PRIOR_PRECISION = 12.0
"""One over the variance of a number known only to lie within the unit interval, per width²."""

LARGEST_DEVIATION = 0.5 / np.sqrt(PRIOR_PRECISION)
"""Width: standard deviation from which on a parameter is called not identified, half that of a
uniform number. Only a label: draws do not depend on it."""

SMALLEST_SINGULAR_VALUE = 1e-3
"""Per width: singular values of F below this are left out. Over the whole cube of 1000 parameters
that changes the logarithm of the density by less than 0.0005."""

LARGEST_SINGULAR_VALUE = 1e6
"""Per width: what is known better than to a millionth of its bounds is known exactly."""

SMALLEST_CORRELATION = 1e-8
"""Magnitude of a correlation in the information matrix below which it is rounding."""

ROUNDS = 25
"""Rounds of hit-and-run from the mean to a draw. Means, deviations and correlations of thin ridges
through corners of the cube, the slowest cases of the tests, stand still from about 10 on."""

MARGINAL_DRAWS = 4096
"""Draws that marginals of correlated parameters near their bounds are computed from: deviations
are right within about 1 %."""

INSIDE = 6.0
"""Standard deviations from all bounds at which cutting off changes nothing."""


@dataclass(frozen=True, eq=False)
class ParameterPosterior:
    """What is known of θ_s, on the unit cube of `ParameterSpace(materials, bounds)`.

    Parameters
    ----------
    materials : names, in the order of `StaticParameters.materials`
    mean : (n,) where the density is highest, each coordinate from 0 to 1, in the order of
        `parameter_names(materials)`
    factor : (r, n) F, per width, r ≤ n; Fᵀ F is the information of the observations and of priors
        the user gave, without that of the bounds; columns are zero where nothing is known
    bounds : by kind of parameter; what is left out has its default
    intervals : (n, 2) widths, ends of one-sided intervals, within which the density does not depend
        on a parameter; NaN for parameters without one; None: no parameter has one

    Raises
    ------
    InvalidInputError
        When an array has another shape or values outside its range.
    """

    materials: tuple[str, ...]
    mean: NDArray[np.float64]
    factor: NDArray[np.float64]
    bounds: Mapping[str, Bounds]
    intervals: NDArray[np.float64]

    def __init__(
        self,
        materials: Sequence[str],
        mean: ArrayLike,
        factor: ArrayLike,
        bounds: Mapping[str, Bounds] | None = None,
        intervals: ArrayLike | None = None,
    ) -> None:
        space = ParameterSpace(tuple(materials), bounds or {})
        size = space.size
        mean = finite_array(mean, "mean of the posterior", (size,))
        if (mean < 0.0).any() or (mean > 1.0).any():
            raise InvalidInputError(
                f"mean of the posterior reaches from {mean.min():g} to {mean.max():g}; expected "
                "coordinates from 0 to 1"
            )
        factor = finite_array(factor, "factor of the posterior", (None, size))
        if len(factor) > size:
            raise InvalidInputError(
                f"factor of the posterior has {len(factor)} rows; expected at most {size}, one for "
                "each parameter (`ParameterPosterior.from_information` makes such a one)"
            )
        for name, value in (
            ("materials", space.materials),
            ("mean", _frozen(mean)),
            ("factor", _frozen(factor)),
            ("bounds", space.bounds),
            ("intervals", _frozen(_checked_intervals(intervals, size))),
        ):
            object.__setattr__(self, name, value)

    @staticmethod
    def from_information(
        materials: Sequence[str],
        mean: ArrayLike,
        information: ArrayLike,
        bounds: Mapping[str, Bounds] | None = None,
        intervals: ArrayLike | None = None,
    ) -> ParameterPosterior:
        """Make a posterior from an information matrix, in its numerical rank.

        Parameters
        ----------
        materials, mean, bounds, intervals : as of the class
        information : (n, n) symmetric, positive semi-definite, per width²
        """
        size = parameter_count(len(tuple(materials)))
        matrix = finite_array(information, "information", (size, size))
        squares, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
        factor = _compressed(np.sqrt(np.maximum(squares, 0.0))[:, None] * vectors.T)
        return ParameterPosterior(materials, mean, factor, bounds, intervals)

    @staticmethod
    def from_marginals(
        parameters: StaticParameters,
        standard_deviations: NDArray[np.float64],
        identified: NDArray[np.bool_],
        intervals: NDArray[np.float64],
        bounds: Mapping[str, Bounds] | None = None,
    ) -> ParameterPosterior:
        """Make a posterior from what is known of each parameter by itself.

        Of a parameter that is not identified, nothing is known.

        Parameters
        ----------
        parameters : θ_s; where a value lies outside the bounds of its kind, these are widened
        standard_deviations : (n,) in each parameter's SI unit, NaN where not known; of a
            logarithmic parameter x the deviation of ln x is that of x divided by x
        identified : (n,) bool
        intervals : (n, 2) one-sided intervals in SI units, NaN for parameters without one
        bounds : by kind of parameter; what is left out has its default
        """
        space = ParameterSpace(parameters.materials, bounds or {})
        space = ParameterSpace(parameters.materials, _widened(space.bounds, parameters))
        mean = space.to_unit(parameters)
        known = np.flatnonzero(identified & ~np.isnan(standard_deviations))
        rows = space.slopes(mean)[known]
        lengths = np.linalg.norm(rows, axis=1)
        smallest = lengths / LARGEST_SINGULAR_VALUE
        deviations = np.maximum(standard_deviations[known], smallest)
        factor = np.divide(
            rows, deviations[:, None], out=np.zeros_like(rows), where=lengths[:, None] > 0.0
        )
        ends = np.full((space.size, 2), np.nan)
        values = parameter_vector(parameters)
        for k in known[~np.isnan(intervals[known, 0])]:
            for side in (0, 1):
                moved = values.copy()
                moved[k] = intervals[k, side]
                ends[k, side] = space.to_units(moved[None])[0, k]
        return ParameterPosterior(space.materials, mean, factor[lengths > 0.0], space.bounds, ends)

    @property
    def space(self) -> ParameterSpace:
        """The unit cube."""
        return ParameterSpace(self.materials, self.bounds)

    @property
    def information(self) -> NDArray[np.float64]:
        """Fᵀ F, (n, n) per width²."""
        return np.asarray(self.factor.T @ self.factor)

    def extended(self, materials: Sequence[str]) -> ParameterPosterior:
        """Return the same for other materials: of new ones nothing is known.

        Materials that are left out are integrated over, with a normal prior of the variance of a
        uniform one.
        """
        old, new = parameter_places(self.materials, materials)
        mean = ParameterSpace(tuple(materials), self.bounds).to_unit(
            StaticParameters.uniform(materials)
        )
        mean[new] = self.mean[old]
        own = _marginal_factor(self.factor, old)
        factor = np.zeros((len(own), mean.size))
        factor[:, new] = own
        intervals = np.full((mean.size, 2), np.nan)
        intervals[new] = self.intervals[old]
        return ParameterPosterior(materials, mean, factor, self.bounds, intervals)

    def scaled(self, scale: float) -> ParameterPosterior:
        """Return a posterior whose standard deviations are those of this one times `scale`.

        With 0, all that is known of is known exactly, one-sided intervals included.
        """
        intervals = None if scale == 0.0 else self.intervals
        factor = _compressed(self.factor, scale)
        return ParameterPosterior(self.materials, self.mean, factor, self.bounds, intervals)

    def draw(
        self, count: int, rng: np.random.Generator, box: NDArray[np.float64] | None = None
    ) -> NDArray[np.float64]:
        """Draw points of the unit cube.

        Parameters
        ----------
        count : number of draws
        rng : the only source of randomness
        box : (n, 2) widths, lower and upper ends that draws are cut off at instead of 0 and 1, on
            either side of the mean

        Returns
        -------
        (count, n) points, in the order of `parameter_names(materials)`
        """
        lower, upper = np.array([[0.0], [1.0]]) if box is None else np.asarray(box).T
        lower, upper = np.maximum(lower, 0.0), np.minimum(upper, 1.0)
        lower, upper = (np.broadcast_to(end, self.mean.shape) for end in (lower, upper))
        alone, groups = self._parts()
        drawn = np.empty((count, self.mean.size))
        drawn[:, alone] = self._alone(alone, rng.random((count, alone.size)), lower, upper)
        for members in groups:
            chains = _Chains(self, members, lower, upper, count)
            for _ in range(ROUNDS):
                chains.move(rng)
            drawn[:, members] = chains.points.T
        return drawn

    def covariance(self) -> NDArray[np.float64]:
        """Return the covariance (n, n), widths², of the distribution as it is cut off."""
        alone, groups = self._parts()
        covariance = np.zeros((self.mean.size, self.mean.size))
        shares = (np.arange(MARGINAL_DRAWS) + 0.5) / MARGINAL_DRAWS
        ends = np.zeros_like(self.mean), np.ones_like(self.mean)
        covariance[alone, alone] = self._alone(alone, shares[:, None], *ends).var(axis=0)
        rng = np.random.default_rng(0)
        for members in groups:
            covariance[np.ix_(members, members)] = self._covariance_of(members, rng)
        return covariance

    def standard_deviations(self) -> NDArray[np.float64]:
        """Return the standard deviations (n,), widths, of the marginals."""
        return np.asarray(np.sqrt(np.diag(self.covariance())))

    @property
    def identified(self) -> NDArray[np.bool_]:
        """Which parameters (n,) are known clearly better than by their bounds alone: a label."""
        return np.asarray(self.standard_deviations() < LARGEST_DEVIATION)

    def to_dict(self) -> dict[str, Any]:
        """Return plain data (numbers, strings, lists) for JSON or YAML."""
        named = zip(parameter_names(self.materials), self.intervals, strict=True)
        return {
            "materials": list(self.materials),
            "mean": self.mean.tolist(),
            "factor": self.factor.tolist(),
            "bounds": {k: [b.lower, b.upper, b.scale] for k, b in self.bounds.items()},
            "intervals": {name: ends.tolist() for name, ends in named if not np.isnan(ends[0])},
        }

    @staticmethod
    def from_dict(data: Mapping[str, Any]) -> ParameterPosterior:
        """Read what `to_dict` wrote.

        Raises
        ------
        InvalidInputError
            When a field is missing or not what it must be.
        """
        try:
            materials = list(data["materials"])
            names = parameter_names(materials)
            ends = dict(data["intervals"])
            unknown = sorted(set(ends) - set(names))
            if unknown:
                raise InvalidInputError(
                    f"the posterior has an interval of {unknown[0]!r}; expected parameters "
                    f"of the materials {', '.join(materials)}"
                )
            return ParameterPosterior(
                materials,
                data["mean"],
                np.reshape(np.array(data["factor"], dtype=np.float64), (-1, len(names))),
                {kind: Bounds(*values) for kind, values in data["bounds"].items()},
                [ends.get(name, [np.nan, np.nan]) for name in names],
            )
        except (KeyError, TypeError, AttributeError, ValueError) as error:
            if isinstance(error, InvalidInputError):
                raise
            raise InvalidInputError(
                f"the posterior of θ_s cannot be read ({error}); expected materials, mean, factor, "
                "bounds and intervals"
            ) from None

    def _parts(self) -> tuple[NDArray[np.int64], list[NDArray[np.int64]]]:
        """Return the parameters that are correlated with no other, and groups of those that are."""
        information = self.information
        roots = np.sqrt(np.diag(information))
        linked = np.abs(information) > SMALLEST_CORRELATION * np.outer(roots, roots)
        _, labels = connected_components(linked, directed=False)
        sizes = np.bincount(labels)
        groups = [np.flatnonzero(labels == k) for k in np.flatnonzero(sizes > 1)]
        return np.flatnonzero(sizes[labels] == 1), groups

    def _alone(
        self,
        chosen: NDArray[np.int64],
        shares: NDArray[np.float64],
        lower: NDArray[np.float64],
        upper: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """Return quantiles (count, n_chosen) of parameters that are correlated with no other."""
        mean, lower, upper = self.mean[chosen], lower[chosen], upper[chosen]
        lengths = np.linalg.norm(self.factor[:, chosen], axis=0)
        with np.errstate(divide="ignore"):
            drawn = truncated_normal_quantiles(shares, mean, 1.0 / lengths, lower, upper)
        sided = np.flatnonzero(~np.isnan(self.intervals[chosen, 0]))
        drawn[:, sided] = flat_interval_quantiles(
            np.broadcast_to(shares, drawn.shape)[:, sided],
            0.0,
            lengths[sided] ** 2,
            tuple(self.intervals[chosen[sided]].T),
            (lower[sided], upper[sided]),
        )
        exact = (lengths >= LARGEST_SINGULAR_VALUE * (1.0 - 1e-9)) & np.isnan(
            self.intervals[chosen, 0]
        )
        return np.where(exact, mean, drawn)

    def _covariance_of(
        self, members: NDArray[np.int64], rng: np.random.Generator
    ) -> NDArray[np.float64]:
        """Return the covariance of correlated parameters: in closed form far from all bounds."""
        own = self.factor[:, members]
        values, vectors = np.linalg.eigh(own.T @ own)
        if values[0] > 0.0 and np.isnan(self.intervals[members]).all():
            whole = (vectors / values) @ vectors.T
            margins = np.minimum(self.mean[members], 1.0 - self.mean[members])
            if (margins > INSIDE * np.sqrt(np.diag(whole))).all():
                return np.asarray(whole)
        lower, upper = np.zeros_like(self.mean), np.ones_like(self.mean)
        chains = _Chains(self, members, lower, upper, MARGINAL_DRAWS)
        for _ in range(ROUNDS):
            chains.move(rng)
        return np.atleast_2d(np.cov(chains.points))


class _Chains:
    """Chains of hit-and-run, side by side, over parameters that are correlated.

    Parameters
    ----------
    posterior : that they draw from
    members : (k,) indices of the parameters
    lower, upper : (n,) ends of all parameters
    count : number of chains

    Attributes
    ----------
    points : (k, count) where the chains are
    """

    def __init__(
        self,
        posterior: ParameterPosterior,
        members: NDArray[np.int64],
        lower: NDArray[np.float64],
        upper: NDArray[np.float64],
        count: int,
    ) -> None:
        self._factor = _compressed(posterior.factor[:, members])
        self._mean = posterior.mean[members, None]
        self._intervals = posterior.intervals[members]
        self._sided = ~np.isnan(self._intervals[:, 0])
        self._lower, self._upper = lower[members, None], upper[members, None]
        # Where intervals bend the density, lines run along their axes only.
        free = np.flatnonzero(~self._sided)
        self._directions = np.zeros((free.size, members.size))
        if free.size:
            self._directions[:, free] = np.linalg.svd(self._factor[:, free])[2]
        self.points = np.repeat(np.clip(self._mean, self._lower, self._upper), count, axis=1)

    def move(self, rng: np.random.Generator) -> None:
        """Move all chains along each line once."""
        projected = self._factor @ self._distances()
        for direction in self._directions:
            projected += self._along(direction, projected, rng)
        for axis in range(len(self.points)):
            if self._sided[axis]:
                projected += self._along_sided(axis, projected, rng)
            else:
                unit = np.zeros(len(self.points))
                unit[axis] = 1.0
                projected += self._along(unit, projected, rng)

    def _distances(self) -> NDArray[np.float64]:
        distances = self.points - self._mean
        for axis in np.flatnonzero(self._sided):
            distances[axis] = _distance(self.points[axis], self._intervals[axis])
        return distances

    def _along(
        self,
        direction: NDArray[np.float64],
        projected: NDArray[np.float64],
        rng: np.random.Generator,
    ) -> NDArray[np.float64]:
        """Move along a direction (k,); return by how much F d, (r, count), changes."""
        axes = np.flatnonzero(np.abs(direction) > SMALLEST_CORRELATION)
        parts = direction[axes, None]
        points, lower, upper = self.points[axes], self._lower[axes], self._upper[axes]
        ends = (lower - points) / parts, (upper - points) / parts
        least = np.minimum(np.minimum(*ends).max(axis=0), 0.0)
        most = np.maximum(np.maximum(*ends).min(axis=0), 0.0)
        slopes = self._factor @ direction
        precision = float(slopes @ slopes)
        informed = precision > SMALLEST_SINGULAR_VALUE**4
        moves = truncated_normal_quantiles(
            rng.random(least.size),
            -(slopes @ projected) / precision if informed else 0.0,
            precision**-0.5 if informed else np.inf,
            least,
            most,
        )
        self.points[axes] = np.clip(points + parts * moves, lower, upper)
        return np.outer(slopes, moves)

    def _along_sided(
        self, axis: int, projected: NDArray[np.float64], rng: np.random.Generator
    ) -> NDArray[np.float64]:
        """Move along the axis of a one-sided interval; return by how much F d changes."""
        slopes, interval = self._factor[:, axis], self._intervals[axis]
        precision = float(slopes @ slopes)
        before = _distance(self.points[axis], interval)
        self.points[axis] = flat_interval_quantiles(
            rng.random(before.size),
            slopes @ projected - precision * before,
            precision,
            (interval[0], interval[1]),
            (self._lower[axis], self._upper[axis]),
        )
        return np.outer(slopes, _distance(self.points[axis], interval) - before)


def _distance(points: NDArray[np.float64], interval: NDArray[np.float64]) -> NDArray[np.float64]:
    """Distance from an interval, negative below it."""
    return np.asarray(points - np.clip(points, interval[0], interval[1]))


def _compressed(factor: NDArray[np.float64], scale: float = 1.0) -> NDArray[np.float64]:
    """Return a factor of the same information over scale², without rows that say nothing."""
    if not factor.size:
        return factor
    _, values, vectors = np.linalg.svd(factor, full_matrices=False)
    kept = values >= SMALLEST_SINGULAR_VALUE
    if scale > 0.0:
        kept &= values >= SMALLEST_SINGULAR_VALUE * scale
    with np.errstate(divide="ignore"):
        values = np.minimum(values[kept] / scale, LARGEST_SINGULAR_VALUE)
    return np.asarray(values[:, None] * vectors[kept])


def _marginal_factor(factor: NDArray[np.float64], kept: NDArray[np.int64]) -> NDArray[np.float64]:
    """Factor of the information on some parameters, after the others are integrated over."""
    others = np.setdiff1d(np.arange(factor.shape[1]), kept)
    if not others.size or not factor.size:
        return factor[:, kept]
    left, values, _ = np.linalg.svd(factor[:, others])
    shares = np.ones(len(factor))
    # A row that others can explain says less of those that are kept.
    shares[: values.size] = 1.0 / np.sqrt(1.0 + values**2 / PRIOR_PRECISION)
    return _compressed(shares[:, None] * (left.T @ factor[:, kept]))


def _widened(bounds: Mapping[str, Bounds], parameters: StaticParameters) -> dict[str, Bounds]:
    """Return bounds that hold all values of θ_s."""
    wide = dict(bounds)
    values = parameter_vector(parameters)
    kinds = np.array([name.split("[")[0] for name in parameter_names(parameters.materials)])
    for kind, own in bounds.items():
        least, most = values[kinds == kind].min(), values[kinds == kind].max()
        if own.scale == "logarithmic":
            least = max(least, np.finfo(float).tiny)
        wide[kind] = Bounds(min(own.lower, float(least)), max(own.upper, float(most)), own.scale)
    return wide


def _checked_intervals(value: ArrayLike | None, size: int) -> NDArray[np.float64]:
    given = np.full((size, 2), np.nan) if value is None else np.array(value, dtype=np.float64)
    if given.shape != (size, 2):
        raise InvalidInputError(
            f"intervals of the posterior have shape {given.shape}; expected ({size}, 2)"
        )
    none = np.isnan(given).all(axis=1)
    right = (given[:, 0] >= 0.0) & (given[:, 0] <= given[:, 1]) & (given[:, 1] <= 1.0)
    if not (none | right).all():
        raise InvalidInputError(
            f"interval of the posterior is {given[~(none | right)][0].tolist()}; expected two ends "
            "from 0 to 1 that do not fall, or NaN twice"
        )
    return given


def _frozen(array: NDArray[np.float64]) -> NDArray[np.float64]:
    array.setflags(write=False)
    return array
