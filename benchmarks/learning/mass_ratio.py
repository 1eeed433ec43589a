"""The ratio of two masses, which collisions determine, in what the predictor draws.

Two balls of equal size and densities in a ratio of 4 collide on a table. Their motion does not
depend on either density by itself, only on the ratio.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.command import Outcome, report_progress
from benchmarks.results.result import Column, Table
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.materials import StaticParameters
from intuitive_physics.observation import Observation, ObservedObject
from intuitive_physics.scene import Environment, Plane, Scene, SceneObject
from intuitive_physics.shapes import Sphere
from intuitive_physics.simulation import Simulator, make_simulator
from intuitive_physics.state import ObjectState
from intuitive_physics.trajectory import Trajectory
from intuitive_physics_learner import ConvergenceCriteria, LearningOptions, learn
from intuitive_physics_predictor.parameter_uncertainty import UncertainParameters

COLLISIONS, QUICK_COLLISIONS = 20, 6  # observations of each set
SETS, QUICK_SETS = 3, 1  # random sets
ITERATIONS = 4000  # largest number of evaluations of J
SECONDS = 10.0  # limit of wall time of learning one set, with its uncertainties
BAR = (3.6, 4.4)  # within which the interval from 5 to 95 % is to lie, issue 17
RATIO = 4.0  # true ratio of the densities
RADIUS = 0.04  # m, of both balls
TABLE = Environment([Plane("table", "table", [0.0, 0.0, 1.0], 0.0)])  # the table on which they roll
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

NOISE = 0.001  # m, standard deviation of each observed coordinate
# m, standard deviation of each coordinate of the observed initial positions; of velocities five
# times as much per second
STATE_NOISE = 0.002
TIMES = np.arange(1, 61) / 60.0  # s of the observed points of each ball
DRAWS = 4000  # draws of θ_s that the intervals are taken of
Interval = tuple[float, float]  # lower and upper end


@dataclass(frozen=True)
class MassRatio:
    """Intervals from 5 to 95 % in what the predictor draws after learning from collisions.

    They are of the ratio of the densities, of that in draws from the untouched defaults, and of
    each density by itself in kg/m³. `learned` is the ratio of the densities that were learned.
    """

    seed: int
    ratio: Interval
    default: Interval
    heavy: Interval
    light: Interval
    learned: float


def measure_mass_ratio(
    seed: int, collisions: int, *, iterations: int = ITERATIONS, seconds: float | None = None
) -> MassRatio:
    """Learn from collisions by the default method and draw θ_s as the predictor does."""
    engine = make_simulator("auto")
    rng = np.random.default_rng(seed)
    observations = [_collision(engine, rng) for _ in range(collisions)]
    criteria = ConvergenceCriteria(max_iterations=iterations, time_limit=seconds)
    learned = learn(observations, engine, LearningOptions(criteria=criteria, seed=seed)).learned
    densities = dict(zip(learned.materials, learned.parameters.density, strict=True))
    heavy, light = _drawn_densities(learned, seed)
    default_heavy, default_light = _drawn_densities(
        LearnedParameters.defaults(TRUTH.materials), seed
    )
    return MassRatio(
        seed,
        ratio=_inner_interval(heavy / light),
        default=_inner_interval(default_heavy / default_light),
        heavy=_inner_interval(heavy),
        light=_inner_interval(light),
        learned=float(densities["heavy"] / densities["light"]),
    )


def _drawn_densities(
    learned: LearnedParameters, seed: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return draws (DRAWS,) kg/m³ of both densities."""
    density, _ = UncertainParameters(learned).draw(DRAWS, np.random.default_rng(seed))
    index = learned.parameters.index
    return density[:, index("heavy")], density[:, index("light")]


def _inner_interval(values: NDArray[np.float64]) -> Interval:
    low, high = np.quantile(values, [0.05, 0.95])
    return float(low), float(high)


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
    rollout = engine.rollout([Scene(TABLE, balls, states)], TRUTH, TIMES, orientations=False)
    covariance = np.diag(np.repeat([1.0, 0.0, 25.0, 25.0 / RADIUS**2], 3)) * STATE_NOISE**2
    observed = []
    for k, (ball, state) in enumerate(zip(balls, states, strict=True)):
        positions = rollout.positions[0, k] + rng.normal(0.0, NOISE, (TIMES.size, 3))
        noisy = ObjectState(
            state.position + STATE_NOISE * rng.normal(size=3) * [1.0, 1.0, 0.0],
            linear_velocity=state.linear_velocity
            + 5.0 * STATE_NOISE * rng.normal(size=3) * [1.0, 1.0, 0.0],
            angular_velocity=state.angular_velocity,
            covariance=covariance,
        )
        observed.append(ObservedObject(ball, Trajectory(TIMES, positions), noisy))
    return Observation(TABLE, tuple(observed), 0.0, id=f"collision {rng.integers(2**32)}")


def measure(quick: bool, first_seed: int) -> Outcome:
    """Learn from collisions, and draw beside it from what the untouched defaults say."""
    sets, collisions = (QUICK_SETS, QUICK_COLLISIONS) if quick else (SETS, COLLISIONS)
    ratios = []
    for seed in range(first_seed, first_seed + sets):
        report_progress(f"mass ratio, seed {seed}")
        ratios.append(measure_mass_ratio(seed, collisions, seconds=SECONDS))
    low, high = np.mean([each.ratio for each in ratios], axis=0).tolist()
    complaints = []
    if not BAR[0] <= low <= high <= BAR[1]:
        complaints.append(f"mass_ratio_90: {low:.2f} to {high:.2f}, bar {BAR[0]:g} to {BAR[1]:g}")
    table = Table.of(
        f"Ratio of two densities in what the predictor draws; truth {RATIO:g}",
        ratios,
        [
            (Column("seed"), lambda r: r.seed),
            (Column("collisions"), lambda r: collisions),
            (Column("learned ratio", "", ".3f"), lambda r: r.learned),
            (Column("5 %", "", ".3f"), lambda r: r.ratio[0]),
            (Column("95 %", "", ".3f"), lambda r: r.ratio[1]),
            (Column("bar of both"), lambda r: f"{BAR[0]:g} to {BAR[1]:g}"),
            (Column("defaults' draws"), lambda r: f"{r.default[0]:.2g} to {r.default[1]:.2g}"),
            (
                Column("heavy one's density, kg/m³"),
                lambda r: f"{r.heavy[0]:.0f} to {r.heavy[1]:.0f}",
            ),
            (Column("light one's"), lambda r: f"{r.light[0]:.0f} to {r.light[1]:.0f}"),
        ],
        note=f"Quantiles of {DRAWS} draws. The key figure is the mean of the ends over the sets.",
    )
    figures = {"mass_ratio_90": [round(low, 3), round(high, 3)]}
    return Outcome([table], figures, complaints=complaints)
