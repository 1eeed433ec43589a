"""The unit cube that a search works on: all parameters, or only those that J can depend on."""

from __future__ import annotations

from copy import copy
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.materials import PAIR_COEFFICIENTS, StaticParameters
from intuitive_physics.parameter_space import ParameterSpace, parameter_vector

STATIC, DYNAMIC = map(PAIR_COEFFICIENTS.index, ("static_friction", "dynamic_friction"))
"""Indices of μ_s and μ_d among the coefficients of a pair."""


class SearchSpace(Protocol):
    """The interface of `ParameterSpace`, or of a part of it, that a search needs."""

    @property
    def size(self) -> int:
        """Number of parameters that are searched."""

    def to_parameters(self, unit: ArrayLike) -> StaticParameters:
        """Map a point of the unit cube to θ_s.

        `unit` (size,) point, each coordinate from 0 to 1.
        """


class ActiveSpace:
    """The unit cube of the active parameters; the others are fixed.

    Where the static friction of a pair is fixed and its dynamic friction is active, dynamic
    friction is cut off at static friction: a larger one has no effect.

    `active` (|θ_s|,) bool.
    """

    def __init__(
        self, space: ParameterSpace, active: NDArray[np.bool_], others: StaticParameters
    ) -> None:
        self._space = space
        self._places = np.flatnonzero(active)
        self._others = others
        self._unit = space.to_unit(others)
        m = len(space.materials)
        by_pair = active[m:].reshape(-1, len(PAIR_COEFFICIENTS))
        rows, columns = np.triu_indices(m)
        held = by_pair[:, DYNAMIC] & ~by_pair[:, STATIC]
        self._held = np.zeros((m, m), dtype=bool)
        self._held[rows, columns] = self._held[columns, rows] = held

    @property
    def size(self) -> int:
        """Number of active parameters."""
        return self._places.size

    @property
    def names(self) -> list[str]:
        """Name of each axis, as `parameter_names`."""
        return [self._space.names[k] for k in self._places]

    def to_parameters(self, unit: ArrayLike) -> StaticParameters:
        """Map a point of the cube, `unit` (size,) from 0 to 1, to θ_s."""
        whole = self._unit.copy()
        whole[self._places] = unit
        parameters = self._space.to_parameters(whole)
        if not self._held.any():
            return parameters
        # On the cube, static friction would follow dynamic friction.
        coefficients = parameters.coefficients.copy()
        static = np.where(self._held, self._others.coefficients[STATIC], coefficients[STATIC])
        coefficients[STATIC] = static
        coefficients[DYNAMIC] = np.minimum(coefficients[DYNAMIC], static)
        return StaticParameters(parameters.materials, parameters.density, coefficients)

    def values(self, unit: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the parameters (size,) of the axes in SI units, at `unit` (size,) of the cube."""
        return parameter_vector(self.to_parameters(unit))[self._places]

    def to_unit(self, parameters: StaticParameters) -> NDArray[np.float64]:
        """Map θ_s to the cube, (size,) coordinates from 0 to 1."""
        return self._space.to_unit(parameters)[self._places]

    def part(self, chosen: NDArray[np.int64], unit: NDArray[np.float64]) -> ActiveSpace:
        """Return the cube of some axes, `chosen` (k,) by index, others held at `unit` (size,)."""
        part = copy(self)
        part._unit = self._unit.copy()
        part._unit[self._places] = unit
        part._places = self._places[chosen]
        return part
