"""The search space of θ_s: a unit cube with a bound and a scale for each parameter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.errors import InvalidInputError, UnknownNameError
from intuitive_physics.materials import (
    PAIR_COEFFICIENTS,
    StaticParameters,
    pair_count,
    parameter_count,
    parameter_names,
)
from intuitive_physics.validation import finite_array, finite_float

SCALES = ("linear", "logarithmic")
"""Scales by which the unit interval is stretched over a range."""


@dataclass(frozen=True)
class Bounds:
    """Range of one kind of parameter and how the unit interval is stretched over it.

    Parameters
    ----------
    lower, upper : in the parameter's own unit
    scale : "linear" or "logarithmic" (then lower must be above zero)
    """

    lower: float
    upper: float
    scale: str = "linear"

    def __post_init__(self) -> None:
        finite_float(self.lower, "lower bound")
        finite_float(self.upper, "upper bound")
        if self.scale not in SCALES:
            raise UnknownNameError(f"scale is {self.scale!r}; expected one of {', '.join(SCALES)}")
        if self.lower > self.upper:
            raise InvalidInputError(
                f"bounds are {self.lower:g} to {self.upper:g}; expected lower ≤ upper"
            )
        if self.lower < 0.0 or (self.scale == "logarithmic" and self.lower == 0.0):
            raise InvalidInputError(
                f"lower bound is {self.lower:g}; expected ≥ 0, and above 0 on a logarithmic scale"
            )

    def slope(self, value: float) -> float:
        """Return by how much a parameter of this value changes for one of the unit interval."""
        if self.scale == "logarithmic":
            return value * float(np.log(self.upper / self.lower))
        return self.upper - self.lower


DEFAULT_BOUNDS: dict[str, Bounds] = {
    "density": Bounds(50.0, 8000.0, "logarithmic"),
    "static_friction": Bounds(0.0, 1.0),
    "dynamic_friction": Bounds(0.0, 1.0),
    "rolling_friction": Bounds(1e-4, 0.2, "logarithmic"),
    "restitution": Bounds(0.0, 1.0),
}
"""Range of each kind of parameter where nobody gives another: density in kg/m³, from foam to steel;
the coefficients dimensionless. Set by hand."""


@dataclass(frozen=True)
class ParameterSpace:
    """Maps points of the unit cube, shape (|θ_s|,), to θ_s and back.

    Every point of the cube is a valid θ_s: static friction is laid out between the larger of its
    lower bound and the pair's dynamic friction and its upper bound, so μ_d ≤ μ_s always. (Not the
    other way round: motion determines dynamic friction far better, so that has an axis of its own.)

    Parameters
    ----------
    materials : names, in the order of `StaticParameters.materials`
    bounds : by kind ("density", "static_friction", …); what is left out has `DEFAULT_BOUNDS`
    """

    materials: tuple[str, ...]
    bounds: Mapping[str, Bounds] = field(default_factory=dict)

    def __post_init__(self) -> None:
        unknown = sorted(set(self.bounds) - set(DEFAULT_BOUNDS))
        if unknown:
            raise UnknownNameError(
                f"bounds are given for {unknown[0]!r}; expected one of {', '.join(DEFAULT_BOUNDS)}"
            )
        merged = {**DEFAULT_BOUNDS, **self.bounds}
        object.__setattr__(self, "materials", tuple(self.materials))
        object.__setattr__(self, "bounds", merged)
        if merged["dynamic_friction"].lower > merged["static_friction"].lower:
            raise InvalidInputError(
                f"dynamic friction starts at {merged['dynamic_friction'].lower:g}, static friction "
                f"at {merged['static_friction'].lower:g}; expected dynamic ≤ static"
            )
        if merged["restitution"].upper > 1.0:
            raise InvalidInputError(
                f"restitution reaches {merged['restitution'].upper:g}; expected at most 1"
            )

    @property
    def size(self) -> int:
        """|θ_s| of Eq. 3."""
        return parameter_count(len(self.materials))

    @property
    def names(self) -> list[str]:
        """Name of each axis of the cube."""
        return parameter_names(self.materials)

    @property
    def kinds(self) -> list[str]:
        """Kind of each parameter, as `bounds` names it."""
        return [name.partition("[")[0] for name in self.names]

    @property
    def _dynamic_bounds(self) -> Bounds:
        dynamic, static = self.bounds["dynamic_friction"], self.bounds["static_friction"]
        return replace(dynamic, upper=min(dynamic.upper, static.upper))

    def to_parameters(self, unit: ArrayLike) -> StaticParameters:
        """Map a point of the unit cube to θ_s; a point outside the cube is clipped.

        Parameters
        ----------
        unit : (|θ_s|,) each from 0 to 1, in the order of `names`
        """
        point = finite_array(unit, "point of the unit cube", (self.size,))
        return parameters_of_vector(self.materials, self.to_values(point[None])[0])

    def to_values(self, units: NDArray[np.float64]) -> NDArray[np.float64]:
        """Map many points of the unit cube to the values of all parameters.

        Parameters
        ----------
        units : (count, |θ_s|) points; those outside the cube are clipped

        Returns
        -------
        (count, |θ_s|) in each parameter's SI unit, in the order of `names`
        """
        # Several times as fast as np.clip on small arrays, which searches and estimates have.
        points = np.minimum(np.maximum(units, 0.0), 1.0)
        m = len(self.materials)
        values = np.empty_like(points)
        values[:, :m] = stretch(points[:, :m], self.bounds["density"])
        shape = (len(points), pair_count(m), len(PAIR_COEFFICIENTS))
        by_pair, pair_values = points[:, m:].reshape(shape), values[:, m:].reshape(shape)
        dynamic = stretch(by_pair[..., 1], self._dynamic_bounds)
        pair_values[..., 0] = stretch(
            by_pair[..., 0], self.bounds["static_friction"], lower=dynamic
        )
        pair_values[..., 1] = dynamic
        pair_values[..., 2] = stretch(by_pair[..., 2], self.bounds["rolling_friction"])
        pair_values[..., 3] = stretch(by_pair[..., 3], self.bounds["restitution"])
        return values

    def own_slopes(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how each parameter changes along its own bounds, all others staying.

        Parameters
        ----------
        values : (|θ_s|,) in each parameter's SI unit, in the order of `names`

        Returns
        -------
        (|θ_s|,) SI units of the parameter per width of its bounds
        """
        of_kinds = zip(self.kinds, values, strict=True)
        return np.array([self.bounds[kind].slope(value) for kind, value in of_kinds])

    def slopes(self, unit: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how all parameters change along all axes of the cube.

        Parameters
        ----------
        unit : (|θ_s|,) point of the cube

        Returns
        -------
        (|θ_s|, |θ_s|) ∂θ/∂u: SI units of the row's parameter per width of the column's axis
        """
        values = self.to_values(unit[None])[0]
        matrix = np.diag(self.own_slopes(values))
        m = len(self.materials)
        static = np.arange(m, self.size, len(PAIR_COEFFICIENTS))
        dynamic = static + 1
        of_dynamic = self._dynamic_bounds
        matrix[dynamic, dynamic] = [of_dynamic.slope(v) for v in values[dynamic]]
        static_bounds, limit = (
            self.bounds["static_friction"],
            np.maximum(values[dynamic], np.finfo(float).tiny),
        )
        follows = values[dynamic] > static_bounds.lower
        low = np.maximum(values[dynamic], static_bounds.lower)
        if static_bounds.scale == "logarithmic":
            matrix[static, static] = values[static] * np.log(static_bounds.upper / low)
            along = (1.0 - unit[static]) * values[static] / limit
        else:
            matrix[static, static] = static_bounds.upper - low
            along = 1.0 - unit[static]
        matrix[static, dynamic] = np.where(follows, along * matrix[dynamic, dynamic], 0.0)
        return matrix

    def to_unit(self, parameters: StaticParameters) -> NDArray[np.float64]:
        """Map θ_s to the unit cube; values outside the bounds are clipped.

        Returns
        -------
        array
            (|θ_s|,) each from 0 to 1, in the order of `names`
        """
        if parameters.materials != self.materials:
            parameters = _reordered(parameters, self.materials)
        return self.to_units(parameter_vector(parameters)[None])[0]

    def to_units(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Map the values of all parameters to points of the unit cube; many at a time.

        Parameters
        ----------
        values : (count, |θ_s|) in each parameter's SI unit, in the order of `names`; those outside
            the bounds are clipped

        Returns
        -------
        (count, |θ_s|) each from 0 to 1
        """
        m = len(self.materials)
        units = np.empty(values.shape)
        units[:, :m] = shrink(values[:, :m], self.bounds["density"])
        static, dynamic, rolling, restitution = np.moveaxis(
            values[:, m:].reshape(len(values), pair_count(m), len(PAIR_COEFFICIENTS)), -1, 0
        )
        units[:, m:] = np.stack(
            [
                shrink(static, self.bounds["static_friction"], lower=dynamic),
                shrink(dynamic, self._dynamic_bounds),
                shrink(rolling, self.bounds["rolling_friction"]),
                shrink(restitution, self.bounds["restitution"]),
            ],
            axis=-1,
        ).reshape(units[:, m:].shape)
        return units


def parameter_vector(parameters: StaticParameters) -> NDArray[np.float64]:
    """θ_s as one array, shape (|θ_s|,), in the order of `parameter_names`, in SI units."""
    rows, columns = _pairs(len(parameters.materials))
    return np.concatenate([parameters.density, parameters.coefficients[:, rows, columns].T.ravel()])


def parameters_of_vector(
    materials: tuple[str, ...], vector: NDArray[np.float64]
) -> StaticParameters:
    """Return θ_s from one array.

    `vector` (|θ_s|,) in each parameter's SI unit, as `parameter_vector` returns it.
    """
    m = len(materials)
    rows, columns = _pairs(m)
    by_pair = vector[m:].reshape(pair_count(m), len(PAIR_COEFFICIENTS)).T
    coefficients = np.empty((len(PAIR_COEFFICIENTS), m, m))
    coefficients[:, rows, columns] = by_pair
    coefficients[:, columns, rows] = by_pair
    return StaticParameters(materials, vector[:m], coefficients)


@cache
def _pairs(count: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Rows and columns (pair_count,) of all pairs of `count` materials, in their order."""
    rows, columns = np.triu_indices(count)
    return rows, columns


def _reordered(parameters: StaticParameters, materials: Sequence[str]) -> StaticParameters:
    order = [parameters.index(name) for name in materials]
    return StaticParameters(
        materials, parameters.density[order], parameters.coefficients[:, order][:, :, order]
    )


def _limits(bounds: Bounds, lower: NDArray[np.float64] | None) -> tuple[NDArray[np.float64], float]:
    if lower is None:
        return np.asarray(bounds.lower), bounds.upper
    return np.minimum(np.maximum(lower, bounds.lower), bounds.upper), bounds.upper


def stretch(
    unit: NDArray[np.float64], bounds: Bounds, lower: NDArray[np.float64] | None = None
) -> NDArray[np.float64]:
    """Map places of the unit interval to values (...,) within bounds.

    `unit` (...,) from 0 to 1; `lower` (...,) replaces the lower bound where it is higher.
    """
    low, top = _limits(bounds, lower)
    is_logarithmic = bounds.scale == "logarithmic"
    values = low * (top / low) ** unit if is_logarithmic else low + unit * (top - low)
    return np.minimum(np.maximum(values, low), top)


def shrink(
    value: NDArray[np.float64], bounds: Bounds, lower: NDArray[np.float64] | None = None
) -> NDArray[np.float64]:
    """Map values within bounds to places (...,) of the unit interval; others are clipped.

    `value` (...,) in the unit of the bounds; `lower` (...,) as in `stretch`.
    """
    low, top = _limits(bounds, lower)
    if bounds.scale == "logarithmic":
        span = np.log(top / low)
        part = np.log(np.maximum(value, low) / low)
    else:
        span = top - low
        part = value - low
    span = np.broadcast_to(span, value.shape)
    unit = np.divide(part, span, out=np.zeros_like(value), where=span > 0.0)
    return np.clip(unit, 0.0, 1.0)
