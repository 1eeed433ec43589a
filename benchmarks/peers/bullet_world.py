"""PyBullet: one world, set back to the next start for each simulation."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from benchmarks.peers.engine import Engine, MissingPeerError, Prediction, Prepared
from benchmarks.scenes import DENSITY, Instance
from intuitive_physics.shapes import Box, Capsule, Shape, Sphere


class Bullet(Engine):
    """PyBullet at its default solver settings, but for the speed below which nothing bounces."""

    name = "PyBullet"
    how = "resets of one world; μ_d only; default solver, no least speed of bouncing"

    def prepare(self, instance: Instance, steps: int, time_step: float) -> Prepared:
        return _Prepared(instance, steps, time_step)


class _Prepared(Prepared):
    def __init__(self, instance: Instance, steps: int, time_step: float) -> None:
        try:
            import pybullet
        except ImportError:
            raise MissingPeerError("PyBullet is missing: .venv/bin/pip install pybullet") from None
        self._engine: Any = pybullet
        self._starts = instance.starts
        self._steps = steps
        self._world = pybullet.connect(pybullet.DIRECT)
        environment = instance.scene.environment
        pybullet.setGravity(*environment.gravity.tolist(), physicsClientId=self._world)
        # The default, 0.2 m/s, would swallow bounces that the other engines make.
        pybullet.setPhysicsEngineParameter(
            fixedTimeStep=time_step, restitutionVelocityThreshold=0.0, physicsClientId=self._world
        )
        for plane in environment.planes:
            shape = self._shape(pybullet.GEOM_PLANE, planeNormal=plane.normal.tolist())
            self._add(instance, 0.0, shape, (plane.normal * plane.offset).tolist())
        self._bodies = [self._add_object(instance, shape) for shape in instance.shapes]

    def __exit__(self, *_: object) -> None:
        self._engine.disconnect(self._world)

    def predict(self) -> Prediction:
        starts = self._starts.tolist()
        start = time.perf_counter()
        rows = [[self._positions() for _ in self._stepped(states)] for states in starts]
        positions = np.array(rows).transpose(0, 2, 1, 3)
        return Prediction(time.perf_counter() - start, positions)

    def _stepped(self, states: list[list[float]]) -> Iterator[None]:
        """Yield after each step of a simulation from these states."""
        engine, world = self._engine, self._world
        for body, s in zip(self._bodies, states, strict=True):
            engine.resetBasePositionAndOrientation(body, s[0:3], s[3:7], physicsClientId=world)
            engine.resetBaseVelocity(body, s[7:10], s[10:13], physicsClientId=world)
        for _ in range(self._steps):
            engine.stepSimulation(physicsClientId=world)
            yield

    def _positions(self) -> list[tuple[float, float, float]]:
        where, world = self._engine.getBasePositionAndOrientation, self._world
        return [where(body, physicsClientId=world)[0] for body in self._bodies]

    def _add_object(self, instance: Instance, shape: Shape) -> int:
        engine = self._engine
        match shape:
            case Sphere():
                solid = self._shape(engine.GEOM_SPHERE, radius=shape.radius)
            case Box():
                half = [edge / 2 for edge in shape.edge_lengths]
                solid = self._shape(engine.GEOM_BOX, halfExtents=half)
            case Capsule():
                sizes = {"radius": shape.radius, "height": shape.length}
                solid = self._shape(engine.GEOM_CAPSULE, **sizes)
            case _:
                raise TypeError(f"shape is {shape!r}; expected a Sphere, Box or Capsule")
        body = self._add(instance, shape.mass(DENSITY), solid, [0.0, 0.0, 0.0])
        engine.changeDynamics(
            body,
            -1,
            localInertiaDiagonal=shape.inertia(DENSITY).tolist(),
            linearDamping=0.0,
            angularDamping=0.0,
            physicsClientId=self._world,
        )
        return body

    def _shape(self, kind: int, **dimensions: Any) -> int:
        return int(
            self._engine.createCollisionShape(kind, **dimensions, physicsClientId=self._world)
        )

    def _add(self, instance: Instance, mass: float, shape: int, position: list[float]) -> int:
        engine, surface = self._engine, instance.surface
        body = int(
            engine.createMultiBody(mass, shape, basePosition=position, physicsClientId=self._world)
        )
        # Bullet multiplies the numbers of two bodies, and takes for rolling the sum of each
        # one's rolling times the other's lateral friction.
        friction = math.sqrt(surface.dynamic_friction)
        rolling = surface.rolling_arm / (2 * friction)
        engine.changeDynamics(
            body,
            -1,
            lateralFriction=friction,
            rollingFriction=rolling,
            spinningFriction=rolling,
            restitution=math.sqrt(surface.restitution),
            physicsClientId=self._world,
        )
        return body
