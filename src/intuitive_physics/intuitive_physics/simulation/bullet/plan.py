"""One world of a batch, in the terms of PyBullet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import UnsupportedSceneError
from intuitive_physics.scene import Environment
from intuitive_physics.shapes import Box, Capsule, Shape, Sphere
from intuitive_physics.simulation.bullet.surfaces import Surface, surfaces
from intuitive_physics.simulation.world_batch import BOX, SPHERE, WorldBatch


@dataclass(frozen=True)
class Plan:
    """A world's environment and objects with Bullet's coefficients.

    Parameters
    ----------
    static_surfaces : of the planes, then of the static boxes
    masses : kg
    inertias : (3,) kg m² each
    mass_centres : (n_objects, 3) m, in each object's axes, from its shape's centre
    states : (n_objects, 13) as `ObjectState.to_vector`
    """

    environment: Environment
    static_surfaces: list[Surface]
    shapes: list[Shape]
    surfaces: list[Surface]
    masses: list[float]
    inertias: list[NDArray[np.float64]]
    mass_centres: NDArray[np.float64]
    states: NDArray[np.float64]


def plan_world(worlds: WorldBatch, w: int) -> Plan:
    """Plan world w of a batch.

    Raises
    ------
    UnsupportedSceneError
        When Bullet cannot express it.
    """
    environment = worlds.environments[worlds.environment_index[w]]
    count = int(worlds.object_counts[w])
    _check_supported(environment, worlds.has_air_forces[w])
    shapes = [_shape(worlds.shape_kinds[w, i], worlds.dimensions[w, i]) for i in range(count)]
    objects = worlds.object_materials[w, :count]
    static = np.array(
        [worlds.materials.index(p.material) for p in (*environment.planes, *environment.boxes)],
        dtype=np.int64,
    )
    c = int(worlds.parameter_index[w])
    all_surfaces = surfaces(worlds.coefficients[c], objects, static, shapes)
    density = worlds.density[c, objects]
    return Plan(
        environment=environment,
        static_surfaces=all_surfaces[count:],
        shapes=shapes,
        surfaces=all_surfaces[:count],
        masses=[s.mass(rho) for s, rho in zip(shapes, density, strict=True)],
        inertias=[rho * worlds.unit_inertias[w, i] for i, rho in enumerate(density)],
        mass_centres=worlds.mass_centres[w, :count],
        states=worlds.states[w, :count],
    )


def _check_supported(environment: Environment, has_air_forces: NDArray[np.bool_]) -> None:
    for plane in environment.planes:
        if plane.boundary is not None:
            raise UnsupportedSceneError(
                f"plane {plane.id} has a boundary; bullet simulates planes without edges only, "
                "use stepped, leave the boundary out or put a static box in the plane's place"
            )
    if has_air_forces.any():
        i = int(np.flatnonzero(has_air_forces)[0])
        raise UnsupportedSceneError(
            f"object {i} of the scene has air drag or Magnus force; bullet simulates neither, "
            "use stepped or set both coefficients to zero"
        )


def _shape(kind: int, dimensions: NDArray[np.float64]) -> Shape:
    if kind == SPHERE:
        return Sphere(dimensions[0])
    if kind == BOX:
        return Box((dimensions[0], dimensions[1], dimensions[2]))
    return Capsule(dimensions[0], dimensions[1])
