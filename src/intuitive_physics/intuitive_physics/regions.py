"""Regions of space, for queries."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.geometry.rotations import rotation_matrix
from intuitive_physics.validation import (
    edge_vector,
    finite_array,
    finite_float,
    positive_float,
    unit_quaternion,
    unit_vector,
)


class Region(ABC):
    """A region of space."""

    @abstractmethod
    def contains(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return whether each point lies inside.

        Parameters
        ----------
        points : (…, 3) m

        Returns
        -------
        array
            (…) of bool
        """


@dataclass(frozen=True, eq=False)
class BallRegion(Region):
    """All points within a distance of one point.

    Parameters
    ----------
    center : (3,) m
    radius : m
    """

    center: NDArray[np.float64]
    radius: float

    def __init__(self, center: ArrayLike, radius: float) -> None:
        object.__setattr__(self, "center", finite_array(center, "region center", (3,)))
        object.__setattr__(self, "radius", positive_float(radius, "region radius"))

    def contains(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        return ((points - self.center) ** 2).sum(axis=-1) <= self.radius**2


@dataclass(frozen=True, eq=False)
class BoxRegion(Region):
    """A box.

    Parameters
    ----------
    center : (3,) m
    orientation : (4,) unit quaternion (x, y, z, w), box to environment
    edge_lengths : (3,) m
    """

    center: NDArray[np.float64]
    orientation: NDArray[np.float64]
    edge_lengths: NDArray[np.float64]

    def __init__(self, center: ArrayLike, orientation: ArrayLike, edge_lengths: ArrayLike) -> None:
        object.__setattr__(self, "center", finite_array(center, "region center", (3,)))
        object.__setattr__(self, "orientation", unit_quaternion(orientation, "region orientation"))
        object.__setattr__(self, "edge_lengths", edge_vector(edge_lengths, "region edge lengths"))

    def contains(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        axes = rotation_matrix(self.orientation)
        inside = np.abs((points - self.center) @ axes) <= 0.5 * self.edge_lengths
        return np.asarray(inside.all(axis=-1))


@dataclass(frozen=True, eq=False)
class HalfSpaceRegion(Region):
    """All points p with normal · p < offset.

    Parameters
    ----------
    normal : (3,) of any length, scaled to one
    offset : m
    """

    normal: NDArray[np.float64]
    offset: float

    def __init__(self, normal: ArrayLike, offset: float) -> None:
        object.__setattr__(self, "normal", unit_vector(normal, "region normal"))
        object.__setattr__(self, "offset", finite_float(offset, "region offset"))

    def contains(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        return np.asarray(points @ self.normal < self.offset)
