"""Scenes, the input of a simulator: environment Ω_e, objects Ω_o, their initial states θ_d."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.limits import check_limit
from intuitive_physics.shapes import Shape, Sphere, shape_from_dict
from intuitive_physics.state import ObjectState
from intuitive_physics.validation import (
    edge_vector,
    finite_array,
    finite_float,
    name_string,
    non_negative_float,
    plain_data,
    positive_float,
    unit_quaternion,
    unit_vector,
)

STANDARD_GRAVITY = (0.0, 0.0, -9.81)
"""m/s², in a frame whose z axis points up."""

STANDARD_AIR_DENSITY = 1.2
"""kg/m³, of dry air at sea level and 20 °C."""

THIN_SHELL = 5.0 / 3.0
"""Moment of inertia of a thin spherical shell, 2/3 m r², over that of a solid sphere, 2/5 m r²."""


@dataclass(frozen=True, eq=False)
class Plane:
    """A static plane; objects live on the side its normal points to.

    Parameters
    ----------
    id : unique in its environment
    material : name
    normal : (3,) of any length, scaled to one
    offset : m; points p of the plane satisfy normal · p = offset
    boundary : (n, 3) m, corners of a convex polygon in the plane, counter-clockwise seen against
        the normal; None means the plane has no edge
    """

    id: str
    material: str
    normal: NDArray[np.float64]
    offset: float
    boundary: NDArray[np.float64] | None = None

    def __init__(
        self,
        id: str,
        material: str,
        normal: ArrayLike,
        offset: float,
        boundary: ArrayLike | None = None,
    ) -> None:
        object.__setattr__(self, "id", name_string(id, "plane id"))
        object.__setattr__(self, "material", name_string(material, "plane material"))
        object.__setattr__(self, "normal", unit_vector(normal, f"normal of plane {id}"))
        object.__setattr__(self, "offset", finite_float(offset, f"offset of plane {id}"))
        corners = None
        if boundary is not None:
            corners = finite_array(boundary, f"boundary of plane {id}", (None, 3))
            if len(corners) < 3:
                raise InvalidInputError(
                    f"boundary of plane {id} has {len(corners)} corners; expected at least 3"
                )
        object.__setattr__(self, "boundary", corners)

    def signed_distances(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return distances from the infinite plane, positive on the normal's side.

        Parameters
        ----------
        points : (..., 3) m

        Returns
        -------
        array
            (...) m
        """
        return np.asarray(points, dtype=np.float64) @ self.normal - self.offset

    def covers(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Return whether points, projected onto the plane, lie within its boundary.

        Every point does where the plane has no edge.

        Parameters
        ----------
        points : (..., 3) m

        Returns
        -------
        array
            (...) of bool
        """
        places = np.asarray(points, dtype=np.float64)
        if self.boundary is None:
            return np.ones(places.shape[:-1], dtype=bool)
        sides = np.roll(self.boundary, -1, axis=0) - self.boundary
        outward = np.cross(sides, self.normal)
        bounds = (outward * self.boundary).sum(axis=1)
        return np.asarray((places @ outward.T <= bounds).all(axis=-1))

    def to_dict(self) -> dict[str, Any]:
        """Return plain data that `Environment.from_dict` reads."""
        return plain_data(self)


@dataclass(frozen=True, eq=False)
class StaticBox:
    """A box that never moves.

    Parameters
    ----------
    id : unique in its environment
    material : name
    center : (3,) m
    orientation : (4,) unit quaternion (x, y, z, w), box to environment
    edge_lengths : (3,) m
    """

    id: str
    material: str
    center: NDArray[np.float64]
    orientation: NDArray[np.float64]
    edge_lengths: NDArray[np.float64]

    def __init__(
        self,
        id: str,
        material: str,
        center: ArrayLike,
        orientation: ArrayLike,
        edge_lengths: ArrayLike,
    ) -> None:
        object.__setattr__(self, "id", name_string(id, "box id"))
        object.__setattr__(self, "material", name_string(material, "box material"))
        object.__setattr__(self, "center", finite_array(center, f"center of box {id}", (3,)))
        object.__setattr__(
            self, "orientation", unit_quaternion(orientation, f"orientation of box {id}")
        )
        edges = edge_vector(edge_lengths, f"edge lengths of box {id}")
        object.__setattr__(self, "edge_lengths", edges)

    def to_dict(self) -> dict[str, Any]:
        """Return plain data that `Environment.from_dict` reads."""
        return plain_data(self)


@dataclass(frozen=True, eq=False)
class Environment:
    """Ω_e: static planes and boxes, and gravity, in one fixed frame.

    Parameters
    ----------
    planes : ordered by importance; a perceived environment has its supporting plane first
    boxes : static boxes
    gravity : (3,) m/s²
    frame_id : name of the frame everything is in
    air_density : kg/m³, used for objects with drag or Magnus force
    """

    planes: tuple[Plane, ...]
    boxes: tuple[StaticBox, ...]
    gravity: NDArray[np.float64]
    frame_id: str
    air_density: float

    def __init__(
        self,
        planes: Sequence[Plane] = (),
        boxes: Sequence[StaticBox] = (),
        gravity: ArrayLike = STANDARD_GRAVITY,
        frame_id: str = "world",
        air_density: float = STANDARD_AIR_DENSITY,
    ) -> None:
        primitives: list[Plane | StaticBox] = [*planes, *boxes]
        ids = [primitive.id for primitive in primitives]
        if len(set(ids)) != len(ids):
            raise InvalidInputError(f"environment has the ids {ids}; expected each once")
        object.__setattr__(self, "planes", tuple(planes))
        object.__setattr__(self, "boxes", tuple(boxes))
        object.__setattr__(self, "gravity", finite_array(gravity, "gravity", (3,)))
        object.__setattr__(self, "frame_id", frame_id)
        object.__setattr__(self, "air_density", non_negative_float(air_density, "air density"))

    @property
    def materials(self) -> tuple[str, ...]:
        """Materials of all primitives, each once, in order of appearance."""
        primitives: list[Plane | StaticBox] = [*self.planes, *self.boxes]
        return tuple(dict.fromkeys(primitive.material for primitive in primitives))

    def to_dict(self) -> dict[str, Any]:
        """Return plain data that `from_dict` reads."""
        return plain_data(self)

    @staticmethod
    def from_dict(data: Mapping[str, Any]) -> Environment:
        """Read what `to_dict` wrote."""
        try:
            parts = len(data["planes"]) + len(data["boxes"])
            check_limit("most_primitives", parts, "planes and boxes")
            return Environment(
                [Plane(**plane) for plane in data["planes"]],
                [StaticBox(**box) for box in data["boxes"]],
                data["gravity"],
                data["frame_id"],
                data.get("air_density", STANDARD_AIR_DENSITY),
            )
        except (KeyError, TypeError) as error:
            raise InvalidInputError(
                f"environment cannot be read ({error}); expected planes, boxes, gravity, frame_id"
            ) from None


@dataclass(frozen=True)
class SceneObject:
    """One element of Ω_o: an object without its state.

    Parameters
    ----------
    id : unique in its scene
    material : name
    shape : its primitive
    drag_coefficient : C_d in the drag force -½ ρ C_d A |v| v, A the shape's mean silhouette
    magnus_coefficient : C_M in the Magnus force ½ ρ A r C_M ω × v, with A = π r²
    inertia_factor : moments of inertia over those of a uniform solid of the same mass, above zero:
        1.2 for a cube with walls, for example; at most 5/3 for a sphere, that of a thin shell
    mass_centre : (3,) m, centre of mass of a box or capsule in its own axes, from the shape's
        centre, inside the shape. Pose and velocity in a state are those of the shape's centre
    """

    id: str
    material: str
    shape: Shape
    drag_coefficient: float = 0.0
    magnus_coefficient: float = 0.0
    inertia_factor: float = 1.0
    mass_centre: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        name_string(self.id, "object id")
        name_string(self.material, f"material of object {self.id}")
        if not isinstance(self.shape, Shape):
            raise InvalidInputError(
                f"shape of object {self.id} is {self.shape!r}; expected a Sphere, Box or Capsule"
            )
        for name in ("drag_coefficient", "magnus_coefficient"):
            words = f"{name.replace('_', ' ')} of object {self.id}"
            object.__setattr__(self, name, non_negative_float(getattr(self, name), words))
        factor = positive_float(self.inertia_factor, f"inertia factor of object {self.id}")
        if factor > THIN_SHELL and isinstance(self.shape, Sphere):
            raise InvalidInputError(
                f"inertia factor of object {self.id} is {factor:g}; expected at most 5/3 for a "
                "sphere, that of a thin shell"
            )
        object.__setattr__(self, "inertia_factor", factor)
        object.__setattr__(self, "mass_centre", self._checked_mass_centre())

    @property
    def has_air_forces(self) -> bool:
        """Whether the air acts on it: drag or Magnus force."""
        return self.drag_coefficient > 0.0 or self.magnus_coefficient > 0.0

    def _checked_mass_centre(self) -> tuple[float, float, float]:
        words = f"centre of mass of object {self.id}"
        x, y, z = finite_array(self.mass_centre, words, (3,)).tolist()
        if (x, y, z) == (0.0, 0.0, 0.0):
            return x, y, z
        if isinstance(self.shape, Sphere):
            raise InvalidInputError(f"{words} is {[x, y, z]} m; expected 0 for a sphere")
        if not self.shape.contains((x, y, z)):
            raise InvalidInputError(f"{words} is {[x, y, z]} m; expected it inside {self.shape}")
        return x, y, z

    def to_dict(self) -> dict[str, Any]:
        """Return plain data that `from_dict` reads."""
        return plain_data(self)

    @staticmethod
    def from_dict(data: Mapping[str, Any]) -> SceneObject:
        """Read what `to_dict` wrote."""
        try:
            return SceneObject(
                data["id"],
                data["material"],
                shape_from_dict(data["shape"]),
                data.get("drag_coefficient", 0.0),
                data.get("magnus_coefficient", 0.0),
                data.get("inertia_factor", 1.0),
                data.get("mass_centre", (0.0, 0.0, 0.0)),
            )
        except (KeyError, TypeError) as error:
            raise InvalidInputError(
                f"object cannot be read ({error}); expected id, material, shape"
            ) from None


@dataclass(frozen=True)
class Scene:
    """One world to simulate: environment, objects, and the initial state of each.

    Parameters
    ----------
    environment : Ω_e
    objects : Ω_o, at least one
    states : θ_d of each object, in the same order
    """

    environment: Environment
    objects: tuple[SceneObject, ...]
    states: tuple[ObjectState, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "objects", tuple(self.objects))
        object.__setattr__(self, "states", tuple(self.states))
        if not self.objects:
            raise InvalidInputError("scene has no objects; expected at least one")
        if len(self.objects) != len(self.states):
            raise InvalidInputError(
                f"scene has {len(self.objects)} objects and {len(self.states)} states; "
                "expected one state for each object"
            )
        ids = [item.id for item in self.objects]
        if len(set(ids)) != len(ids):
            raise InvalidInputError(f"scene has the object ids {ids}; expected each once")

    @property
    def materials(self) -> tuple[str, ...]:
        """Materials of objects, then of the environment, each once."""
        own = tuple(item.material for item in self.objects)
        return tuple(dict.fromkeys(own + self.environment.materials))
