"""Many worlds as flat arrays, as the engines' kernels want them."""

from __future__ import annotations

import math
from collections import namedtuple
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from operator import attrgetter
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.materials import StaticParameters
from intuitive_physics.scene import Environment, Scene, SceneObject
from intuitive_physics.shapes import Box, Capsule, Shape, Sphere
from intuitive_physics.simulation.contact_noise import ContactNoise
from intuitive_physics.validation import finite_array

SPHERE, BOX, CAPSULE = range(3)
"""Codes in `WorldBatch.shape_kinds`."""

PER_WORLD = {"per_world": True}
"""Metadata of the fields of `WorldBatch` that have a row for each world."""


@dataclass(frozen=True, eq=False)
class WorldBatch:
    """W worlds of up to O objects among E environments of up to P planes and B boxes, C times θ_s.

    Parameters
    ----------
    materials : names behind the material codes
    object_counts : (W,) objects in each world; the rest of axis O is padding
    shape_kinds : (W, O) SPHERE, BOX or CAPSULE
    dimensions : (W, O, 3) m: (radius, 0, 0), edge lengths, or (radius, length, 0)
    volumes : (W, O) m³
    unit_inertias : (W, O, 3) kg m² at 1 kg/m³, inertia factor included
    inertia_ratios : (W, O) κ = I / (m r²) about the axis that an object rolls about: 2/5 for a
        solid sphere, 2/3 for a thin shell; infinite for a box, which has none
    object_materials : (W, O) codes
    states : (W, O, 13) as `ObjectState.to_vector`
    air_factors : (W, O, 2) ½ ρ C_d A (kg/m) and ½ ρ C_M A r (kg) of drag and Magnus force
    mass_centres : (W, O, 3) m, centre of mass in the object's axes, from the shape's centre
    noise_keys : (W,) what each world's noise at impacts is drawn from
    environment_index : (W,) row of each world in the environment arrays
    gravity : (E, 3) m/s²
    plane_counts : (E,)
    planes : (E, P, 4) unit normal and offset
    plane_materials : (E, P) codes
    corner_counts : (E, P) corners of each plane's boundary, 0 where it has no edge
    corners : (E, P, K, 3) m, counter-clockwise seen against the normal
    box_counts : (E,)
    boxes : (E, B, 10) centre (m), orientation (x, y, z, w) and edge lengths (m)
    box_materials : (E, B) codes
    parameter_index : (W,) row of each world in the parameter arrays
    density : (C, m) kg/m³
    coefficients : (C, 4, m, m) as `StaticParameters.coefficients`
    contact_noise : (2,) standard deviations of `ContactNoise`: restitution, tilt (rad)
    environments : the E environments themselves, for engines that need more of them
    """

    materials: tuple[str, ...]
    object_counts: NDArray[np.int64] = field(metadata=PER_WORLD)
    shape_kinds: NDArray[np.int64] = field(metadata=PER_WORLD)
    dimensions: NDArray[np.float64] = field(metadata=PER_WORLD)
    volumes: NDArray[np.float64] = field(metadata=PER_WORLD)
    unit_inertias: NDArray[np.float64] = field(metadata=PER_WORLD)
    inertia_ratios: NDArray[np.float64] = field(metadata=PER_WORLD)
    object_materials: NDArray[np.int64] = field(metadata=PER_WORLD)
    states: NDArray[np.float64] = field(metadata=PER_WORLD)
    air_factors: NDArray[np.float64] = field(metadata=PER_WORLD)
    mass_centres: NDArray[np.float64] = field(metadata=PER_WORLD)
    noise_keys: NDArray[np.uint64] = field(metadata=PER_WORLD)
    environment_index: NDArray[np.int64] = field(metadata=PER_WORLD)
    gravity: NDArray[np.float64]
    plane_counts: NDArray[np.int64]
    planes: NDArray[np.float64]
    plane_materials: NDArray[np.int64]
    corner_counts: NDArray[np.int64]
    corners: NDArray[np.float64]
    box_counts: NDArray[np.int64]
    boxes: NDArray[np.float64]
    box_materials: NDArray[np.int64]
    parameter_index: NDArray[np.int64] = field(metadata=PER_WORLD)
    density: NDArray[np.float64]
    coefficients: NDArray[np.float64]
    contact_noise: NDArray[np.float64]
    environments: tuple[Environment, ...]

    @property
    def size(self) -> int:
        """Number of worlds W."""
        return int(self.object_counts.size)

    @property
    def has_air_forces(self) -> NDArray[np.bool_]:
        """Whether the air acts on each object, (W, O); never on padding."""
        return np.asarray(self.air_factors.any(axis=2))

    @property
    def arrays(self) -> tuple[NDArray, ...]:
        """All arrays (W, …) in order: what a kernel takes, and makes `WorldArrays` of.

        Numba recognises the type of a plain tuple at once, and that of a named one only slowly.
        """
        arrays: tuple[NDArray, ...] = _arrays_of(self)
        return arrays

    def crossed(self, parameter_sets: Sequence[StaticParameters]) -> WorldBatch:
        """Return every world under every θ_s: world `c * W + w` is world w under set c."""
        density, coefficients = _parameter_tables(parameter_sets, self.materials)
        sets = len(parameter_sets)
        return replace(
            self.taken(np.tile(np.arange(self.size), sets)),
            parameter_index=np.repeat(np.arange(sets), self.size),
            density=density,
            coefficients=coefficients,
        )

    def with_contact_noise(self, noise: ContactNoise, rng: np.random.Generator) -> WorldBatch:
        """Return the worlds with noisy impacts, each with a key of its own drawn from `rng`."""
        return replace(
            self,
            noise_keys=rng.integers(2**64, size=self.size, dtype=np.uint64),
            contact_noise=np.array([noise.restitution, noise.tilt]),
        )

    def repeated(
        self, states: ArrayLike, parameter_sets: Sequence[StaticParameters] | None = None
    ) -> WorldBatch:
        """Return copies of a batch of one world that start from other states.

        Parameters
        ----------
        states : (n, O, 13), the initial states of each copy
        parameter_sets : n times θ_s, one for each copy; None keeps that of the one world
        """
        if self.size != 1:
            raise InvalidInputError(f"batch has {self.size} worlds; expected one to repeat")
        starts = finite_array(states, "states", (None, self.states.shape[1], 13))
        n = len(starts)
        copies = self.taken(np.zeros(n, dtype=np.int64), states=starts)
        if parameter_sets is None:
            return copies
        if len(parameter_sets) != n:
            raise InvalidInputError(f"{len(parameter_sets)} times θ_s for {n} copies; expected {n}")
        density, coefficients = _parameter_tables(parameter_sets, self.materials)
        return replace(
            copies,
            parameter_index=np.arange(n, dtype=np.int64),
            density=density,
            coefficients=coefficients,
        )

    def taken(self, worlds: NDArray[np.int64], **changes: Any) -> WorldBatch:
        """Return the worlds of these indices, as often and in the order they are named.

        Parameters
        ----------
        worlds : (n,) indices
        changes : arrays of the worlds returned that take the place of these worlds' own
        """
        per_world = [one.name for one in fields(self) if one.metadata == PER_WORLD]
        own: dict[str, Any] = {
            name: getattr(self, name)[worlds] for name in per_world if name not in changes
        }
        # Kernels are compiled for whole arrays, not for views that leave something out.
        whole: dict[str, Any] = {
            name: np.ascontiguousarray(changed) for name, changed in changes.items()
        }
        return replace(self, **own, **whole)


WorldArrays = namedtuple(  # type: ignore[misc]
    "WorldArrays", [one.name for one in fields(WorldBatch) if str(one.type).startswith("NDArray")]
)
"""The arrays of a `WorldBatch` as one record for kernels: `WorldArrays(*batch.arrays)`."""

_arrays_of = attrgetter(*WorldArrays._fields)  # type: ignore[call-overload]


def pack_worlds(
    scenes: Sequence[Scene],
    static_parameters: StaticParameters | Sequence[StaticParameters],
) -> WorldBatch:
    """Pack scenes, each with its θ_s or all with the same.

    Raises
    ------
    InvalidInputError
        When there is no scene or the numbers of scenes and θ_s differ.
    UnknownNameError
        When a scene has a material that its θ_s does not know.
    """
    if len(scenes) == 0:
        raise InvalidInputError("batch has no scenes; expected at least one")
    if isinstance(static_parameters, StaticParameters):
        parameter_sets, parameter_index = [static_parameters], np.zeros(len(scenes), dtype=np.int64)
    else:
        parameter_sets = list(static_parameters)
        parameter_index = np.arange(len(scenes), dtype=np.int64)
        if len(parameter_sets) != len(scenes):
            raise InvalidInputError(
                f"{len(parameter_sets)} times θ_s for {len(scenes)} scenes; expected one for each"
            )
    materials = parameter_sets[0].materials
    density, coefficients = _parameter_tables(parameter_sets, materials)
    environments = list({id(scene.environment): scene.environment for scene in scenes}.values())
    row = {id(environment): i for i, environment in enumerate(environments)}
    return WorldBatch(
        materials=materials,
        **_object_arrays(scenes, parameter_sets[0]),
        noise_keys=np.zeros(len(scenes), dtype=np.uint64),
        environment_index=np.array([row[id(scene.environment)] for scene in scenes]),
        **_environment_arrays(environments, parameter_sets[0]),
        parameter_index=parameter_index,
        density=density,
        coefficients=coefficients,
        contact_noise=np.zeros(2),
        environments=tuple(environments),
    )


def _object_arrays(scenes: Sequence[Scene], parameters: StaticParameters) -> dict[str, NDArray]:
    counts = np.array([len(scene.objects) for scene in scenes], dtype=np.int64)
    padded = (len(scenes), int(counts.max()))
    kinds = np.zeros(padded, dtype=np.int64)
    dimensions = np.ones((*padded, 3))
    volumes = np.ones(padded)
    inertias = np.ones((*padded, 3))
    inertia_ratios = np.ones(padded)
    materials = np.zeros(padded, dtype=np.int64)
    states = np.zeros((*padded, 13))
    states[..., 6] = 1.0
    air = np.zeros((*padded, 2))
    mass_centres = np.zeros((*padded, 3))
    for w, scene in enumerate(scenes):
        for i, (scene_object, state) in enumerate(zip(scene.objects, scene.states, strict=True)):
            kinds[w, i], dimensions[w, i] = _shape_numbers(scene_object.shape)
            volumes[w, i] = scene_object.shape.volume
            inertias[w, i] = scene_object.inertia_factor * scene_object.shape.unit_density_inertia()
            inertia_ratios[w, i] = _inertia_ratio(scene_object)
            materials[w, i] = parameters.index(scene_object.material)
            states[w, i] = state.to_vector()
            air[w, i] = _air_factors(scene_object, scene.environment.air_density)
            mass_centres[w, i] = scene_object.mass_centre
    return {
        "object_counts": counts,
        "shape_kinds": kinds,
        "dimensions": dimensions,
        "volumes": volumes,
        "unit_inertias": inertias,
        "inertia_ratios": inertia_ratios,
        "object_materials": materials,
        "states": states,
        "air_factors": air,
        "mass_centres": mass_centres,
    }


def _shape_numbers(shape: Shape) -> tuple[int, tuple[float, float, float]]:
    match shape:
        case Sphere():
            return SPHERE, (shape.radius, 0.0, 0.0)
        case Box():
            return BOX, shape.edge_lengths
        case Capsule():
            return CAPSULE, (shape.radius, shape.length, 0.0)
    raise InvalidInputError(f"shape is {shape!r}; expected a Sphere, Box or Capsule")


def _inertia_ratio(scene_object: SceneObject) -> float:
    shape = scene_object.shape
    if not isinstance(shape, Sphere | Capsule):
        return math.inf
    about_axis = scene_object.inertia_factor * shape.unit_density_inertia()[2]
    return float(about_axis / (shape.volume * shape.radius**2))


def _air_factors(scene_object: SceneObject, air_density: float) -> tuple[float, float]:
    silhouette = 0.25 * scene_object.shape.surface
    drag = 0.5 * air_density * silhouette
    return (
        drag * scene_object.drag_coefficient,
        drag * scene_object.magnus_coefficient * math.sqrt(silhouette / math.pi),
    )


def _environment_arrays(
    environments: Sequence[Environment], parameters: StaticParameters
) -> dict[str, NDArray]:
    counts = np.array([len(e.planes) for e in environments], dtype=np.int64)
    padded = (len(environments), max(1, int(counts.max())))
    planes = np.zeros((*padded, 4))
    materials = np.zeros(padded, dtype=np.int64)
    for row, environment in enumerate(environments):
        for p, plane in enumerate(environment.planes):
            planes[row, p] = (*plane.normal, plane.offset)
            materials[row, p] = parameters.index(plane.material)
    corner_counts, corners = _boundary_arrays(environments, padded)
    return {
        "gravity": np.array([e.gravity for e in environments]),
        "plane_counts": counts,
        "planes": planes,
        "plane_materials": materials,
        "corner_counts": corner_counts,
        "corners": corners,
        **_box_arrays(environments, parameters),
    }


def _boundary_arrays(
    environments: Sequence[Environment], padded: tuple[int, int]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    boundaries = {
        (row, p): plane.boundary
        for row, environment in enumerate(environments)
        for p, plane in enumerate(environment.planes)
        if plane.boundary is not None
    }
    most = max((len(boundary) for boundary in boundaries.values()), default=0)
    counts = np.zeros(padded, dtype=np.int64)
    corners = np.zeros((*padded, most, 3))
    for place, boundary in boundaries.items():
        counts[place] = len(boundary)
        corners[place][: len(boundary)] = boundary
    return counts, corners


def _box_arrays(
    environments: Sequence[Environment], parameters: StaticParameters
) -> dict[str, NDArray]:
    counts = np.array([len(e.boxes) for e in environments], dtype=np.int64)
    padded = (len(environments), int(counts.max()))
    boxes = np.zeros((*padded, 10))
    materials = np.zeros(padded, dtype=np.int64)
    for row, environment in enumerate(environments):
        for b, box in enumerate(environment.boxes):
            boxes[row, b] = (*box.center, *box.orientation, *box.edge_lengths)
            materials[row, b] = parameters.index(box.material)
    return {"box_counts": counts, "boxes": boxes, "box_materials": materials}


def _parameter_tables(
    parameter_sets: Sequence[StaticParameters], materials: tuple[str, ...]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    if len(parameter_sets) == 0:
        raise InvalidInputError("there is no θ_s; expected at least one")
    for parameters in parameter_sets:
        if parameters.materials != materials:
            raise InvalidInputError(
                f"θ_s has the materials {list(parameters.materials)}; "
                f"expected {list(materials)} as in the others"
            )
    return (
        np.array([parameters.density for parameters in parameter_sets]),
        np.array([parameters.coefficients for parameters in parameter_sets]),
    )
