"""Distributions of trajectories: weighted samples, and the moments they have."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError, UnknownNameError
from intuitive_physics_predictor.moments import weighted_moments


@dataclass(frozen=True, eq=False)
class TrajectoryDistribution:
    """Distribution of the future paths of each object, as weighted samples.

    Several futures (left or right of an edge) stay several: they are in the samples, and no
    question is answered from the mean between them.

    Parameters
    ----------
    object_ids : n_objects names
    times : (n_times,) s after the time the prediction begins at
    positions : (n_samples, n_objects, n_times, 3) m
    weights : (n_samples,), summing to one
    orientations : (n_samples, n_objects, n_times, 4) unit quaternions (x, y, z, w); None when
        they were not asked for
    failed_count : samples that could not be simulated to the end; the arrays are without them
    """

    object_ids: tuple[str, ...]
    times: NDArray[np.float64]
    positions: NDArray[np.float64]
    weights: NDArray[np.float64]
    orientations: NDArray[np.float64] | None = None
    failed_count: int = 0

    def __post_init__(self) -> None:
        expected = (self.weights.size, len(self.object_ids), self.times.size, 3)
        if self.positions.shape != expected:
            raise InvalidInputError(
                f"positions have the shape {self.positions.shape}; expected {expected}"
            )
        turned = (*expected[:-1], 4)
        if self.orientations is not None and self.orientations.shape != turned:
            raise InvalidInputError(
                f"orientations have the shape {self.orientations.shape}; expected {turned}"
            )

    @property
    def mean(self) -> NDArray[np.float64]:
        """Mean position, shape (n_objects, n_times, 3), in m."""
        return self._moments[0]

    @property
    def covariance(self) -> NDArray[np.float64]:
        """Covariance of the position without bias, shape (n_objects, n_times, 3, 3), in m²."""
        return self._moments[1]

    @cached_property
    def _moments(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        return weighted_moments(self.positions, self.weights)

    def index(self, object_id: str) -> int:
        """Position of an object on the axes.

        Raises
        ------
        UnknownNameError
            When it is none of `object_ids`.
        """
        if object_id not in self.object_ids:
            raise UnknownNameError(
                f"object is {object_id!r}; expected one of {', '.join(self.object_ids)}"
            )
        return self.object_ids.index(object_id)

    def parts(self, numbers: int) -> Iterator[TrajectoryDistribution]:
        """Yield the samples in order, in parts of up to `numbers` numbers but at least one sample.

        The weights stay as they are.
        """
        together = max(1, numbers // max(1, self.positions[0].size)) if self.weights.size else 1
        for first in range(0, max(1, self.weights.size), together):
            some = slice(first, first + together)
            turned = None if self.orientations is None else self.orientations[some]
            yield replace(
                self,
                positions=self.positions[some],
                weights=self.weights[some],
                orientations=turned,
            )

    def of(self, object_id: str) -> NDArray[np.float64]:
        """Samples of one object's positions, shape (n_samples, n_times, 3), in m."""
        return self.positions[:, self.index(object_id)]
