"""What is known of θ_s before a throw, on the unit cube that it is searched on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.materials import StaticParameters
from intuitive_physics.parameter_space import ParameterSpace
from intuitive_physics_learner.search.learning_task import UNIFORM_PRECISION
from intuitive_physics_learner.search.parameter_axes import ParameterAxes


@dataclass(frozen=True, eq=False)
class Posterior:
    """The Gaussian about θ_s, and draws from it within the cube.

    Parameters
    ----------
    space : of all n parameters
    mean : (n,) on the unit cube
    deviations : (n,) standard deviation by the observations alone, in widths; infinite where they
        do not determine a parameter
    """

    space: ParameterSpace
    mean: NDArray[np.float64]
    deviations: NDArray[np.float64]

    @staticmethod
    def of(learned: LearnedParameters, materials: Sequence[str]) -> Posterior:
        """Read it from what was learned, of these materials."""
        known = learned.extended(tuple(materials))
        space = ParameterSpace(known.materials)
        slopes = ParameterAxes(space, known.parameters).slopes
        known_deviation = known.identified & np.isfinite(known.standard_deviations)
        deviations = np.where(known_deviation, known.standard_deviations / slopes, np.inf)
        return Posterior(space, space.to_unit(known.parameters), deviations)

    @property
    def materials(self) -> tuple[str, ...]:
        """Names, in the order of the space."""
        return self.space.materials

    @property
    def covariance(self) -> NDArray[np.float64]:
        """Covariance (n, n), in widths²; that of the bounds alone where nothing else is known."""
        return np.diag(1.0 / (self.deviations**-2 + UNIFORM_PRECISION))

    def to_parameters(self, unit: NDArray[np.float64]) -> StaticParameters:
        """Map a point (n,) of the unit cube to θ_s."""
        return self.space.to_parameters(unit)

    def draw(self, count: int, rng: np.random.Generator) -> NDArray[np.float64]:
        """Draw points (count, n) of the unit cube."""
        known = np.isfinite(self.deviations)
        normal = self.mean + np.where(known, self.deviations, 0.0) * rng.standard_normal(
            (count, self.mean.size)
        )
        # Reflected at the bounds.
        inside = np.abs((normal + 1.0) % 2.0 - 1.0)
        return np.where(known, inside, rng.random((count, self.mean.size)))
