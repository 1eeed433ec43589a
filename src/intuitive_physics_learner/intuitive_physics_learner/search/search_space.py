"""The unit cube that a search works on: all parameters, or only those that J can depend on."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.materials import PAIR_COEFFICIENTS, StaticParameters
from intuitive_physics.parameter_space import ParameterSpace

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
        self._active = active
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
        return int(self._active.sum())

    @property
    def names(self) -> list[str]:
        """Name of each axis, as `parameter_names`."""
        return [n for n, active in zip(self._space.names, self._active, strict=True) if active]

    def to_parameters(self, unit: ArrayLike) -> StaticParameters:
        """Map a point of the cube to θ_s.

        `unit` (size,) point, each coordinate from 0 to 1.
        """
        whole = self._unit.copy()
        whole[self._active] = unit
        parameters = self._space.to_parameters(whole)
        if not self._held.any():
            return parameters
        # On the cube, static friction would follow dynamic friction.
        coefficients = parameters.coefficients.copy()
        static = np.where(self._held, self._others.coefficients[STATIC], coefficients[STATIC])
        coefficients[STATIC] = static
        coefficients[DYNAMIC] = np.minimum(coefficients[DYNAMIC], static)
        return StaticParameters(parameters.materials, parameters.density, coefficients)

    def to_unit(self, parameters: StaticParameters) -> NDArray[np.float64]:
        """Map θ_s to the cube, (size,) coordinates from 0 to 1."""
        return self._space.to_unit(parameters)[self._active]


class PartialSpace:
    """The unit cube of some axes of another space; the others are held.

    `chosen` (k,) indices of the parameters that are searched; `unit` (n,) point of its cube that
    the others are taken from.
    """

    def __init__(
        self, space: SearchSpace, chosen: NDArray[np.int64], unit: NDArray[np.float64]
    ) -> None:
        self._space = space
        self._chosen = chosen
        self._unit = unit

    @property
    def size(self) -> int:
        """Number of parameters that are searched."""
        return self._chosen.size

    def to_parameters(self, unit: ArrayLike) -> StaticParameters:
        """Map a point of the cube to θ_s.

        `unit` (k,) point, each coordinate from 0 to 1.
        """
        whole = self._unit.copy()
        whole[self._chosen] = unit
        return self._space.to_parameters(whole)
