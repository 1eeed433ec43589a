"""Moving one parameter of θ_s at a time, all others fixed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.materials import PAIR_COEFFICIENTS, StaticParameters
from intuitive_physics.parameter_space import Bounds, ParameterSpace, parameter_vector


class ParameterAxes:
    """One axis for each parameter around a θ_s, each stretched over its bounds to [0, 1].

    `ParameterSpace` lays dynamic friction out below static friction, so a step along one axis of
    its cube can move both. Here every axis moves one number only; where μ_d ≤ μ_s or an equal
    lower and upper bound leave it less room than its bounds, `lower` and `upper` say so.

    Attributes
    ----------
    origin : (|θ_s|,) where θ_s lies on each axis
    lower, upper : (|θ_s|,) how far each axis can be walked, within [0, 1]
    slopes : (|θ_s|,) change of the parameter in its SI unit along its axis at the origin
    """

    def __init__(self, space: ParameterSpace, parameters: StaticParameters) -> None:
        self._materials = space.materials
        self._vector = parameter_vector(parameters)
        m, kinds = len(space.materials), len(PAIR_COEFFICIENTS)
        names = ["density"] * m + list(PAIR_COEFFICIENTS) * ((self._vector.size - m) // kinds)
        self._bounds = [space.bounds[name] for name in names]
        self.origin = self._to_axes(self._vector)
        self.lower = np.zeros(self.size)
        self.upper = np.array([float(b.upper > b.lower) for b in self._bounds])
        static = np.arange(m, self.size, kinds)
        # Each friction is the limit of the other.
        swapped = self._vector.copy()
        swapped[static], swapped[static + 1] = self._vector[static + 1], self._vector[static]
        limits = np.clip(self._to_axes(swapped), self.lower, self.upper)
        self.lower[static] = limits[static]
        self.upper[static + 1] = limits[static + 1]
        self.slopes = np.array(list(map(Bounds.slope, self._bounds, self._vector)))

    @property
    def size(self) -> int:
        """|θ_s|."""
        return int(self._vector.size)

    def moved(self, axis: int, place: float) -> StaticParameters:
        """Return θ_s with one parameter at another place on its axis, between lower and upper."""
        return self.dragged(axis, float(np.clip(place, self.lower[axis], self.upper[axis])))

    def dragged(self, axis: int, place: float) -> StaticParameters:
        """Return θ_s with one parameter anywhere within its bounds, place 0 to 1.

        The other friction of its pair comes along where μ_d ≤ μ_s leaves no room.
        """
        vector = self._vector.copy()
        vector[axis] = _value(self._bounds[axis], place)
        m, kinds = len(self._materials), len(PAIR_COEFFICIENTS)
        if axis >= m:
            static = m + (axis - m) // kinds * kinds
            if axis == static:
                vector[static + 1] = min(vector[static + 1], vector[static])
            else:
                vector[static] = max(vector[static], vector[static + 1])
        return parameters_of_vector(self._materials, vector)

    def value(self, axis: int, place: float) -> float:
        """Return the parameter, in its SI unit, at a place of its axis."""
        return _value(self._bounds[axis], place)

    def _to_axes(self, vector: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.array([_place(b, v) for b, v in zip(self._bounds, vector, strict=True)])


def _place(bounds: Bounds, value: float) -> float:
    if bounds.upper == bounds.lower:
        return 0.0
    value = min(max(value, bounds.lower), bounds.upper)
    if bounds.scale == "logarithmic":
        return float(np.log(value / bounds.lower) / np.log(bounds.upper / bounds.lower))
    return (value - bounds.lower) / (bounds.upper - bounds.lower)


def _value(bounds: Bounds, place: float) -> float:
    if bounds.scale == "logarithmic":
        return bounds.lower * (bounds.upper / bounds.lower) ** place
    return bounds.lower + place * (bounds.upper - bounds.lower)


def parameters_of_vector(
    materials: tuple[str, ...], vector: NDArray[np.float64]
) -> StaticParameters:
    """Return θ_s from one array.

    `vector` (|θ_s|,) in each parameter's SI unit, as `parameter_vector`
    returns it.
    """
    m = len(materials)
    rows, columns = np.triu_indices(m)
    by_pair = vector[m:].reshape(rows.size, len(PAIR_COEFFICIENTS)).T
    coefficients = np.empty((len(PAIR_COEFFICIENTS), m, m))
    coefficients[:, rows, columns] = by_pair
    coefficients[:, columns, rows] = by_pair
    return StaticParameters(materials, vector[:m], coefficients)
