"""Engines that can make the paper's set, and θ_s that each of them can express.

Another engine than the one that learns shows what model error costs. MuJoCo and Bullet have one
friction coefficient, so where they make the set, μ_s = μ_d. Bullet has coefficients of bodies and
multiplies them, so there θ_s is drawn by body.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from intuitive_physics.errors import UnknownNameError
from intuitive_physics.materials import StaticParameters
from intuitive_physics.scene import SceneObject
from intuitive_physics.shapes import Capsule, Sphere
from intuitive_physics.simulation import Simulator
from intuitive_physics_cli.plugins import make_engine
from intuitive_physics_experiments.paper.paper_room import (
    TRUE_RANGES,
    draw_parameters,
    pool_materials,
)

DATASET_ENGINES = ("auto", "stepped", "bullet", "mujoco")


def dataset_simulator(engine: str) -> Simulator:
    """Return the simulator of that name.

    Raises
    ------
    UnknownNameError
        When it is none of `DATASET_ENGINES`.
    """
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
    radii = np.array([_rolling_radius(thing) for thing in pool] + [np.inf])
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


def _rolling_radius(thing: SceneObject) -> float:
    return thing.shape.radius if isinstance(thing.shape, Sphere | Capsule) else np.inf
