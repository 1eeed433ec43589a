"""Motion of a ball among planes by PyBullet at a tiny step: the truth behind rendered bags.

It is an engine other than those that learn, so that learning is not a look in the mirror.

Where its motion is the truth that coefficients are held against, it must do what they mean. Three
things it does by itself are something else, and `Fidelity` mends them:

- Bullet finds an impact when the ball has gone in by a depth d, answers the approach u there, with
  gravity's next step, by e u, and the ball climbs back by d. Over depths from 0 to u h, with a step
  of h, it leaves the surface (1 + 2 e - 1/e) g h / 2 faster on average than e times its arrival: at
  2 m/s, 1/4800 s and 0.75 restitution seems 0.0006 larger. A smaller step mends it.
- Its rolling friction also acts on a contact that slips, where spin then grows as by μ_d - μ_r. By
  the contact laws it needs a contact that sticks.
- A ball's spin about the normal meets a resistance of its own in Bullet, here none. By the contact
  laws a ball that lies on a surface feels the torque of rolling friction there as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial, reduce
from math import sqrt

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.scene import Environment
from intuitive_physics.simulation.bullet.client import Client
from intuitive_physics.state import ObjectState
from intuitive_physics.validation import positive_float

STEP = 1.0 / 4800.0  # s; a whole number of steps lies between the samples of 60, 120 and 240 Hz


@dataclass(frozen=True)
class BallContact:
    """Contact coefficients of a ball with every plane."""

    friction: float  # μ_s = μ_d, dimensionless
    rolling_friction: float  # μ_r, dimensionless (torque at most μ_r · radius · normal force)
    restitution: float  # e


@dataclass(frozen=True)
class Fidelity:
    """Closeness of a motion to the contact laws that define its coefficients."""

    step: float = STEP  # s, of Bullet; a whole number of steps lies between samples
    # whether rolling friction acts as the contact laws have it, on contacts that stick and on the
    # spin about the normal, or as Bullet has it
    grip: bool = False


AS_BULLET_HAS_IT = Fidelity()  # For what only has to look like thrown balls

# For a truth that learned coefficients are held against. Eight throws tell restitution to 1e-4; at
# a twentieth of the usual step it seems larger by 1e-4 m/s over the approach at most.
CONTACT_LAWS = Fidelity(step=1.0 / 96000.0, grip=True)

# m/s. A ball that approaches its support more slowly lies on it: Bullet's contacts tremble, with
# the speed that gravity gives in a step or two, 2e-4 to 4e-3 m/s.
SOFT_APPROACH = 5e-3

# Steps for which a ball that lies on a plane is left to itself: slip that begins or ends in between
# is noticed up to 0.16 ms late at the step of `CONTACT_LAWS`, in which gravity changes a speed by
# 1.6 mm/s, and rolling friction by a tenth of that at most.
LYING_STEPS = 16


@dataclass(frozen=True, eq=False)
class BallMotion:
    """Sampled motion of a ball, all in the environment's frame."""

    times: NDArray[np.float64]  # (n,) s after the initial state
    positions: NDArray[np.float64]  # (n, 3) m
    velocities: NDArray[np.float64]  # (n, 3) m/s
    angular_velocities: NDArray[np.float64]  # (n, 3) rad/s

    def orientation_at(self, time: float) -> NDArray[np.float64]:
        """Return the rotation (3, 3) since the initial state, at a time in s after it.

        Between two samples the ball turns with the angular velocity of the first of them.
        """
        durations = np.clip(time - self.times[:-1], 0.0, np.diff(self.times))
        turns = Rotation.from_rotvec(durations[:, None] * self.angular_velocities[:-1])
        return reduce(lambda before, turn: turn @ before, turns.as_matrix(), np.eye(3))


def move_ball(
    environment: Environment,
    radius: float,
    density: float,
    contact: BallContact,
    start: ObjectState,
    duration: float,
    sample_rate: int = 120,
    fidelity: Fidelity = AS_BULLET_HAS_IT,
) -> BallMotion:
    """Simulate one ball of a radius in m and a density in kg/m³ for a duration in s.

    Planes are unbounded, boxes are not supported. A whole number of steps lies between samples,
    `sample_rate` of them in a second.
    """
    if environment.boxes:
        raise InvalidInputError(f"environment has {len(environment.boxes)} boxes; expected none")
    step_rate = round(1.0 / positive_float(fidelity.step, "step"))
    stride, rest = divmod(step_rate, sample_rate)
    if rest or not stride:
        raise InvalidInputError(
            f"sample rate is {sample_rate} Hz; expected a divisor of {step_rate} Hz, that of steps"
        )
    samples = int(np.floor(positive_float(duration, "duration") * sample_rate + 1e-9)) + 1
    rows = np.empty((samples, 9))
    with Client() as engine:
        _set_up_world(engine, environment, fidelity.step)
        mass = density * 4.0 / 3.0 * np.pi * radius**3
        ball = _add_ball(engine, radius, mass, contact, start)
        grip = None
        if fidelity.grip:
            grip = _Grip(engine, ball, environment, radius, contact, fidelity.step)
        step = engine.stepSimulation
        for row in rows:
            row[:3] = engine.getBasePositionAndOrientation(ball)[0]
            row[3:] = np.concatenate(engine.getBaseVelocity(ball))
            left = stride
            while left:
                count = left if grip is None else min(left, grip.prepare())
                for _ in range(count):
                    step()
                left -= count
    return BallMotion(np.arange(samples) / sample_rate, rows[:, :3], rows[:, 3:6], rows[:, 6:])


class _Grip:
    """Gives a ball rolling friction in the steps in which the contact laws have it.

    A contact sticks where friction can take all its slip s: 2/7 m |s| ≤ μ J_n, with the normal
    impulse J_n of an impact, m (1 + e) u, or of the weight, m g_n h.
    """

    def __init__(
        self,
        engine: Client,
        ball: int,
        environment: Environment,
        radius: float,
        contact: BallContact,
        step: float,
    ) -> None:
        self._pose = partial(engine.getBasePositionAndOrientation, ball)
        self._velocity = partial(engine.getBaseVelocity, ball)
        self._change = partial(engine.changeDynamics, ball, -1)
        self._gravity = environment.gravity.tolist()
        self._pull = sqrt(_dot(self._gravity, self._gravity))
        self._planes = [(plane.normal.tolist(), plane.offset) for plane in environment.planes]
        self._radius, self._contact, self._step = radius, contact, step
        self._arms: tuple[float, float] | None = None

    def prepare(self) -> int:
        """Set the ball's rolling friction; return for how many steps, at least 1, it is right."""
        (position, _), (velocity, spin) = self._pose(), self._velocity()
        speed = sqrt(_dot(velocity, velocity)) + self._pull * self._step
        sticks, lies, hits, touches, alone = True, False, False, False, 1.0
        for normal, offset in self._planes:
            gap = max(_dot(normal, position) - offset - self._radius, 0.0)
            # It cannot fall through the gap sooner.
            fall = 2.0 * gap / (speed + sqrt(speed**2 + 2.0 * self._pull * gap))
            if fall > 2.0 * self._step:
                alone = min(alone, fall)
            else:
                touches = True
                approach = -_dot(normal, velocity)
                weight = -_dot(normal, self._gravity) * self._step
                impulse = (1.0 + self._contact.restitution) * max(approach, 0.0) + max(weight, 0.0)
                slip = 2.0 / 7.0 * self._slip(normal, velocity, spin)
                sticks &= slip <= self._contact.friction * impulse
                lies |= weight > 0.0
                hits |= approach > SOFT_APPROACH
        rests = lies and not hits
        self._resist(sticks, rests)
        if touches:
            alone = min(alone, (LYING_STEPS + 1) * self._step) if rests else 0.0
        return max(1, int(alone / self._step) - 1)

    def _slip(
        self, normal: Sequence[float], velocity: Sequence[float], spin: Sequence[float]
    ) -> float:
        """Speed in m/s of the ball's surface along a plane it touches: |v_t - r ω × n|."""
        approach = -_dot(normal, velocity)
        turning = (
            spin[1] * normal[2] - spin[2] * normal[1],
            spin[2] * normal[0] - spin[0] * normal[2],
            spin[0] * normal[1] - spin[1] * normal[0],
        )
        slip = [velocity[k] + approach * normal[k] - self._radius * turning[k] for k in range(3)]
        return sqrt(_dot(slip, slip))

    def _resist(self, sticks: bool, lies: bool) -> None:
        """Set the arms in m of the torques against rolling, and against spin about the normal."""
        arm = self._contact.rolling_friction * self._radius
        arms = arm if sticks else 0.0, arm if lies else 0.0
        if arms != self._arms:
            self._arms = arms
            self._change(rollingFriction=arms[0], spinningFriction=arms[1])


def _dot(a: Sequence[float], b: Sequence[float]) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _set_up_world(engine: Client, environment: Environment, step: float) -> None:
    engine.setGravity(*environment.gravity)
    # Restitution is exact only if impulses act while the bodies touch, and never before: Bullet
    # subtracts the remaining gap (or the slop) over the step from the rebound speed. So contacts
    # count from distance 0 (`contactProcessingThreshold` below), the slop is 0, and penetration,
    # at most one step deep, is not pushed out, which would add energy.
    engine.setPhysicsEngineParameter(
        fixedTimeStep=step,
        numSolverIterations=50,
        numSubSteps=0,
        restitutionVelocityThreshold=0.0,
        warmStartingFactor=0.0,
        contactSlop=0.0,
        contactERP=0.0,
        deterministicOverlappingPairs=1,
    )
    for plane in environment.planes:
        shape = engine.createCollisionShape(engine.GEOM_PLANE, planeNormal=plane.normal.tolist())
        place = (plane.normal * plane.offset).tolist()
        body = engine.createMultiBody(0.0, shape, basePosition=place)
        # Bullet multiplies the coefficients of two bodies: ones here leave the ball's own.
        engine.changeDynamics(
            body,
            -1,
            lateralFriction=1.0,
            rollingFriction=0.0,
            spinningFriction=0.0,
            restitution=1.0,
            contactProcessingThreshold=0.0,
        )


def _add_ball(
    engine: Client, radius: float, mass: float, contact: BallContact, start: ObjectState
) -> int:
    shape = engine.createCollisionShape(engine.GEOM_SPHERE, radius=radius)
    ball = engine.createMultiBody(mass, shape, basePosition=start.position.tolist())
    engine.changeDynamics(
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
        activationState=engine.ACTIVATION_STATE_DISABLE_SLEEPING,
    )
    velocity, spin = start.linear_velocity.tolist(), start.angular_velocity.tolist()
    engine.resetBaseVelocity(ball, velocity, spin)
    return int(ball)
