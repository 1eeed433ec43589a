"""Prior of the parameters on which one sphere's motion among surfaces depends."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.materials import PAIR_COEFFICIENTS
from intuitive_physics.parameter_space import Bounds, ParameterSpace
from intuitive_physics.simulation.world_batch import WorldBatch
from intuitive_physics_predictor.parameter_uncertainty import UncertainParameters

COEFFICIENTS = len(PAIR_COEFFICIENTS)
"""Coefficients of a pair of materials."""

CONTACT_SCATTER = 0.005
"""Standard deviation, on the unit interval, of a coefficient from one impact to the next, which θ_s
does not have. It is small beside the information of one throw."""


@dataclass(frozen=True, eq=False)
class PairKnowledge:
    """Moments of the coefficients of one material with others, and of its density.

    Parameters
    ----------
    mean : (p,) on the unit cube: the coefficients with each other material, then the density
    covariance : (p, p) widths²
    material : code of the sphere's material
    others : (k,) codes of the others
    has_density : whether the density is one of the p
    bounds : of the unit cube, by kind of parameter
    """

    mean: NDArray[np.float64]
    covariance: NDArray[np.float64]
    material: int
    others: NDArray[np.int64]
    has_density: bool
    bounds: Mapping[str, Bounds]

    @staticmethod
    def of(uncertain: UncertainParameters, world: WorldBatch) -> PairKnowledge:
        """Return the prior for the one sphere of a world, a batch of one.

        `uncertain` has at least the materials of the world, in their order.
        """
        material = int(world.object_materials[0, 0])
        surfaces = [
            world.plane_materials[0, : world.plane_counts[0]],
            world.box_materials[0, : world.box_counts[0]],
        ]
        others = np.unique(np.concatenate(surfaces)).astype(np.int64)
        has_density = bool(world.has_air_forces.any())
        columns = _columns(len(world.materials), material, others, has_density)
        drawn = uncertain.units[:, columns]
        covariance = np.atleast_2d(np.cov(drawn, rowvar=False)) if len(columns) else np.eye(0)
        return PairKnowledge(
            drawn.mean(axis=0),
            covariance + CONTACT_SCATTER**2 * np.eye(len(columns)),
            material,
            others,
            has_density,
            uncertain.bounds,
        )

    @cached_property
    def _space(self) -> ParameterSpace:
        return ParameterSpace(("any",), self.bounds)

    def tables(self, world: WorldBatch, units: NDArray[np.float64]) -> dict[str, Any]:
        """Return the fields of a batch with parameters of its own for each world.

        They are units (count, p), clipped to the unit cube; all others are those of `world`.
        """
        count = len(units)
        density = np.repeat(world.density, count, axis=0)
        coefficients = np.repeat(world.coefficients, count, axis=0)
        self.write(units, density, coefficients)
        return {
            "density": density,
            "coefficients": coefficients,
            "parameter_index": np.arange(count, dtype=np.int64),
        }

    def write(
        self,
        units: NDArray[np.float64],
        density: NDArray[np.float64],
        coefficients: NDArray[np.float64],
    ) -> None:
        """Write parameters units (count, p), clipped to the unit cube, into tables.

        These are density (count, m) kg/m³ and coefficients (count, 4, m, m), as those of
        `StaticParameters`.
        """
        pairs = len(self.others)
        # The cube of a single material is its density and the coefficients with itself.
        cube = np.zeros((len(units), max(pairs, 1), 1 + COEFFICIENTS))
        by_pair = units[:, : pairs * COEFFICIENTS].reshape(len(units), pairs, COEFFICIENTS)
        cube[:, :pairs, 1:] = by_pair
        if self.has_density:
            cube[:, 0, 0] = units[:, -1]
        values = self._space.to_values(cube.reshape(-1, cube.shape[-1])).reshape(cube.shape)
        by_kind = values[:, :pairs, 1:].swapaxes(1, 2)
        coefficients[:, :, self.material, self.others] = by_kind
        coefficients[:, :, self.others, self.material] = by_kind
        if self.has_density:
            density[:, self.material] = values[:, 0, 0]


def _columns(m: int, material: int, others: NDArray[np.int64], has_density: bool) -> list[int]:
    """Return which parameters these are, in the order of `parameter_names`."""
    rows, columns = np.triu_indices(m)
    number = np.empty((m, m), dtype=np.int64)
    number[rows, columns] = number[columns, rows] = m + COEFFICIENTS * np.arange(rows.size)
    numbers = [int(number[material, other]) + k for other in others for k in range(COEFFICIENTS)]
    return numbers + [material] * has_density
