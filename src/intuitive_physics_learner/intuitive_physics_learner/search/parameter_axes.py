"""Moving one parameter of θ_s at a time, all others fixed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.materials import PAIR_COEFFICIENTS, StaticParameters
from intuitive_physics.parameter_space import (
    Bounds,
    ParameterSpace,
    parameter_vector,
    parameters_of_vector,
    shrink,
    stretch,
)


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
        vector[axis] = self.value(axis, place)
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
        return float(stretch(np.asarray(place), self._bounds[axis]))

    def _to_axes(self, vector: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.array([shrink(v, b) for b, v in zip(self._bounds, vector, strict=True)])
