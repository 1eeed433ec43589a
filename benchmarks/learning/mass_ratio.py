"""The ratio of two masses, which collisions determine, in what the predictor draws.

Two balls of equal size and densities in a ratio of 4 collide on a table. Their motion does not
depend on either density by itself, only on the ratio.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from intuitive_physics.materials import StaticParameters
from intuitive_physics.observation import Observation, ObservedObject
from intuitive_physics.scene import Environment, Plane, Scene, SceneObject
from intuitive_physics.shapes import Sphere
from intuitive_physics.simulation import Simulator, make_simulator
from intuitive_physics.state import ObjectState
from intuitive_physics.trajectory import Trajectory
from intuitive_physics_learner import ConvergenceCriteria, LearningOptions, learn
from intuitive_physics_predictor.parameter_uncertainty import UncertainParameters

RATIO = 4.0
"""True ratio of the densities."""

RADIUS = 0.04
"""m, of both balls."""

TABLE = Environment([Plane("table", "table", [0.0, 0.0, 1.0], 0.0)])
"""Where they roll."""

TRUTH = (
    StaticParameters.uniform(
        ["heavy", "light", "table"],
        static_friction=0.3,
        dynamic_friction=0.25,
        rolling_friction=0.004,
        restitution=0.6,
    )
    .with_density("heavy", 2000.0)
    .with_density("light", 2000.0 / RATIO)
    .with_pair("heavy", "light", restitution=0.85)
)
"""θ_s that the collisions are simulated with."""

NOISE = 0.001
"""m, standard deviation of each observed coordinate."""

STATE_NOISE = 0.002
"""m, standard deviation of each coordinate of the observed initial positions; of velocities five
times as much per second."""

POINTS = 60
"""Observed points of each ball."""

INTERVAL = 1.0 / 60.0
"""s between two observed points."""

DRAWS = 4000
"""Draws of θ_s that the intervals are taken of."""


@dataclass(frozen=True)
class MassRatio:
    """Intervals from 5 to 95 % in what the predictor draws.

    Parameters
    ----------
    ratio : lower and upper end of the ratio of the densities
    heavy, light : of each density by itself, kg/m³
    learned : the ratio of the densities that were learned
    """

    ratio: tuple[float, float]
    heavy: tuple[float, float]
    light: tuple[float, float]
    learned: float


def measure_mass_ratio(
    seed: int = 0, collisions: int = 20, *, iterations: int = 4000, seconds: float | None = None
) -> MassRatio:
    """Learn from collisions by the default method and draw θ_s as the predictor does.

    Parameters
    ----------
    seed : of the collisions and the search
    collisions : number of observations
    iterations : evaluations of J at most
    seconds : that learning may take; None: as long as it takes
    """
    engine = make_simulator("auto")
    rng = np.random.default_rng(seed)
    observations = [_collision(engine, rng) for _ in range(collisions)]
    criteria = ConvergenceCriteria(max_iterations=iterations, time_limit=seconds)
    learned = learn(observations, engine, LearningOptions(criteria=criteria, seed=seed)).learned
    density, _ = UncertainParameters(learned).draw(DRAWS, np.random.default_rng(seed))
    heavy = learned.parameters.index("heavy")
    light = learned.parameters.index("light")
    estimate = learned.parameters.density[heavy] / learned.parameters.density[light]
    intervals = (
        np.quantile(values, [0.05, 0.95]).tolist()
        for values in (
            density[:, heavy] / density[:, light],
            density[:, heavy],
            density[:, light],
        )
    )
    return MassRatio(*((low, high) for low, high in intervals), float(estimate))


def _collision(engine: Simulator, rng: np.random.Generator) -> Observation:
    """Observe one ball that rolls against the other, either one as often."""
    names = ["heavy", "light"] if rng.random() < 0.5 else ["light", "heavy"]
    balls = tuple(SceneObject(name, name, Sphere(RADIUS)) for name in names)
    angle, speed = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.6, 1.5)
    along = np.array([np.cos(angle), np.sin(angle), 0.0])
    across = np.array([-along[1], along[0], 0.0])
    gap = rng.uniform(0.15, 0.25)
    target = np.array([0.0, 0.0, RADIUS])
    start = target - (2.0 * RADIUS + gap) * along + rng.uniform(-1.0, 1.0) * RADIUS * across
    velocity = speed * along
    # It rolls without slip.
    spin = np.cross([0.0, 0.0, 1.0], velocity) / RADIUS
    states = (
        ObjectState(start, linear_velocity=velocity, angular_velocity=spin),
        ObjectState(target),
    )
    times = INTERVAL * np.arange(1, POINTS + 1)
    rollout = engine.rollout([Scene(TABLE, balls, states)], TRUTH, times, orientations=False)
    covariance = np.diag(np.repeat([1.0, 0.0, 25.0, 25.0 / RADIUS**2], 3)) * STATE_NOISE**2
    observed = []
    for k, (ball, state) in enumerate(zip(balls, states, strict=True)):
        positions = rollout.positions[0, k] + rng.normal(0.0, NOISE, (POINTS, 3))
        seen = ObjectState(
            state.position + STATE_NOISE * rng.normal(size=3) * [1.0, 1.0, 0.0],
            linear_velocity=state.linear_velocity
            + 5.0 * STATE_NOISE * rng.normal(size=3) * [1.0, 1.0, 0.0],
            angular_velocity=state.angular_velocity,
            covariance=covariance,
        )
        observed.append(ObservedObject(ball, Trajectory(times, positions), seen))
    return Observation(TABLE, tuple(observed), 0.0, id=f"collision {rng.integers(2**32)}")
