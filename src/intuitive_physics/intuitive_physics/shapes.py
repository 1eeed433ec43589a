"""Object primitives Ω_o (Sec. III): sphere, box and capsule of uniform density."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from math import pi
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.errors import InvalidInputError, UnknownNameError
from intuitive_physics.validation import finite_array, plain_data, positive_float


class Shape(ABC):
    """A convex solid centred on its own origin, its axes those of its frame."""

    kind: ClassVar[str]

    @property
    @abstractmethod
    def volume(self) -> float:
        """Volume in m³."""

    @property
    @abstractmethod
    def surface(self) -> float:
        """Surface in m²; a convex body's mean silhouette is a quarter of it (Cauchy)."""

    @property
    @abstractmethod
    def bounding_radius(self) -> float:
        """Radius in m of the smallest sphere about the origin that holds the shape."""

    @abstractmethod
    def unit_density_inertia(self) -> NDArray[np.float64]:
        """Return the principal moments of inertia at 1 kg/m³, (3,) kg m², in the body frame."""

    @abstractmethod
    def contains(self, point: ArrayLike) -> bool:
        """Return whether a point lies inside or on the surface.

        Parameters
        ----------
        point : (3,) m, in the body frame
        """

    def to_dict(self) -> dict[str, Any]:
        """Return plain data that `shape_from_dict` reads."""
        return {"kind": self.kind, **plain_data(self)}

    def mass(self, density: float) -> float:
        """Mass in kg at a uniform density in kg/m³ (Sec. III-A: M = ρ v)."""
        return positive_float(density, "density") * self.volume

    def inertia(self, density: float) -> NDArray[np.float64]:
        """Return the principal moments of inertia at `density` (kg/m³), (3,) kg m²."""
        return positive_float(density, "density") * self.unit_density_inertia()


@dataclass(frozen=True)
class Sphere(Shape):
    """A solid sphere.

    Parameters
    ----------
    radius : m
    """

    radius: float
    kind: ClassVar[str] = "sphere"

    def __post_init__(self) -> None:
        object.__setattr__(self, "radius", positive_float(self.radius, "sphere radius"))

    @property
    def volume(self) -> float:
        return 4.0 / 3.0 * pi * self.radius**3

    @property
    def surface(self) -> float:
        return 4.0 * pi * self.radius**2

    @property
    def bounding_radius(self) -> float:
        return self.radius

    def unit_density_inertia(self) -> NDArray[np.float64]:
        return np.full(3, 0.4 * self.volume * self.radius**2)

    def contains(self, point: ArrayLike) -> bool:
        return bool(np.linalg.norm(point) <= self.radius)


@dataclass(frozen=True)
class Box(Shape):
    """A rectangular prism.

    Parameters
    ----------
    edge_lengths : whole edge lengths along the body's x, y, z, in m
    """

    edge_lengths: tuple[float, float, float]
    kind: ClassVar[str] = "box"

    def __post_init__(self) -> None:
        edges = finite_array(self.edge_lengths, "box edge lengths", (3,))
        x, y, z = (positive_float(edge, "box edge length") for edge in edges)
        object.__setattr__(self, "edge_lengths", (x, y, z))

    @property
    def volume(self) -> float:
        x, y, z = self.edge_lengths
        return x * y * z

    @property
    def surface(self) -> float:
        x, y, z = self.edge_lengths
        return 2.0 * (x * y + y * z + z * x)

    @property
    def bounding_radius(self) -> float:
        return 0.5 * float(np.linalg.norm(self.edge_lengths))

    def unit_density_inertia(self) -> NDArray[np.float64]:
        squares = np.square(self.edge_lengths)
        return self.volume / 12.0 * (squares.sum() - squares)

    def contains(self, point: ArrayLike) -> bool:
        return bool(np.all(np.abs(point) <= 0.5 * np.array(self.edge_lengths)))


@dataclass(frozen=True)
class Capsule(Shape):
    """A cylinder along the body's z axis, capped by two half spheres.

    Parameters
    ----------
    radius : of the cylinder and of both caps, in m
    length : of the cylinder without its caps, in m
    """

    radius: float
    length: float
    kind: ClassVar[str] = "capsule"

    def __post_init__(self) -> None:
        object.__setattr__(self, "radius", positive_float(self.radius, "capsule radius"))
        object.__setattr__(self, "length", positive_float(self.length, "capsule length"))

    @property
    def volume(self) -> float:
        return pi * self.radius**2 * (self.length + 4.0 / 3.0 * self.radius)

    @property
    def surface(self) -> float:
        return 2.0 * pi * self.radius * (self.length + 2.0 * self.radius)

    @property
    def bounding_radius(self) -> float:
        return self.radius + 0.5 * self.length

    def unit_density_inertia(self) -> NDArray[np.float64]:
        r, h = self.radius, self.length
        cylinder = pi * r**2 * h
        caps = 4.0 / 3.0 * pi * r**3
        axial = cylinder * r**2 / 2.0 + caps * 0.4 * r**2
        # A half sphere's centroid lies 3r/8 from its flat face; 83/320 m r² about the centroid.
        to_centroid = 0.5 * h + 0.375 * r
        transverse = cylinder * (r**2 / 4.0 + h**2 / 12.0) + caps * (
            83.0 / 320.0 * r**2 + to_centroid**2
        )
        return np.array([transverse, transverse, axial])

    def contains(self, point: ArrayLike) -> bool:
        x, y, z = np.asarray(point, dtype=float).tolist()
        beyond = max(abs(z) - 0.5 * self.length, 0.0)
        return x * x + y * y + beyond * beyond <= self.radius**2


SHAPE_KINDS: dict[str, type[Shape]] = {kind.kind: kind for kind in (Sphere, Box, Capsule)}
"""Classes of shapes by the names they have in files."""


def shape_from_dict(data: Mapping[str, Any]) -> Shape:
    """Read what `Shape.to_dict` wrote.

    Raises
    ------
    UnknownNameError
        When the kind is none of sphere, box, capsule.
    InvalidInputError
        When a dimension is missing, superfluous or not positive.
    """
    arguments = dict(data)
    kind = arguments.pop("kind", None)
    if kind not in SHAPE_KINDS:
        raise UnknownNameError(f"shape kind is {kind!r}; expected one of {', '.join(SHAPE_KINDS)}")
    try:
        return SHAPE_KINDS[kind](**arguments)
    except TypeError as error:
        raise InvalidInputError(
            f"{kind} has the fields {sorted(arguments)}; expected its dimensions ({error})"
        ) from None
