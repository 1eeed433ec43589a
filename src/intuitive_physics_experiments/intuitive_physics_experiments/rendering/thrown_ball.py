"""Motion of a ball among planes by PyBullet at a tiny step: the truth behind rendered bags.

It is an engine other than those that learn, so that learning is not a look in the mirror.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.scene import Environment
from intuitive_physics.state import ObjectState
from intuitive_physics.validation import positive_float

STEP = 1.0 / 4800.0
"""s; a whole number of steps lies between the samples of 60, 120 and 240 Hz."""


@dataclass(frozen=True)
class BallContact:
    """How a ball meets every plane.

    Parameters
    ----------
    friction : μ_s = μ_d, dimensionless
    rolling_friction : μ_r, dimensionless (torque at most μ_r · radius · normal force)
    restitution : e
    """

    friction: float
    rolling_friction: float
    restitution: float


@dataclass(frozen=True, eq=False)
class BallMotion:
    """Sampled motion of a ball, all in the environment's frame.

    Parameters
    ----------
    times : (n,) s after the initial state
    positions : (n, 3) m
    velocities : (n, 3) m/s
    angular_velocities : (n, 3) rad/s
    """

    times: NDArray[np.float64]
    positions: NDArray[np.float64]
    velocities: NDArray[np.float64]
    angular_velocities: NDArray[np.float64]


def move_ball(
    environment: Environment,
    radius: float,
    density: float,
    contact: BallContact,
    start: ObjectState,
    duration: float,
    sample_rate: int = 120,
) -> BallMotion:
    """Simulate one ball from its initial state.

    Parameters
    ----------
    environment : its planes, unbounded, and gravity; boxes are not supported
    radius : m
    density : kg/m³
    duration : s
    sample_rate : Hz, a divisor of 4800

    Raises
    ------
    InvalidInputError
        When the environment has boxes or the rate does not divide the step.
    """
    if environment.boxes:
        raise InvalidInputError(f"environment has {len(environment.boxes)} boxes; expected none")
    stride, rest = divmod(round(1.0 / STEP), sample_rate)
    if rest:
        raise InvalidInputError(f"sample rate is {sample_rate} Hz; expected a divisor of 4800 Hz")
    samples = int(np.floor(positive_float(duration, "duration") * sample_rate + 1e-9)) + 1
    import pybullet

    client = pybullet.connect(pybullet.DIRECT)
    try:
        _set_up_world(pybullet, client, environment)
        mass = density * 4.0 / 3.0 * np.pi * radius**3
        ball = _add_ball(pybullet, client, radius, mass, contact, start)
        rows = np.empty((samples, 9))
        for row in rows:
            row[:3] = pybullet.getBasePositionAndOrientation(ball, physicsClientId=client)[0]
            velocity = pybullet.getBaseVelocity(ball, physicsClientId=client)
            row[3:] = (*velocity[0], *velocity[1])
            for _ in range(stride):
                pybullet.stepSimulation(physicsClientId=client)
    finally:
        pybullet.disconnect(client)
    return BallMotion(np.arange(samples) / sample_rate, rows[:, :3], rows[:, 3:6], rows[:, 6:])


def _set_up_world(pybullet: ModuleType, client: int, environment: Environment) -> None:
    pybullet.setGravity(*environment.gravity, physicsClientId=client)
    # Restitution is exact only if impulses act while the bodies touch, and never before: Bullet
    # subtracts the remaining gap (or the slop) over the step from the rebound speed. So contacts
    # count from distance 0 (`contactProcessingThreshold` below), the slop is 0, and penetration,
    # at most one step deep, is not pushed out, which would add energy.
    pybullet.setPhysicsEngineParameter(
        fixedTimeStep=STEP,
        numSolverIterations=50,
        numSubSteps=0,
        restitutionVelocityThreshold=0.0,
        warmStartingFactor=0.0,
        contactSlop=0.0,
        contactERP=0.0,
        deterministicOverlappingPairs=1,
        physicsClientId=client,
    )
    for plane in environment.planes:
        shape = pybullet.createCollisionShape(
            pybullet.GEOM_PLANE, planeNormal=plane.normal.tolist(), physicsClientId=client
        )
        body = pybullet.createMultiBody(
            0.0, shape, basePosition=(plane.normal * plane.offset).tolist(), physicsClientId=client
        )
        # Bullet multiplies the coefficients of two bodies: ones here leave the ball's own.
        pybullet.changeDynamics(
            body,
            -1,
            lateralFriction=1.0,
            rollingFriction=0.0,
            spinningFriction=0.0,
            restitution=1.0,
            contactProcessingThreshold=0.0,
            physicsClientId=client,
        )


def _add_ball(
    pybullet: ModuleType,
    client: int,
    radius: float,
    mass: float,
    contact: BallContact,
    start: ObjectState,
) -> int:
    shape = pybullet.createCollisionShape(
        pybullet.GEOM_SPHERE, radius=radius, physicsClientId=client
    )
    ball = pybullet.createMultiBody(
        mass, shape, basePosition=start.position.tolist(), physicsClientId=client
    )
    pybullet.changeDynamics(
        ball,
        -1,
        lateralFriction=contact.friction,
        # Bullet's rolling friction is an arm in metres.
        rollingFriction=contact.rolling_friction * radius,
        spinningFriction=0.0,
        restitution=contact.restitution,
        linearDamping=0.0,
        angularDamping=0.0,
        contactProcessingThreshold=0.0,
        activationState=pybullet.ACTIVATION_STATE_DISABLE_SLEEPING,
        physicsClientId=client,
    )
    pybullet.resetBaseVelocity(
        ball,
        start.linear_velocity.tolist(),
        start.angular_velocity.tolist(),
        physicsClientId=client,
    )
    return ball
