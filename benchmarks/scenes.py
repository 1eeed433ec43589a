"""Scenes to simulate: objects thrown through the paper's room, and single balls for known laws."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.materials import StaticParameters
from intuitive_physics.scene import Environment, Plane, Scene, SceneObject
from intuitive_physics.shapes import Box, Capsule, Shape, Sphere
from intuitive_physics.state import ObjectState

HALF_ROOM = 5.0  # m from the middle of the room to each wall
DENSITY = 500.0  # kg/m³ of all objects
# Of a prediction: simulations, steps of each, and s of a step
SIMULATIONS, STEPS, TIME_STEP = 20, 500, 0.01
# m and m/s, standard deviations of the noise on an initial state
POSITION_NOISE, VELOCITY_NOISE = 0.01, 0.1
# m between an object and the floor at the start, at least; twice that between two objects
CLEARANCE = 0.05
SCENES: dict[str, tuple[str, ...]] = {
    "1_sphere": ("sphere",),
    "3_spheres": ("sphere",) * 3,
    "1_box": ("box",),
    "3_mixed": ("sphere", "box", "capsule"),
}
"""The four scenes of issue 3, by what is thrown."""
MIXED = ("sphere", "box", "capsule")  # kinds of objects that take turns
CROWDS: dict[str, tuple[str, ...]] = {"20_mixed": tuple(MIXED[i % 3] for i in range(20))}
"""Scenes of many objects, of which fewer instances are measured."""


@dataclass(frozen=True)
class Surface:
    """Coefficients that all pairs of bodies of an instance have.

    PyBullet has coefficients of bodies, so only what all pairs share is the same for all peers.
    The rolling torque is at most rolling_arm (m) times the normal force.
    """

    static_friction: float = 0.5
    dynamic_friction: float = 0.4
    restitution: float = 0.5
    rolling_arm: float = 0.005


@dataclass(frozen=True, eq=False)
class Instance:
    """One scene, the coefficients of all pairs, and the states its simulations start from.

    Each object has a material of its own, so that each gets its own μ_r. The starts are
    (n_simulations, n_objects, 13) as `ObjectState.to_vector`.
    """

    scene: Scene
    surface: Surface
    starts: NDArray[np.float64]

    @property
    def shapes(self) -> list[Shape]:
        """Shapes of the objects."""
        return [item.shape for item in self.scene.objects]

    @property
    def static_parameters(self) -> StaticParameters:
        """θ_s with μ_r = rolling_arm / rolling radius, the mean of both where objects meet."""
        materials = self.scene.materials
        surface = self.surface
        same = StaticParameters.uniform(
            materials,
            density=DENSITY,
            static_friction=surface.static_friction,
            dynamic_friction=surface.dynamic_friction,
            restitution=surface.restitution,
        )
        radii = np.array([rolling_radius(shape) for shape in self.shapes])
        count = len(radii)
        inverse = np.zeros((len(materials), len(materials)))
        inverse[:count] = 1.0 / radii[:, None]
        inverse[:, :count] = inverse[:count].T
        inverse[:count, :count] = 2.0 / (radii[:, None] + radii)
        coefficients = same.coefficients.copy()
        coefficients[2] = surface.rolling_arm * inverse
        return StaticParameters(materials, same.density, coefficients)

    def repeated(self, simulations: int, rng: np.random.Generator) -> Instance:
        """Return the same scene with other noisy starts."""
        return Instance(self.scene, self.surface, noisy_starts(self.scene, simulations, rng))


def rolling_radius(shape: Shape) -> float:
    """Radius in m that turns μ_r into an arm; a box does not roll, it gets its inner radius."""
    match shape:
        case Sphere() | Capsule():
            return shape.radius
        case Box():
            return min(shape.edge_lengths) / 2
    raise TypeError(f"shape is {shape!r}; expected a Sphere, Box or Capsule")


def thrown(
    kinds: Sequence[str],
    rng: np.random.Generator,
    simulations: int = SIMULATIONS,
    half_room: float = HALF_ROOM,
) -> Instance:
    """Return objects thrown through a room: 5 to 50 cm above the floor, at 2 to 6 m/s."""
    shapes = [_random_shape(kind, rng) for kind in kinds]
    objects = [
        SceneObject(f"{kind}_{i}", f"material_{i}", shape)
        for i, (kind, shape) in enumerate(zip(kinds, shapes, strict=True))
    ]
    positions = _separate_positions(shapes, half_room, rng)
    states = [
        ObjectState(position, _random_turn(rng), _throw(rng), rng.uniform(-5.0, 5.0, 3))
        for position in positions
    ]
    scene = Scene(room(half_room), tuple(objects), tuple(states))
    return Instance(scene, Surface(), noisy_starts(scene, simulations, rng))


def dropped(height: float, restitution: float) -> Instance:
    """Return one ball whose lowest point is `height` above a floor, at rest."""
    ball = Sphere(0.1)
    return _single_ball(ball, Surface(restitution=restitution), ObjectState((0, 0, 0.1 + height)))


def pushed(speed: float, friction: float) -> Instance:
    """Return one ball that slides on a floor without angular velocity or rolling resistance."""
    surface = Surface(friction, friction, 0.0, 0.0)
    return _single_ball(
        Sphere(0.1), surface, ObjectState((0, 0, 0.1), linear_velocity=(speed, 0, 0))
    )


def room(half: float = HALF_ROOM) -> Environment:
    """Return a floor and four walls, `half` m from the middle."""
    walls = [
        Plane(f"wall_{axis}{'+' if sign > 0 else '-'}", "room", -sign * np.eye(3)[axis], -half)
        for axis in (0, 1)
        for sign in (1, -1)
    ]
    return Environment([Plane("floor", "room", (0, 0, 1), 0.0), *walls])


def noisy_starts(scene: Scene, simulations: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return the initial state and noisy copies of it, as a prediction wants them."""
    first = np.array([state.to_vector() for state in scene.states])
    starts = np.repeat(first[None], simulations, axis=0)
    places, velocities = rng.normal(size=(2, simulations - 1, len(first), 3))
    # A start must not reach into the floor or another object.
    most = 0.4 * CLEARANCE
    starts[1:, :, 0:3] += np.clip(POSITION_NOISE * places, -most, most)
    starts[1:, :, 7:10] += VELOCITY_NOISE * velocities
    return starts


def _single_ball(ball: Sphere, surface: Surface, state: ObjectState) -> Instance:
    floor = Environment([Plane("floor", "room", (0, 0, 1), 0.0)])
    scene = Scene(floor, (SceneObject("ball", "ball", ball),), (state,))
    return Instance(scene, surface, state.to_vector()[None, None])


def _random_shape(kind: str, rng: np.random.Generator) -> Shape:
    if kind == "sphere":
        return Sphere(rng.uniform(0.05, 0.15))
    if kind == "box":
        x, y, z = rng.uniform(0.1, 0.3, 3)
        return Box((x, y, z))
    return Capsule(rng.uniform(0.05, 0.1), rng.uniform(0.1, 0.3))


def _separate_positions(
    shapes: Sequence[Shape], half_room: float, rng: np.random.Generator
) -> list[NDArray[np.float64]]:
    placed: list[NDArray[np.float64]] = []
    for shape in shapes:
        while True:
            above = shape.bounding_radius + rng.uniform(CLEARANCE, 0.5)
            position = np.array([*rng.uniform(-0.7 * half_room, 0.7 * half_room, 2), above])
            gaps = [
                np.linalg.norm(position - other) - shape.bounding_radius - their.bounding_radius
                for other, their in zip(placed, shapes, strict=False)
            ]
            if min(gaps, default=CLEARANCE) >= 2 * CLEARANCE or not gaps:
                break
        placed.append(position)
    return placed


def _random_turn(rng: np.random.Generator) -> NDArray[np.float64]:
    quaternion = rng.normal(size=4)
    return quaternion / np.linalg.norm(quaternion)


def _throw(rng: np.random.Generator) -> NDArray[np.float64]:
    heading, elevation = rng.uniform(-np.pi, np.pi), rng.uniform(-np.pi / 6, np.pi / 6)
    level = np.cos(elevation)
    direction = [level * np.cos(heading), level * np.sin(heading), np.sin(elevation)]
    return rng.uniform(2.0, 6.0) * np.array(direction)
