"""Room, object pool, θ_s and initial states of the paper's synthetic set (Secs. IV-A, IV-B).

What the paper leaves open is decided here, in one place:

- Floor and walls are planes instead of five boxes. Their inner faces are the same and nothing gets
  behind them, but a plane has no edges, so it costs less and spheres can go from event to event.
- A dimension of U(0.1, 0.7) m is a sphere's diameter, a box's edge, a capsule's diameter and the
  length of its cylinder.
- The circle that starts are drawn about lies 2 m, two standard deviations of Eq. 10, above the
  floor and from each wall, so that few starts have to be drawn again.
- Eq. 10 gives no orientation: objects start along the axes of the room.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError, UnknownNameError
from intuitive_physics.materials import StaticParameters
from intuitive_physics.parameter_space import Bounds, ParameterSpace
from intuitive_physics.scene import Environment, Plane, SceneObject
from intuitive_physics.shapes import Box, Capsule, Shape, Sphere
from intuitive_physics.simulation import Simulator
from intuitive_physics.state import ObjectState
from intuitive_physics_cli.plugins import make_engine

ROOM_MATERIAL = "room"  # Material of floor and walls
HALF_ROOM = 5.0  # m from the room's middle to each wall
SHAPE_KINDS = (Sphere.kind, Box.kind, Capsule.kind)  # Kinds of objects in the paper's set
DIMENSIONS = (0.1, 0.7)  # m, smallest and largest diameter or edge
CIRCLE_CENTER = (0.0, 0.0, 2.0)  # m, of the circle about which objects start (Eq. 10)
CIRCLE_RADIUS = 3.0  # m
START_DEVIATION = 1.0  # m and m/s, of the positions and the velocities of Eq. 10.
SPIN_DEVIATION = 0.1  # rad/s, of the angular velocities of Eq. 10.

# m at least between the bounding spheres of two objects, and to the room, at the start.
CLEARANCE = 0.01

MOST_ATTEMPTS = 1000  # Draws of a start that touches nothing before it is given up

# Ranges that θ_s is drawn from, uniformly on each scale; within the bounds that learners search.
TRUE_RANGES = {
    "density": Bounds(200.0, 2000.0, "logarithmic"),
    "static_friction": Bounds(0.1, 1.0),
    "dynamic_friction": Bounds(0.1, 1.0),
    "rolling_friction": Bounds(1e-3, 0.1, "logarithmic"),
    "restitution": Bounds(0.1, 0.9),
}


def paper_room() -> Environment:
    """Return Ω_e: a floor z = 0 and four walls about 10 × 10 m, all of one material."""
    walls = [
        Plane(f"wall_{axis}_{side}", ROOM_MATERIAL, -sign * np.eye(3)["xy".index(axis)], -HALF_ROOM)
        for axis in "xy"
        for side, sign in (("plus", 1.0), ("minus", -1.0))
    ]
    return Environment([Plane("floor", ROOM_MATERIAL, (0.0, 0.0, 1.0), 0.0), *walls])


def draw_pool(
    count: int, rng: np.random.Generator, kinds: Sequence[str] = SHAPE_KINDS
) -> tuple[SceneObject, ...]:
    """Draw objects of random shape, of these kinds, and size, each with a material of its own."""
    if count < 1:
        raise InvalidInputError(f"pool has {count} objects; expected at least 1")
    unknown = [kind for kind in kinds if kind not in SHAPE_KINDS]
    if unknown or not kinds:
        raise UnknownNameError(
            f"kinds of shapes are {list(kinds)}; expected some of {', '.join(SHAPE_KINDS)}"
        )
    shapes = [_draw_shape(kinds[int(rng.integers(len(kinds)))], rng) for _ in range(count)]
    return tuple(
        SceneObject(f"{shape.kind}_{i}", f"material_{i}", shape) for i, shape in enumerate(shapes)
    )


def pool_materials(pool: Sequence[SceneObject]) -> tuple[str, ...]:
    """Materials of a pool and its room: m = objects + 1."""
    return (*(scene_object.material for scene_object in pool), ROOM_MATERIAL)


def draw_parameters(pool: Sequence[SceneObject], rng: np.random.Generator) -> StaticParameters:
    """Draw θ_s, each parameter for itself from `TRUE_RANGES`, with μ_d ≤ μ_s."""
    space = ParameterSpace(pool_materials(pool), TRUE_RANGES)
    return space.to_parameters(rng.random(space.size))


def draw_initial_states(
    objects: Sequence[SceneObject], rng: np.random.Generator
) -> tuple[ObjectState, ...]:
    """Draw θ_d of each object by Eq. 10, again where it reaches out of the room or into another."""
    states: list[ObjectState] = []
    for scene_object in objects:
        for _ in range(MOST_ATTEMPTS):
            state = _draw_initial_state(rng)
            if _is_free(state.position, scene_object.shape, states, objects):
                states.append(state)
                break
        else:
            raise InvalidInputError(
                f"object {len(states) + 1} of {len(objects)} found no free place in "
                f"{MOST_ATTEMPTS} draws; expected fewer objects in one scene"
            )
    return tuple(states)


def _draw_shape(kind: str, rng: np.random.Generator) -> Shape:
    match kind:
        case Sphere.kind:
            return Sphere(rng.uniform(*DIMENSIONS) / 2.0)
        case Box.kind:
            x, y, z = rng.uniform(*DIMENSIONS, size=3)
            return Box((x, y, z))
        case _:
            diameter, length = rng.uniform(*DIMENSIONS, size=2)
            return Capsule(diameter / 2.0, length)


def _draw_initial_state(rng: np.random.Generator) -> ObjectState:
    # Eq. 10
    angle = rng.uniform(-np.pi, np.pi)
    center = np.array(CIRCLE_CENTER)
    on_circle = center + CIRCLE_RADIUS * np.array([np.sin(angle), np.cos(angle), 0.0])
    position = on_circle + rng.normal(0.0, START_DEVIATION, 3)
    velocity = center - position + rng.normal(0.0, START_DEVIATION, 3)
    spin = rng.normal(0.0, SPIN_DEVIATION, 3)
    return ObjectState(position, linear_velocity=velocity, angular_velocity=spin)


def _is_free(
    position: NDArray[np.float64],
    shape: Shape,
    others: Sequence[ObjectState],
    objects: Sequence[SceneObject],
) -> bool:
    reach = shape.bounding_radius + CLEARANCE
    if position[2] < reach or np.abs(position[:2]).max() > HALF_ROOM - reach:
        return False
    return all(
        np.linalg.norm(position - other.position) > reach + scene_object.shape.bounding_radius
        for other, scene_object in zip(others, objects, strict=False)
    )


DATASET_ENGINES = ("auto", "stepped", "bullet", "mujoco")  # Simulators that can make the set


def dataset_simulator(engine: str) -> Simulator:
    """Return the simulator of that name, one of `DATASET_ENGINES`."""
    if engine not in DATASET_ENGINES:
        raise UnknownNameError(
            f"engine of the set is {engine!r}; expected one of {', '.join(DATASET_ENGINES)}"
        )
    return make_engine(engine)


def dataset_parameters(
    engine: str, pool: Sequence[SceneObject], rng: np.random.Generator
) -> StaticParameters:
    """Draw θ_s that the engine can express."""
    if engine == "bullet":
        return _parameters_by_body(pool, rng)
    parameters = draw_parameters(pool, rng)
    if engine == "mujoco":
        static, _, rolling, restitution = parameters.coefficients
        coefficients = np.stack([static, static, rolling, restitution])
        return StaticParameters(parameters.materials, parameters.density, coefficients)
    return parameters


def _parameters_by_body(pool: Sequence[SceneObject], rng: np.random.Generator) -> StaticParameters:
    """Draw a friction f, a restitution e and a rolling arm ρ for each body, as Bullet has them.

    A pair (a, b) gets μ_s = μ_d = f_a f_b, e_a e_b, and the arm ρ_a f_b + ρ_b f_a, which is μ_r
    times the smaller radius. The room has f = e = 1 and ρ = 0, so an object's own values are those
    it has against the room; boxes do not roll.
    """
    by_pair = draw_parameters(pool, rng)
    room = len(pool)
    friction, rolling, restitution = np.append(
        by_pair.coefficients[1:, :room, room], [[1.0], [0.0], [1.0]], axis=1
    )
    radii = np.array([_rolling_radius(scene_object) for scene_object in pool] + [np.inf])
    arms = np.where(np.isfinite(radii), rolling, 0.0) * np.where(np.isfinite(radii), radii, 0.0)
    pair_friction = np.outer(friction, friction)
    pair_arms = np.outer(arms, friction) + np.outer(friction, arms)
    pair_rolling = pair_arms / np.minimum.outer(radii, radii)
    neither_rolls = np.isinf(np.minimum.outer(radii, radii))
    pair_rolling[neither_rolls] = TRUE_RANGES["rolling_friction"].lower
    pair_restitution = np.outer(restitution, restitution)
    return StaticParameters(
        pool_materials(pool),
        by_pair.density,
        np.stack([pair_friction, pair_friction, pair_rolling, pair_restitution]),
    )


def _rolling_radius(scene_object: SceneObject) -> float:
    return scene_object.shape.radius if isinstance(scene_object.shape, Sphere | Capsule) else np.inf
