"""Distributions of trajectories: weighted samples, and the moments they have."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError, UnknownNameError


@dataclass(frozen=True, eq=False)
class TrajectoryDistribution:
    """Where each object will be.

    Several futures (left or right of an edge) stay several: they are in the samples, and no
    question is answered from the mean between them.

    Parameters
    ----------
    object_ids : n_objects names
    times : (n_times,) s after the states it was predicted from
    positions : (n_samples, n_objects, n_times, 3) m
    weights : (n_samples,), summing to one
    """

    object_ids: tuple[str, ...]
    times: NDArray[np.float64]
    positions: NDArray[np.float64]
    weights: NDArray[np.float64]

    def __post_init__(self) -> None:
        expected = (self.weights.size, len(self.object_ids), self.times.size, 3)
        if self.positions.shape != expected:
            raise InvalidInputError(
                f"positions have the shape {self.positions.shape}; expected {expected}"
            )

    @cached_property
    def mean(self) -> NDArray[np.float64]:
        """Mean position, shape (n_objects, n_times, 3), in m."""
        return np.tensordot(self.weights, self.positions, axes=1)

    @cached_property
    def covariance(self) -> NDArray[np.float64]:
        """Covariance of the position, shape (n_objects, n_times, 3, 3), in m²."""
        deviations = self.positions - self.mean
        weighted = deviations * self.weights[:, None, None, None]
        covariance = np.empty((*self.mean.shape, 3))
        for i in range(3):
            for j in range(i, 3):
                shared = np.einsum("sot,sot->ot", weighted[..., i], deviations[..., j])
                covariance[..., i, j] = covariance[..., j, i] = shared
        return covariance

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

    def of(self, object_id: str) -> NDArray[np.float64]:
        """Samples of one object's positions, shape (n_samples, n_times, 3), in m."""
        return self.positions[:, self.index(object_id)]
