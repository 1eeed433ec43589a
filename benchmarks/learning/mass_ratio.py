"""The ratio of two masses, which collisions determine, in what the predictor draws.

Two balls of equal size and densities in a ratio of 4 collide on a table. Their motion does not
depend on either density by itself, only on the ratio.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.command import report_progress
from benchmarks.learning.part import Findings, Part, Plan
from benchmarks.results.result import Cell, Column, Table
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
    return MassRatio(
        _inner_interval(density[:, heavy] / density[:, light]),
        _inner_interval(density[:, heavy]),
        _inner_interval(density[:, light]),
        float(estimate),
    )


def _inner_interval(values: NDArray[np.float64]) -> tuple[float, float]:
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


COLLISIONS, QUICK_COLLISIONS = 20, 6
"""Observations of each set."""

SETS, QUICK_SETS = 3, 1
"""Random sets."""

SECONDS = 10.0
"""Limit of wall time of learning one set, with its uncertainties."""

BAR = (3.6, 4.4)
"""Within which the interval from 5 to 95 % is to lie, issue 17."""


def measure(plan: Plan) -> Findings:
    """Learn from collisions, and draw beside it from what the untouched defaults say."""
    sets, collisions = (QUICK_SETS, QUICK_COLLISIONS) if plan.quick else (SETS, COLLISIONS)
    found: dict[int, MassRatio] = {}
    for seed in range(plan.first_seed, plan.first_seed + sets):
        report_progress(f"mass ratio, seed {seed}")
        found[seed] = measure_mass_ratio(seed, collisions, seconds=SECONDS)
    ends = np.mean([each.ratio for each in found.values()], axis=0)
    low, high = ends.tolist()
    complaints = []
    if not BAR[0] <= low <= high <= BAR[1]:
        complaints.append(f"mass_ratio_90: {low:.2f} to {high:.2f}, bar {BAR[0]:g} to {BAR[1]:g}")
    return Findings(
        tables=[_table(found, collisions)],
        figures={"mass_ratio_90": [round(low, 3), round(high, 3)]},
        complaints=complaints,
    )


def default_interval(seed: int) -> tuple[float, float]:
    """Interval of the ratio in draws from the untouched defaults, 5 to 95 %."""
    unlearned = UncertainParameters(LearnedParameters.defaults(TRUTH.materials))
    density, _ = unlearned.draw(DRAWS, np.random.default_rng(seed))
    heavy, light = TRUTH.index("heavy"), TRUTH.index("light")
    return _inner_interval(density[:, heavy] / density[:, light])


def _table(found: Mapping[int, MassRatio], collisions: int) -> Table:
    rows: list[list[Cell]] = []
    for seed, each in found.items():
        default = default_interval(seed)
        rows.append(
            [
                seed,
                collisions,
                each.learned,
                *each.ratio,
                f"{BAR[0]:g} to {BAR[1]:g}",
                f"{default[0]:.2g} to {default[1]:.2g}",
                f"{each.heavy[0]:.0f} to {each.heavy[1]:.0f}",
                f"{each.light[0]:.0f} to {each.light[1]:.0f}",
            ]
        )
    return Table(
        title=f"Ratio of two densities in what the predictor draws; truth {RATIO:g}",
        columns=[
            Column("seed"),
            Column("collisions"),
            Column("learned ratio", "", ".3f"),
            Column("5 %", "", ".3f"),
            Column("95 %", "", ".3f"),
            Column("bar of both"),
            Column("defaults' draws"),
            Column("heavy one's density, kg/m³"),
            Column("light one's"),
        ],
        rows=rows,
        note=f"Quantiles of {DRAWS} draws. The key figure is the mean of the ends over the sets.",
    )


MASS_RATIO = Part("mass_ratio", ("mass_ratio_90",), measure)
"""The part of the ratio of two masses."""
