"""Rapier: the copies of a scene are rooms of one world, restored before each prediction."""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers.engine import Engine, MissingPeerError, Prediction, Prepared
from benchmarks.scenes import DENSITY, Instance
from intuitive_physics.scene import Plane
from intuitive_physics.shapes import Box, Capsule, Shape, Sphere

ROOM_DISTANCE = 40.0  # m between the middles of two rooms
# Half extents in m of the box that is a wall or floor: along it, and across it
REACH, DEPTH = 12.0, 1.0


class Rapier(Engine):
    """Rapier on one thread at its defaults, where bodies at rest sleep."""

    name = "Rapier"
    how = (
        "one world, rooms 40 m apart, planes as boxes, sleeping; μ_d only, no rolling friction, "
        "single precision; poses are read one by one"
    )
    optional = True

    def prepare(self, instance: Instance, steps: int, time_step: float) -> Prepared:
        return _Prepared(instance, steps, time_step)


class _Prepared(Prepared):
    def __init__(self, instance: Instance, steps: int, time_step: float) -> None:
        try:
            import rapier3d
        except ImportError:
            raise MissingPeerError("Rapier is missing: .venv/bin/pip install rapier3d") from None
        self._engine: Any = rapier3d
        self._instance = instance
        self._steps = steps
        self._middles = _middles(len(instance.starts))
        world = rapier3d.PhysicsWorld(gravity=instance.scene.environment.gravity.tolist())
        world.integration_parameters.dt = time_step
        for middle in self._middles:
            for plane in instance.scene.environment.planes:
                self._add_plane(world, plane, middle)
        self._handles = [
            self._add_object(world, shape) for _ in self._middles for shape in instance.shapes
        ]
        # Contacts of an earlier prediction would warm the solver of the next one.
        self._built = world.snapshot()

    def predict(self) -> Prediction:
        world = self._engine.PhysicsWorld.restore(self._built)
        world.set_num_threads(1)
        starts = self._instance.starts.copy()
        starts[..., 0:3] += self._middles[:, None]
        bodies = [world.rigid_bodies[handle] for handle in self._handles]
        states = starts.reshape(-1, 13).tolist()
        turns = [self._engine.Rotation3(s[6], *s[3:6]) for s in states]
        start = time.perf_counter()
        for body, state, turn in zip(bodies, states, turns, strict=True):
            body.translation, body.rotation = state[0:3], turn
            body.linvel, body.angvel = state[7:10], state[10:13]
        rows = []
        for _ in range(self._steps):
            world.step()
            rows.append([(at.x, at.y, at.z) for at in [body.translation for body in bodies]])
        shape = (self._steps, *starts.shape[:2], 3)
        positions = np.array(rows).reshape(shape).transpose(1, 2, 0, 3)
        positions = positions - self._middles[:, None, None]
        return Prediction(time.perf_counter() - start, positions)

    def _add_plane(self, world: Any, plane: Plane, middle: NDArray[np.float64]) -> None:
        """Add a box whose side that faces the room is the plane."""
        axis = int(np.argmax(np.abs(plane.normal)))
        half = np.full(3, REACH)
        half[axis] = DEPTH
        if not math.isclose(abs(plane.normal[axis]), 1.0):
            raise ValueError(f"a plane's normal is {plane.normal}; expected one along an axis")
        place = middle + (plane.offset - DEPTH) * plane.normal
        self._add(world, self._engine.Collider.cuboid(*half).translation(place.tolist()))

    def _add_object(self, world: Any, shape: Shape) -> Any:
        collider = self._engine.Collider
        match shape:
            case Sphere():
                solid = collider.ball(shape.radius)
            case Box():
                solid = collider.cuboid(*(edge / 2 for edge in shape.edge_lengths))
            case Capsule():
                solid = collider.capsule_z(shape.length / 2, shape.radius)
            case _:
                raise TypeError(f"shape is {shape!r}; expected a Sphere, Box or Capsule")
        # Rapier makes mass and inertia of the density as we do.
        body = world.add_body(self._engine.RigidBody.dynamic().gyroscopic_forces(True))
        self._add(world, solid.density(DENSITY), body)
        return body

    def _add(self, world: Any, solid: Any, body: Any = None) -> None:
        surface = self._instance.surface
        with_surface = solid.friction(surface.dynamic_friction).restitution(surface.restitution)
        world.add_collider(with_surface, body)


def _middles(rooms: int) -> NDArray[np.float64]:
    """Return where the rooms are, (rooms, 3) m: a square about the origin."""
    side = math.ceil(math.sqrt(rooms))
    rows, columns = np.divmod(np.arange(rooms), side)
    places = np.stack([columns, rows, np.zeros(rooms)], axis=1)
    return ROOM_DISTANCE * (places - [(side - 1) / 2, (side - 1) / 2, 0.0])
