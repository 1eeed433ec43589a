"""The posterior of θ_s: a Gaussian cut off at the bounds, with all correlations.

On the unit cube of `ParameterSpace` the density is

    p(u) ∝ exp(-½ |F d(u)|²) within the cube, 0 outside,

where d is u minus the mean; for a parameter with a one-sided interval, its distance from that
interval. Fᵀ F is the information of all that was observed. Before anything was observed all of the
cube is alike, so that what nothing is known of is uniform, and what little is known of almost so.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.limits import check_limit
from intuitive_physics.materials import (
    StaticParameters,
    parameter_count,
    parameter_names,
    parameter_places,
)
from intuitive_physics.parameter_space import (
    DEFAULT_BOUNDS,
    Bounds,
    ParameterSpace,
    parameter_vector,
)
from intuitive_physics.truncated_gaussian import (
    LARGEST_SINGULAR_VALUE,
    TruncatedGaussian,
    compressed,
)
from intuitive_physics.validation import finite_array, set_fields

UNIFORM_PRECISION = 12.0
"""One over the variance of a number known only to lie within the unit interval, per width²."""

LARGEST_DEVIATION = 0.5 / np.sqrt(UNIFORM_PRECISION)
"""Width: standard deviation from which on a parameter is called not identified, half that of a
uniform number. Only a label: draws do not depend on it."""


@dataclass(frozen=True, eq=False)
class ParameterPosterior:
    """Knowledge of θ_s, on the unit cube of `ParameterSpace(materials, bounds)`.

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
        set_fields(
            self,
            materials=space.materials,
            mean=mean,
            factor=factor,
            bounds=space.bounds,
            intervals=checked_intervals(intervals, size, 0.0, 1.0),
        )

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
        materials : names
        mean : (n,) point of the unit cube, as of the class
        bounds : by kind of parameter, as of the class
        intervals : (n, 2) widths, as of the class
        information : (n, n) symmetric, positive semi-definite, per width²
        """
        size = parameter_count(len(tuple(materials)))
        matrix = finite_array(information, "information", (size, size))
        squares, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
        factor = compressed(np.sqrt(np.maximum(squares, 0.0))[:, None] * vectors.T)
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
        space = ParameterSpace(parameters.materials, widened_bounds(bounds or {}, parameters))
        mean = space.to_unit(parameters)
        informed = np.flatnonzero(identified & ~np.isnan(standard_deviations))
        rows = space.slopes(mean)[informed]
        lengths = np.linalg.norm(rows, axis=1)
        informed, rows, lengths = (each[lengths > 0.0] for each in (informed, rows, lengths))
        deviations = np.maximum(standard_deviations[informed], lengths / LARGEST_SINGULAR_VALUE)
        ends = np.full((space.size, 2), np.nan)
        ends[informed] = unit_intervals(space, parameters, intervals)[informed]
        factor = rows / deviations[:, None]
        return ParameterPosterior(space.materials, mean, factor, space.bounds, ends)

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
        marginal = _marginal_factor(self.factor, old)
        factor = np.zeros((len(marginal), mean.size))
        factor[:, new] = marginal
        intervals = np.full((mean.size, 2), np.nan)
        intervals[new] = self.intervals[old]
        return ParameterPosterior(materials, mean, factor, self.bounds, intervals)

    def within(self, bounds: Mapping[str, Bounds]) -> ParameterPosterior:
        """Return the same on the cube of other bounds, to first order about the mean.

        Parameters
        ----------
        bounds : by kind of parameter; what is left out has its default
        """
        old, new = self.space, ParameterSpace(self.materials, bounds)
        if old.bounds == new.bounds:
            return self
        parameters = old.to_parameters(self.mean)
        mean = new.to_unit(parameters)
        steps = np.linalg.pinv(old.slopes(self.mean)) @ new.slopes(mean)
        ends = np.full(self.intervals.shape, np.nan)
        for axis in np.flatnonzero(~np.isnan(self.intervals[:, 0])):
            moved = np.tile(self.mean, (2, 1))
            moved[:, axis] = self.intervals[axis]
            ends[axis] = new.to_units(old.to_values(moved))[:, axis]
        factor = compressed(self.factor @ steps)
        return ParameterPosterior(self.materials, mean, factor, bounds, ends)

    def renewed(
        self,
        chosen: NDArray[np.bool_],
        mean: NDArray[np.float64],
        information: NDArray[np.float64],
        intervals: NDArray[np.float64],
    ) -> ParameterPosterior:
        """Return a posterior in which some parameters are known by other observations only.

        What is known of the other parameters stays, after those chosen are integrated over.

        Parameters
        ----------
        chosen : (n,) bool, the parameters whose knowledge is replaced
        mean : (n,) of all parameters
        information : (n, n) per width², of the chosen parameters; that of others is not read
        intervals : (n, 2) widths, likewise
        """
        kept, new = np.flatnonzero(~chosen), np.flatnonzero(chosen)
        marginal = _marginal_factor(self.factor, kept)
        combined = np.zeros((mean.size, mean.size))
        combined[np.ix_(kept, kept)] = marginal.T @ marginal
        combined[np.ix_(new, new)] = information[np.ix_(new, new)]
        ends = np.where(chosen[:, None], intervals, self.intervals)
        return ParameterPosterior.from_information(
            self.materials, mean, combined, self.bounds, ends
        )

    def combined(
        self, factor: NDArray[np.float64], mean: NDArray[np.float64] | None = None
    ) -> ParameterPosterior:
        """Return a posterior that knows more.

        Parameters
        ----------
        factor : (k, n) of independent information, per width
        mean : (n,) of what results; None: the same as before
        """
        whole = compressed(np.vstack([self.factor, factor]))
        mean = self.mean if mean is None else mean
        return ParameterPosterior(self.materials, mean, whole, self.bounds, self.intervals)

    def scaled(self, scale: float) -> ParameterPosterior:
        """Return a posterior whose standard deviations are those of this one times `scale`.

        With 0, all that is known of is known exactly, one-sided intervals included.
        """
        intervals = None if scale == 0.0 else self.intervals
        factor = compressed(self.factor, scale)
        return ParameterPosterior(self.materials, self.mean, factor, self.bounds, intervals)

    def draw(
        self, count: int, rng: np.random.Generator, box: NDArray[np.float64] | None = None
    ) -> NDArray[np.float64]:
        """Draw points of the unit cube.

        Parameters
        ----------
        count : number of draws
        rng : the only source of randomness
        box : (n, 2) widths within the cube, lower and upper ends that draws are cut off at instead
            of 0 and 1, on either side of the mean

        Returns
        -------
        (count, n) points, in the order of `parameter_names(materials)`
        """
        return self._within_box(box).draw(count, rng)

    def covariance(self) -> NDArray[np.float64]:
        """Return the covariance (n, n), widths², of the distribution as it is cut off."""
        return self._within_box(None).covariance()

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
            check_limit("most_materials", len(materials), "materials of the posterior")
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

    def _within_box(self, box: NDArray[np.float64] | None) -> TruncatedGaussian:
        lower, upper = np.zeros_like(self.mean), np.ones_like(self.mean)
        if box is not None:
            lower, upper = np.asarray(box).T
        return TruncatedGaussian(self.mean, self.factor, self.intervals, lower, upper)


def unit_intervals(
    space: ParameterSpace, parameters: StaticParameters, intervals: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return one-sided intervals on the unit cube.

    Parameters
    ----------
    space : the cube
    parameters : θ_s, whose other parameters are those of each end
    intervals : (n, 2) in SI units, NaN for parameters without one

    Returns
    -------
    (n, 2) widths, NaN for parameters without one
    """
    ends = np.full(intervals.shape, np.nan)
    sided = np.flatnonzero(~np.isnan(intervals[:, 0]))
    for side in range(2):
        moved = np.tile(parameter_vector(parameters), (sided.size, 1))
        moved[np.arange(sided.size), sided] = intervals[sided, side]
        ends[sided, side] = space.to_units(moved)[np.arange(sided.size), sided]
    return ends


def _marginal_factor(factor: NDArray[np.float64], kept: NDArray[np.int64]) -> NDArray[np.float64]:
    """Factor of the information on some parameters, after the others are integrated over."""
    others = np.setdiff1d(np.arange(factor.shape[1]), kept)
    if not others.size or not factor.size:
        return factor[:, kept]
    left, values, _ = np.linalg.svd(factor[:, others])
    shares = np.ones(len(factor))
    # A row that others can explain says less of those that are kept.
    shares[: values.size] = 1.0 / np.sqrt(1.0 + values**2 / UNIFORM_PRECISION)
    return compressed(shares[:, None] * (left.T @ factor[:, kept]))


def widened_bounds(bounds: Mapping[str, Bounds], parameters: StaticParameters) -> dict[str, Bounds]:
    """Return bounds by kind, moved outwards where a value of θ_s lies outside."""
    wide = {**DEFAULT_BOUNDS, **bounds}
    values = parameter_vector(parameters)
    kinds = np.array([name.split("[")[0] for name in parameter_names(parameters.materials)])
    for kind, limits in list(wide.items()):
        least, most = values[kinds == kind].min(), values[kinds == kind].max()
        if limits.scale == "logarithmic":
            least = max(least, np.finfo(float).tiny)
        wide[kind] = Bounds(
            min(limits.lower, float(least)), max(limits.upper, float(most)), limits.scale
        )
    return wide


def checked_intervals(
    value: ArrayLike | None, size: int, least: float = -np.inf, most: float = np.inf
) -> NDArray[np.float64]:
    """Return one-sided intervals (size, 2) with ends from `least` to `most`, or NaN twice.

    Parameters
    ----------
    value : (size, 2); None: all NaN
    """
    try:
        ends = np.array(np.full((size, 2), np.nan) if value is None else value, dtype=np.float64)
    except (TypeError, ValueError):
        raise InvalidInputError(
            f"intervals are {value!r:.80}; expected {size} pairs of numbers, one for each parameter"
        ) from None
    if ends.shape != (size, 2):
        raise InvalidInputError(
            f"intervals have shape {ends.shape}; expected ({size}, 2), two ends for each parameter"
        )
    right = (ends[:, 0] >= least) & (ends[:, 0] <= ends[:, 1]) & (ends[:, 1] <= most)
    right &= np.isfinite(ends).all(axis=1)
    wrong = ~(right | np.isnan(ends).all(axis=1))
    if wrong.any():
        numbers = "finite numbers" if np.isinf(most) else f"numbers from {least:g} to {most:g}"
        raise InvalidInputError(
            f"interval is {ends[wrong][0].tolist()}; expected two {numbers}, the lower one first, "
            "or NaN twice"
        )
    return ends
