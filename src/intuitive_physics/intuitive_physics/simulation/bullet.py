"""PyBullet behind the simulators' interface: another engine's opinion, and boxes and capsules.

Bullet gives each *body* its coefficients and multiplies the two of a contact. So pairs of materials
can be expressed exactly only where the wanted matrix is such a product; where it is not, and where
static and dynamic friction differ, this engine refuses instead of simulating something else.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import (
    IntuitivePhysicsError,
    InvalidInputError,
    UnsupportedSceneError,
)
from intuitive_physics.scene import Environment
from intuitive_physics.shapes import Box, Capsule, Shape, Sphere
from intuitive_physics.simulation.simulator import Rollout, Simulator, WorldStatus
from intuitive_physics.simulation.world_batch import BOX, SPHERE, WorldBatch

_PYBULLET_LOCK = threading.Lock()
"""PyBullet crashes when two threads use it, each with a client of its own."""

DEFAULT_TIME_STEP = 1e-3


class BulletSimulator(Simulator):
    """Simulates one world after the other in PyBullet.

    Parameters
    ----------
    time_step : s, of the engine; outputs are interpolated linearly between steps
    """

    name = "bullet"

    def __init__(self, *, time_step: float = DEFAULT_TIME_STEP) -> None:
        if not 1e-6 <= time_step <= 0.1:
            raise InvalidInputError(f"time step is {time_step} s; expected 1e-6 to 0.1 s")
        self.time_step = time_step

    def _rollout(
        self, worlds: WorldBatch, times: NDArray[np.float64], orientations: bool
    ) -> Rollout:
        plans = [_plan_world(worlds, w) for w in range(worlds.size)]
        shape = (*worlds.states.shape[:2], times.shape[1])
        positions = np.full((*shape, 3), np.nan)
        turned = np.full((*shape, 4), np.nan)
        status = np.zeros(worlds.size, dtype=np.int64)
        with _PYBULLET_LOCK, _Client() as client:
            for w, plan in enumerate(plans):
                row = times[w if len(times) > 1 else 0]
                row = row[np.isfinite(row)]
                x, q = _roll_world(client, plan, row, self.time_step)
                finite = np.isfinite(x).all()
                status[w] = WorldStatus.OK if finite else WorldStatus.NOT_FINITE
                if finite:
                    positions[w, : x.shape[1], : row.size] = x.transpose(1, 0, 2)
                    turned[w, : x.shape[1], : row.size] = q.transpose(1, 0, 2)
        return Rollout(positions, turned if orientations else None, status)


@dataclass(frozen=True)
class _Surface:
    """Bullet's coefficients of one body; rolling in m."""

    friction: float
    rolling: float
    restitution: float


@dataclass(frozen=True)
class _Plan:
    environment: Environment
    static_surfaces: list[_Surface]
    shapes: list[Shape]
    surfaces: list[_Surface]
    masses: list[float]
    inertias: list[NDArray[np.float64]]
    states: NDArray[np.float64]


def _plan_world(worlds: WorldBatch, w: int) -> _Plan:
    environment = worlds.environments[worlds.environment_index[w]]
    for plane in environment.planes:
        if plane.boundary is not None:
            raise UnsupportedSceneError(
                f"plane {plane.id} has a boundary; bullet simulates planes without edges only, "
                "leave the boundary out or use a static box"
            )
    count = int(worlds.object_counts[w])
    shapes = [_shape(worlds.shape_kinds[w, i], worlds.dimensions[w, i]) for i in range(count)]
    objects = worlds.object_materials[w, :count]
    static = np.array(
        [worlds.materials.index(p.material) for p in (*environment.planes, *environment.boxes)],
        dtype=np.int64,
    )
    c = int(worlds.parameter_index[w])
    surfaces, static_surfaces = _surfaces(worlds.coefficients[c], objects, static, shapes)
    density = worlds.density[c, objects]
    return _Plan(
        environment=environment,
        static_surfaces=static_surfaces,
        shapes=shapes,
        surfaces=surfaces,
        masses=[s.mass(rho) for s, rho in zip(shapes, density, strict=True)],
        inertias=[s.inertia(rho) for s, rho in zip(shapes, density, strict=True)],
        states=worlds.states[w, :count],
    )


def _shape(kind: int, dimensions: NDArray[np.float64]) -> Shape:
    if kind == SPHERE:
        return Sphere(dimensions[0])
    if kind == BOX:
        return Box((dimensions[0], dimensions[1], dimensions[2]))
    return Capsule(dimensions[0], dimensions[1])


def _surfaces(
    coefficients: NDArray[np.float64],
    objects: NDArray[np.int64],
    static: NDArray[np.int64],
    shapes: list[Shape],
) -> tuple[list[_Surface], list[_Surface]]:
    """Find per-body coefficients whose products are the wanted ones of all pairs."""
    mu_s, mu_d, mu_r, e = coefficients
    touching = [(a, b) for k, a in enumerate(objects) for b in (*static, *objects[:k])]
    if any(mu_s[a, b] != mu_d[a, b] for a, b in touching):
        raise UnsupportedSceneError(
            "static and dynamic friction differ; bullet has one friction coefficient, "
            "make them equal or use event_driven"
        )
    own_friction, their_friction = _factors(mu_d, objects, static, "friction")
    own_restitution, their_restitution = _factors(e, objects, static, "restitution")
    # Bullet combines rolling friction as a.rolling * b.friction + b.rolling * a.friction.
    lever = np.array([_rolling_radius(shape) for shape in shapes])
    if len(objects) == 1:
        own_rolling = np.zeros(1)
        their_rolling = mu_r[objects[0], static] * lever[0]
    else:
        wanted = mu_r[np.ix_(objects, static)] * lever[:, None]
        their_rolling = np.zeros(len(static))
        with np.errstate(divide="ignore", invalid="ignore"):
            each = np.where(wanted > 0.0, wanted / their_friction, 0.0)
        own_rolling = each[:, 0] if len(static) else np.zeros(len(objects))
        if not np.isfinite(each).all() or not np.allclose(each, own_rolling[:, None], rtol=1e-6):
            raise UnsupportedSceneError(
                "rolling friction differs between parts of the environment; bullet can express "
                "that for a single object only"
            )
    return (
        [
            _Surface(*values)
            for values in zip(own_friction, own_rolling, own_restitution, strict=True)
        ],
        [
            _Surface(*values)
            for values in zip(their_friction, their_rolling, their_restitution, strict=True)
        ],
    )


def _factors(
    matrix: NDArray[np.float64],
    objects: NDArray[np.int64],
    static: NDArray[np.int64],
    name: str,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Write matrix[a, b] as own[a] * other[b] for all pairs that can touch."""
    if len(objects) == 1:
        return np.ones(1), matrix[objects[0], static]
    bodies = [*objects, *static]
    pairs = [(i, k) for i in range(len(objects)) for k in range(i + 1, len(bodies))]
    wanted = np.array([matrix[bodies[i], bodies[k]] for i, k in pairs])
    if not wanted.any():
        factors = np.zeros(len(bodies))
    else:
        design = np.zeros((len(pairs), len(bodies)))
        for row, (i, k) in enumerate(pairs):
            design[row, [i, k]] = 1.0
        logarithms = np.log(np.maximum(wanted, 1e-300))
        factors = np.exp(np.linalg.lstsq(design, logarithms, rcond=None)[0])
    made = np.array([factors[i] * factors[k] for i, k in pairs])
    if not np.allclose(made, wanted, rtol=1e-6, atol=1e-9):
        raise UnsupportedSceneError(
            f"the {name} of the pairs is no product of one number for each body; bullet "
            "multiplies the numbers of two bodies, use event_driven"
        )
    return factors[: len(objects)], factors[len(objects) :]


def _rolling_radius(shape: Shape) -> float:
    return shape.radius if isinstance(shape, Sphere | Capsule) else shape.bounding_radius


class _Client:
    """A PyBullet world without a window, closed at the end whatever happens."""

    def __enter__(self) -> _Client:
        try:
            import pybullet
        except ImportError:
            raise IntuitivePhysicsError(
                "PyBullet is not installed; install it with 'pip install pybullet' "
                "or use event_driven"
            ) from None
        self.engine: Any = pybullet
        self.id = pybullet.connect(pybullet.DIRECT)
        return self

    def __exit__(self, *_: object) -> None:
        self.engine.disconnect(self.id)


def _roll_world(
    client: _Client, plan: _Plan, times: NDArray[np.float64], time_step: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return positions (n_times, n_objects, 3) and orientations (n_times, n_objects, 4)."""
    engine, world = client.engine, client.id
    _reset(client, plan.environment, time_step)
    _add_environment(client, plan)
    bodies = [_add_object(client, plan, i) for i in range(len(plan.shapes))]

    def look() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        poses = [engine.getBasePositionAndOrientation(b, physicsClientId=world) for b in bodies]
        return np.array([p for p, _ in poses]), np.array([q for _, q in poses])

    positions, orientations = [], []
    steps = 0
    before = after = look()
    for t in times:
        while steps * time_step < t - 1e-12:
            engine.stepSimulation(physicsClientId=world)
            steps += 1
            before, after = after, look()
        part = 1.0 - (steps * time_step - t) / time_step if steps else 1.0
        positions.append((1.0 - part) * before[0] + part * after[0])
        turned = after[1] * part + before[1] * (1.0 - part) * np.sign(
            (before[1] * after[1]).sum(axis=1, keepdims=True)
        )
        orientations.append(turned / np.linalg.norm(turned, axis=1, keepdims=True))
    return np.array(positions), np.array(orientations)


def _reset(client: _Client, environment: Environment, time_step: float) -> None:
    engine, world = client.engine, client.id
    engine.resetSimulation(physicsClientId=world)
    engine.setGravity(*environment.gravity.tolist(), physicsClientId=world)
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
        physicsClientId=world,
    )


def _add_environment(client: _Client, plan: _Plan) -> None:
    engine, world = client.engine, client.id
    planes, boxes = plan.environment.planes, plan.environment.boxes
    for plane, surface in zip(planes, plan.static_surfaces, strict=False):
        shape = engine.createCollisionShape(
            engine.GEOM_PLANE, planeNormal=plane.normal.tolist(), physicsClientId=world
        )
        at = (plane.normal * plane.offset).tolist()
        body = engine.createMultiBody(0, shape, basePosition=at, physicsClientId=world)
        _set_surface(client, body, surface)
    for box, surface in zip(boxes, plan.static_surfaces[len(planes) :], strict=True):
        half = (0.5 * box.edge_lengths).tolist()
        shape = engine.createCollisionShape(
            engine.GEOM_BOX, halfExtents=half, physicsClientId=world
        )
        body = engine.createMultiBody(
            0,
            shape,
            basePosition=box.center.tolist(),
            baseOrientation=box.orientation.tolist(),
            physicsClientId=world,
        )
        _set_surface(client, body, surface)


def _add_object(client: _Client, plan: _Plan, i: int) -> int:
    engine, world = client.engine, client.id
    state = plan.states[i].tolist()
    body = engine.createMultiBody(
        plan.masses[i],
        _collision_shape(client, plan.shapes[i]),
        basePosition=state[0:3],
        baseOrientation=state[3:7],
        physicsClientId=world,
    )
    _set_surface(client, body, plan.surfaces[i])
    engine.changeDynamics(
        body,
        -1,
        localInertiaDiagonal=plan.inertias[i].tolist(),
        linearDamping=0.0,
        angularDamping=0.0,
        maxJointVelocity=1e6,
        activationState=engine.ACTIVATION_STATE_DISABLE_SLEEPING,
        physicsClientId=world,
    )
    engine.resetBaseVelocity(body, state[7:10], state[10:13], physicsClientId=world)
    return int(body)


def _collision_shape(client: _Client, shape: Shape) -> int:
    engine, world = client.engine, client.id
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
    return int(engine.createCollisionShape(**arguments, physicsClientId=world))


def _set_surface(client: _Client, body: int, surface: _Surface) -> None:
    client.engine.changeDynamics(
        body,
        -1,
        lateralFriction=float(surface.friction),
        rollingFriction=float(surface.rolling),
        spinningFriction=float(surface.rolling),
        restitution=float(surface.restitution),
        contactProcessingThreshold=0.0,
        physicsClientId=client.id,
    )
