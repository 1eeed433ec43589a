"""A PyBullet world without a window: built from a plan, stepped, and looked at."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import IntuitivePhysicsError
from intuitive_physics.geometry.rotations import rotation_matrix
from intuitive_physics.scene import Environment
from intuitive_physics.shapes import Box, Capsule, Shape, Sphere
from intuitive_physics.simulation.bullet.plan import Plan
from intuitive_physics.simulation.bullet.surfaces import Surface
from intuitive_physics.simulation.stop_flag import StopFlag

OVERLAP_LEFT, OVERLAP_TAKEN = 1e-5, 0.2
"""Depth in m that a contact may keep, and the part of the rest that each step takes away."""


class Client:
    """PyBullet with a world without a window, closed at the end whatever happens.

    Its functions are PyBullet's, of which each takes the number of this world.
    """

    def __enter__(self) -> Client:
        try:
            import pybullet
        except ImportError:
            raise IntuitivePhysicsError(
                "PyBullet is not installed; install it with 'pip install pybullet' or use stepped"
            ) from None
        self._pybullet: Any = pybullet
        # PyBullet's own `BulletClient` prints on standard output.
        self._world = pybullet.connect(pybullet.DIRECT)
        return self

    def __getattr__(self, name: str) -> Any:
        found = getattr(self._pybullet, name)
        return partial(found, physicsClientId=self._world) if callable(found) else found

    def __exit__(self, *_: object) -> None:
        self._pybullet.disconnect(self._world)


def roll_world(
    engine: Client,
    plan: Plan,
    times: NDArray[np.float64],
    time_step: float,
    stop: StopFlag,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Simulate one world, to the end unless it is stopped.

    Parameters
    ----------
    times : (n_times,) s
    time_step : s
    stop : looked at before each step

    Returns
    -------
    tuple
        Positions (n_times, n_objects, 3) m, orientations (n_times, n_objects, 4) as (x, y, z, w).
    """
    _reset(engine, plan.environment, time_step)
    _add_environment(engine, plan)
    bodies = [_add_object(engine, plan, i) for i in range(len(plan.shapes))]

    def look() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        poses = [engine.getBasePositionAndOrientation(b) for b in bodies]
        turned = np.array([q for _, q in poses])
        return np.array([p for p, _ in poses]) - _levers(plan, turned), turned

    positions, orientations = [], []
    steps = 0
    before = after = look()
    for t in times:
        while steps * time_step < t - 1e-12 and not stop.is_set():
            engine.stepSimulation()
            _part_overlapping(engine, set(bodies))
            steps += 1
            before, after = after, look()
        part = 1.0 - (steps * time_step - t) / time_step if steps else 1.0
        positions.append((1.0 - part) * before[0] + part * after[0])
        turned = after[1] * part + before[1] * (1.0 - part) * np.sign(
            (before[1] * after[1]).sum(axis=1, keepdims=True)
        )
        orientations.append(turned / np.linalg.norm(turned, axis=1, keepdims=True))
    return np.array(positions), np.array(orientations)


def _levers(plan: Plan, orientations: NDArray[np.float64]) -> NDArray[np.float64]:
    """Vectors (n, 3) m from the shapes' centres to those of mass, which Bullet calls positions."""
    if not plan.mass_centres.any():
        return np.zeros_like(plan.mass_centres)
    turns = np.array([rotation_matrix(q / np.linalg.norm(q)) for q in orientations])
    return np.asarray((turns @ plan.mass_centres[..., None])[..., 0])


def _part_overlapping(engine: Client, bodies: set[int]) -> None:
    """Move objects that sink into something a part of the way out; their velocities stay.

    Bullet does that only by giving them speed (ERP), which a bounce would keep. Without it, boxes
    and capsules, whose contact points it finds late, would sink by up to g times the step each
    second.
    """
    deepest: dict[int, tuple[float, NDArray[np.float64]]] = {}
    for contact in engine.getContactPoints():
        depth = -contact[8]
        if depth <= OVERLAP_LEFT:
            continue
        first, second = contact[1], contact[2]
        share = OVERLAP_TAKEN * (depth - OVERLAP_LEFT)
        if first in bodies and second in bodies:
            share *= 0.5
        for body, sign in ((first, 1.0), (second, -1.0)):
            if body in bodies and depth > deepest.get(body, (0.0, None))[0]:
                deepest[body] = depth, sign * share * np.array(contact[7])
    for body, (_, move) in deepest.items():
        position, orientation = engine.getBasePositionAndOrientation(body)
        velocity, spin = engine.getBaseVelocity(body)
        engine.resetBasePositionAndOrientation(body, (position + move).tolist(), orientation)
        engine.resetBaseVelocity(body, velocity, spin)


def _reset(engine: Client, environment: Environment, time_step: float) -> None:
    engine.resetSimulation()
    engine.setGravity(*environment.gravity.tolist())
    # By default Bullet swallows slow bounces, lets rolling balls drift sideways (warm start), takes
    # the gap of a contact to come and the slop of one that is there from its rebound, and turns the
    # depth of penetration into speed (ERP): a drop from 1 m rebounds 24 % too high.
    engine.setPhysicsEngineParameter(
        fixedTimeStep=time_step,
        numSubSteps=0,
        numSolverIterations=50,
        restitutionVelocityThreshold=0.0,
        warmStartingFactor=0.0,
        erp=0.0,
        contactERP=0.0,
        contactSlop=0.0,
        enableConeFriction=1,
        deterministicOverlappingPairs=1,
    )


def _add_environment(engine: Client, plan: Plan) -> None:
    planes, boxes = plan.environment.planes, plan.environment.boxes
    for plane, surface in zip(planes, plan.static_surfaces, strict=False):
        shape = engine.createCollisionShape(engine.GEOM_PLANE, planeNormal=plane.normal.tolist())
        at = (plane.normal * plane.offset).tolist()
        body = engine.createMultiBody(0, shape, basePosition=at)
        _set_surface(engine, body, surface)
    for box, surface in zip(boxes, plan.static_surfaces[len(planes) :], strict=True):
        half = (0.5 * box.edge_lengths).tolist()
        shape = engine.createCollisionShape(engine.GEOM_BOX, halfExtents=half)
        body = engine.createMultiBody(
            0,
            shape,
            basePosition=box.center.tolist(),
            baseOrientation=box.orientation.tolist(),
        )
        _set_surface(engine, body, surface)


def _add_object(engine: Client, plan: Plan, i: int) -> int:
    state = plan.states[i].tolist()
    lever = _levers(plan, plan.states[:, 3:7])[i]
    body = engine.createMultiBody(
        plan.masses[i],
        _collision_shape(engine, plan.shapes[i], plan.mass_centres[i]),
        basePosition=(state[0:3] + lever).tolist(),
        baseOrientation=state[3:7],
    )
    _set_surface(engine, body, plan.surfaces[i])
    engine.changeDynamics(
        body,
        -1,
        localInertiaDiagonal=plan.inertias[i].tolist(),
        linearDamping=0.0,
        angularDamping=0.0,
        maxJointVelocity=1e6,
        activationState=engine.ACTIVATION_STATE_DISABLE_SLEEPING,
    )
    velocity = state[7:10] + np.cross(state[10:13], lever)
    engine.resetBaseVelocity(body, velocity.tolist(), state[10:13])
    return int(body)


def _collision_shape(engine: Client, shape: Shape, mass_centre: NDArray[np.float64]) -> int:
    match shape:
        case Sphere():
            arguments = {"shapeType": engine.GEOM_SPHERE, "radius": shape.radius}
        case Box():
            half = [0.5 * edge for edge in shape.edge_lengths]
            arguments = {"shapeType": engine.GEOM_BOX, "halfExtents": half}
        case Capsule():
            arguments = {
                "shapeType": engine.GEOM_CAPSULE,
                "radius": shape.radius,
                "height": shape.length,
            }
    if mass_centre.any():
        arguments["collisionFramePosition"] = (-mass_centre).tolist()
    return int(engine.createCollisionShape(**arguments))


def _set_surface(engine: Client, body: int, surface: Surface) -> None:
    engine.changeDynamics(
        body,
        -1,
        lateralFriction=float(surface.friction),
        rollingFriction=float(surface.rolling),
        spinningFriction=float(surface.rolling),
        restitution=float(surface.restitution),
        contactProcessingThreshold=0.0,
    )
