"""Engines, bodies and scenes that the tests of the laws share."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from intuitive_physics.geometry.rotations import rotation_matrix
from intuitive_physics.materials import StaticParameters
from intuitive_physics.scene import Environment, Plane, Scene, SceneObject, StaticBox
from intuitive_physics.shapes import Capsule, Shape
from intuitive_physics.simulation import Simulator
from intuitive_physics.state import ObjectState

G = 9.81
UPRIGHT = (0.0, 0.0, 0.0, 1.0)
LYING_ALONG_X = (0.0, np.sqrt(0.5), 0.0, np.sqrt(0.5))
LYING_ALONG_Y = (np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5))
FLOOR = (0.0, 0.0, 1.0, 0.0)
ROUNDING = 1e-9
"""m. What rounding may grow to over some hundred events or steps."""


@dataclass(frozen=True)
class Engine:
    """An engine at the step it is tried at, and what its method owes.

    Parameters
    ----------
    step : s, over which contact forces are held constant; 0 where they act in closed form
    flight_step : s, over which gravity is held constant; 0 where free flight is exact
    delay : s, by which an impact may come late
    gap : m, to which a touching pair is told from a parted one
    rest_speed : m/s, of the rebound below which an object stays on the ground
    sweep_rest : part of what gravity does in a step that sweeps over the contacts may leave
    """

    name: str
    step: float
    flight_step: float
    delay: float
    gap: float
    rest_speed: float
    sweep_rest: float

    def __str__(self) -> str:
        return self.name

    @property
    def simulator(self) -> Simulator:
        return _simulator(self.name, self.step)

    def path(self, scene: Scene, theta: StaticParameters, times) -> np.ndarray:
        """Positions, shape (n_objects, n_times, 3)."""
        return self.poses(scene, theta, times)[0]

    def poses(self, scene: Scene, theta: StaticParameters, times):
        """Positions (n_objects, n_times, 3) and orientations (n_objects, n_times, 4)."""
        rollout = self.simulator.rollout([scene], theta, np.asarray(times, dtype=float))
        assert rollout.status[0] == 0
        return rollout.positions[0], rollout.orientations[0]

    def motion(self, scene: Scene, theta: StaticParameters, t: float, gap: float = 0.01) -> Motion:
        """Motion in the middle of [t, t + gap], during which there must be no contact."""
        x, q = self.poses(scene, theta, [t, t + gap])
        return motion_between(x, q, gap)


@lru_cache
def _simulator(name: str, step: float) -> Simulator:
    if name == "event_driven":
        from intuitive_physics.simulation.core.engines import EventDrivenSimulator

        return EventDrivenSimulator()
    if name == "stepped":
        from intuitive_physics.simulation.core.engines import SteppedSimulator

        return SteppedSimulator(time_step=step)
    from intuitive_physics.simulation.bullet import BulletSimulator

    return BulletSimulator(time_step=step)


# A rebound of event_driven below 5 mm/s is none. That of stepped is lost where gravity would bring
# it back within two steps or so. Bullet sees an impact at the end of its step only, and a box or
# capsule by points that it finds one after the other: these move it by a millimetre.
EVENT_DRIVEN = Engine("event_driven", 0.0, 0.0, 0.0, ROUNDING, 5e-3, 0.0)
STEPPED = Engine("stepped", 0.01, 0.0, 0.0, 1e-5, 2 * G * 0.01, 1e-4)
BULLET = Engine("bullet", 1e-3, 1e-3, 1e-3, 1e-3, 0.0, 1e-4)


def stepped_at(step: float) -> Engine:
    """The stepped engine at another step."""
    return Engine("stepped", step, 0.0, 0.0, 1e-5, 2 * G * step, 1e-4)


def engines(*chosen: Engine):
    """Try a test on each of the engines, or on all three."""
    return pytest.mark.parametrize("engine", chosen or (EVENT_DRIVEN, STEPPED, BULLET), ids=str)


@dataclass(frozen=True)
class Body:
    """An object and its initial state."""

    shape: Shape
    position: tuple[float, ...] | np.ndarray
    orientation: tuple[float, ...] | np.ndarray = UPRIGHT
    velocity: tuple[float, ...] | np.ndarray = (0.0, 0.0, 0.0)
    spin: tuple[float, ...] | np.ndarray = (0.0, 0.0, 0.0)
    air: dict[str, float] = field(default_factory=dict)


def make_scene(*bodies: Body, planes=(FLOOR,), boxes=(), gravity=(0, 0, -G), air_density=1.2):
    """Scene of bodies among planes (normal and offset, or `Plane`) and static boxes.

    Each static box is its centre, its edge lengths and, if it is turned, its orientation.
    """
    environment = Environment(
        [
            p if isinstance(p, Plane) else Plane(f"plane_{k}", "ground", p[:3], p[3])
            for k, p in enumerate(planes)
        ],
        [
            StaticBox(f"box_{k}", "ground", b[0], b[2] if len(b) > 2 else UPRIGHT, b[1])
            for k, b in enumerate(boxes)
        ],
        gravity=gravity,
        air_density=air_density,
    )
    objects = [SceneObject(f"body_{k}", "body", b.shape, **b.air) for k, b in enumerate(bodies)]
    states = [ObjectState(b.position, b.orientation, b.velocity, b.spin) for b in bodies]
    return Scene(environment, tuple(objects), tuple(states))


def coefficients(mu=0.5, mu_s=None, mu_r=0.0, e=0.0, density=500.0) -> StaticParameters:
    """θ_s with the same values for all pairs; μ_s is μ_d unless it is given."""
    return StaticParameters.uniform(
        ["body", "ground"],
        density=density,
        static_friction=mu if mu_s is None else mu_s,
        dynamic_friction=mu,
        rolling_friction=mu_r,
        restitution=e,
    )


@dataclass(frozen=True)
class Motion:
    """Position, velocity (n, 3), orientation (n, 4), angular velocity (n, 3) of each object."""

    position: np.ndarray
    velocity: np.ndarray
    orientation: np.ndarray
    spin: np.ndarray

    def momentum(self, scene: Scene, theta: StaticParameters):
        """Linear momentum (3,) and angular momentum about the origin (3,)."""
        density = theta.density[theta.index("body")]
        linear, angular = np.zeros(3), np.zeros(3)
        for k, thing in enumerate(scene.objects):
            p = thing.shape.mass(density) * self.velocity[k]
            linear += p
            angular += np.cross(self.position[k], p) + self._own_angular(k, thing.shape, density)
        return linear, angular

    def energy(self, scene: Scene, theta: StaticParameters) -> float:
        """Kinetic and potential energy in J."""
        density = theta.density[theta.index("body")]
        energy = 0.0
        for k, thing in enumerate(scene.objects):
            mass = thing.shape.mass(density)
            energy += 0.5 * mass * self.velocity[k] @ self.velocity[k]
            energy -= mass * self.position[k] @ scene.environment.gravity
            energy += 0.5 * self.spin[k] @ self._own_angular(k, thing.shape, density)
        return energy

    def _own_angular(self, k: int, shape: Shape, density: float) -> np.ndarray:
        turn = rotation_matrix(self.orientation[k])
        return turn @ (shape.inertia(density) * (turn.T @ self.spin[k]))


def first_motion(scene: Scene) -> Motion:
    """Motion of the initial states."""
    rows = np.array([state.to_vector() for state in scene.states])
    return Motion(rows[:, 0:3], rows[:, 7:10], rows[:, 3:7], rows[:, 10:13])


def motion_between(positions, orientations, gap: float) -> Motion:
    """Motion in the middle of two times `gap` apart, exact for parabolas and steady turning."""
    q0, q1 = orientations[:, 0], orientations[:, 1]
    q1 = q1 * np.sign((q0 * q1).sum(axis=1, keepdims=True))
    middle = q0 + q1
    return Motion(
        positions.mean(axis=1),
        np.diff(positions, axis=1)[:, 0] / gap,
        middle / np.linalg.norm(middle, axis=1, keepdims=True),
        np.array(
            [
                rotation_vector(quaternion_product(b, inverse(a)))
                for a, b in zip(q0, q1, strict=True)
            ]
        )
        / gap,
    )


def quaternion_product(a, b) -> np.ndarray:
    """Rotation b, then a, both (x, y, z, w)."""
    return (Rotation.from_quat(a) * Rotation.from_quat(b)).as_quat()


def inverse(q) -> np.ndarray:
    """The rotation back."""
    return Rotation.from_quat(q).inv().as_quat()


def quaternion(rotation) -> np.ndarray:
    """Quaternion (x, y, z, w) of a rotation vector (3,) in rad."""
    return Rotation.from_rotvec(rotation).as_quat()


def rotation_vector(q) -> np.ndarray:
    """Rotation vector (3,) in rad of a quaternion (x, y, z, w), its angle at most π."""
    return Rotation.from_quat(q).as_rotvec()


def random_quaternion(rng: np.random.Generator) -> np.ndarray:
    """A rotation from the uniform distribution."""
    q = rng.normal(size=4)
    return q / np.linalg.norm(q)


def incline(slope: float) -> tuple[float, float, float, float]:
    """A plane through the origin that falls at `slope` rad towards +x."""
    return (np.sin(slope), 0.0, np.cos(slope), 0.0)


def on_incline(slope: float, height: float) -> np.ndarray:
    """Point `height` m from `incline`, above the origin's contact."""
    return height * np.array(incline(slope)[:3])


def downhill(slope: float) -> np.ndarray:
    """Unit vector down `incline`."""
    return np.array([np.cos(slope), 0.0, -np.sin(slope)])


def about_y(angle: float) -> np.ndarray:
    """Orientation turned about y; `slope` lays a body's z along the normal of `incline`."""
    return quaternion((0.0, angle, 0.0))


def roundness(shape: Shape) -> float:
    """k = I / (m r²) about the axis a sphere or lying capsule rolls about; 2/5 for a sphere."""
    axis = 2 if isinstance(shape, Capsule) else 0
    return shape.inertia(1.0)[axis] / (shape.mass(1.0) * shape.radius**2)


def lying(shape: Shape) -> tuple[float, ...]:
    """Orientation in which the shape rolls along x."""
    return LYING_ALONG_Y if isinstance(shape, Capsule) else UPRIGHT
