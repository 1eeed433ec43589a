"""Throws needed to a given precision: those that `suggest` names, over random ones.

The world of a seed has two balls of different materials, which can be thrown on a floor or against
a wall of another material. The asked parameters are dynamic friction and restitution of one ball
with one of the surfaces, and rolling friction too if that is the floor. After each throw all throws
so far are fitted jointly with their initial states, as the learner's default method does; enough is
known when the standard deviation of each parameter, the largest by the slopes to either side, is at
most `PRECISION` and no error is more than twice that. Both ways throw from the same ranges, with
the same errors of execution and the same noise of detections, and begin knowing nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from benchmarks.command import Outcome, report_progress
from benchmarks.learning.paper_sets import side_by_side
from benchmarks.results.result import Column, Table
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.materials import StaticParameters
from intuitive_physics.observation import Observation, ObservedObject
from intuitive_physics.parameter_posterior import ParameterPosterior
from intuitive_physics.parameter_space import Bounds, ParameterSpace
from intuitive_physics.scene import Environment, Plane, Scene, SceneObject
from intuitive_physics.shapes import Sphere
from intuitive_physics.simulation import Simulator, make_simulator
from intuitive_physics.state import ObjectState
from intuitive_physics.trajectory import Trajectory
from intuitive_physics_experiments.paper.paper_room import TRUE_RANGES
from intuitive_physics_learner import TrajectoryCost
from intuitive_physics_learner.cost.parameter_influence import parameter_influence
from intuitive_physics_learner.design import (
    AboutParameters,
    Throw,
    ThrownObject,
    ThrowOptions,
    ViewingConditions,
    suggest,
)
from intuitive_physics_learner.design.suggestion import EXECUTION_ERROR
from intuitive_physics_learner.joint_estimation import JointEstimationSettings
from intuitive_physics_learner.joint_estimation.joint_fit import JointFit
from intuitive_physics_learner.joint_estimation.profiles import (
    UNIFORM,
    curvature_posterior,
    one_sided_moves,
)
from intuitive_physics_learner.search.gaussian import Gaussian
from intuitive_physics_learner.search.learning_task import LearningTask

WORLDS, QUICK_WORLDS = 8, 1  # random worlds
BAR = 0.6  # largest number of suggested throws over that of random ones, issue 17
SURFACES = ("floor", "wall")  # materials of the floor and the wall
BALLS = ("rubber", "wood")  # materials of the balls
KINDS = {
    "floor": ("dynamic_friction", "rolling_friction", "restitution"),
    "wall": ("dynamic_friction", "restitution"),
}
"""Asked parameters of a ball with each surface; static friction matters to no thrown ball."""

# Ranges of the true θ_s: as in the paper's sets, but for dynamic friction. On a rougher floor no
# throw slides for longer than a few frames, so that no number of throws would be enough.
TRUTH = {**TRUE_RANGES, "dynamic_friction": Bounds(0.1, 0.5)}
# Steps of the joint fit after each throw: a horizon advances by 0.2 s in one, and four scan
MOST_STEPS = 15
# Largest standard deviation that is enough, in widths of the bounds of each parameter
PRECISION = 0.03
MOST_THROWS = 16  # throws after which a run is given up, and counts as that number
NOISE = 0.002  # m, standard deviation of a detection on each axis
# Standard deviations of observed initial states: m, rad, m/s, rad/s, three of each. The last is
# the spin that a thrown ball has by accident and a camera does not see.
STATE_DEVIATIONS = np.repeat([NOISE, 0.0, 0.05, 1.0], 3)
RATE = 30.0  # 1/s, of the camera
DURATION = 1.5  # s of a track at most
VIEW = np.array([[-1.5, 1.5], [-1.5, 1.5], [-0.1, 2.0]])  # m, the space that the camera sees
RADIUS = 0.04  # m, of the balls
RANGES = (
    np.array([[-1.0, 0.9], [-1.0, 1.0], [RADIUS, 1.0]]),
    np.array([[-2.0, 2.0], [-2.0, 2.0], [-1.0, 1.0]]),
)
"""m and m/s, from which the throws are drawn."""

ENVIRONMENT = Environment(
    [Plane("floor", "floor", (0.0, 0.0, 1.0), 0.0), Plane("wall", "wall", (-1.0, 0.0, 0.0), -1.0)]
)
"""A floor z = 0 and a wall x = 1 m."""


@dataclass(frozen=True)
class Run:
    """Throws of one way in one world, and whether they were enough."""

    throws: int
    enough: bool

    def __str__(self) -> str:
        return str(self.throws) if self.enough else f"{self.throws}, not enough"


@dataclass(frozen=True)
class Comparison:
    """Runs of both ways in the world of a seed."""

    seed: int
    suggested: Run
    random: Run


class _World:
    """True θ_s, the asked parameters, and all randomness of one seed."""

    def __init__(self, seed: int, simulator: Simulator) -> None:
        self.simulator = simulator
        self.rng = np.random.default_rng(seed)
        space = ParameterSpace((*BALLS, *SURFACES), TRUTH)
        self.truth: StaticParameters = space.to_parameters(self.rng.random(space.size))
        ball, surface = self.rng.choice(BALLS), self.rng.choice(SURFACES)
        names = tuple(f"{kind}[{ball}, {surface}]" for kind in KINDS[surface])
        self.asked = AboutParameters(names, PRECISION)
        covariance = np.diag(STATE_DEVIATIONS**2)
        self.options = ThrowOptions(
            ENVIRONMENT,
            tuple(
                (
                    ThrownObject(
                        SceneObject(name, name, Sphere(RADIUS)), *RANGES, covariance=covariance
                    ),
                )
                for name in BALLS
            ),
        )
        times = np.arange(int(DURATION * RATE) + 1) / RATE
        self.viewing = ViewingConditions(times, NOISE, VIEW)

    def observe(self, throw: Throw, rng: np.random.Generator) -> Observation:
        """Make a throw, with errors of execution, and detect it."""
        meant = throw.states[0]
        widths = throw.widths[0]
        position = meant.position + EXECUTION_ERROR * widths[0:3] * rng.standard_normal(3)
        position[2] = max(position[2], RADIUS)
        position[0] = min(position[0], 1.0 - RADIUS)
        velocity = meant.linear_velocity + EXECUTION_ERROR * widths[6:9] * rng.standard_normal(3)
        spin = STATE_DEVIATIONS[9:12] * rng.standard_normal(3)
        state = ObjectState(position, (0.0, 0.0, 0.0, 1.0), velocity, spin)
        (item,) = throw.scene.objects
        scene = Scene(throw.environment, (item,), (state,))
        positions = self.simulator.rollout([scene], self.truth, self.viewing.times).positions[0, 0]
        inside = ((positions >= VIEW[:, 0]) & (positions <= VIEW[:, 1])).all(axis=1)
        last = max(int(np.logical_and.accumulate(inside).sum()), 2)
        detections = positions[:last] + NOISE * rng.standard_normal((last, 3))
        observed = ObjectState(
            position + STATE_DEVIATIONS[0:3] * rng.standard_normal(3),
            (0.0, 0.0, 0.0, 1.0),
            velocity + STATE_DEVIATIONS[6:9] * rng.standard_normal(3),
            np.zeros(3),
            np.diag(STATE_DEVIATIONS**2),
        )
        track = Trajectory(self.viewing.times[:last], detections)
        return Observation(throw.environment, (ObservedObject(item, track, observed),), 0.0)

    @property
    def indices(self) -> list[int]:
        """Indices of the asked ones among all parameters."""
        return self.asked.indices(ParameterSpace(self.options.materials).names)


def compare_throws(seed: int) -> Comparison:
    """Run both ways in one world; nothing was tuned on seeds from 2000 on."""
    simulator = make_simulator("auto", threads=1)
    return Comparison(
        seed,
        suggested=_run(_World(seed, simulator), suggested=True),
        random=_run(_World(seed, simulator), suggested=False),
    )


def _run(world: _World, *, suggested: bool) -> Run:
    """Throw until enough is known."""
    space = ParameterSpace(world.options.materials)
    posterior = LearnedParameters.defaults(space.materials).whole_posterior()
    observations: list[Observation] = []
    while True:
        observations.append(world.observe(_next_throw(world, posterior, suggested), world.rng))
        posterior = _fitted(observations, space, posterior.mean, world.simulator)
        deviations = Gaussian.of(posterior, bounded=True).deviations[world.indices]
        errors = np.abs(posterior.mean - space.to_unit(world.truth))[world.indices]
        enough = bool(deviations.max() <= PRECISION and errors.max() <= 2.0 * PRECISION)
        if enough or len(observations) == MOST_THROWS:
            return Run(len(observations), enough)


def _next_throw(world: _World, posterior: ParameterPosterior, suggested: bool) -> Throw:
    if suggested:
        (best,) = suggest(
            world.options, posterior, world.asked, world.viewing, world.simulator, world.rng
        )
        return best.throw
    drawn = world.options.draw(len(BALLS), world.rng)
    return drawn[world.rng.integers(len(drawn))]


def _fitted(
    observations: list[Observation],
    space: ParameterSpace,
    start: NDArray[np.float64],
    simulator: Simulator,
) -> ParameterPosterior:
    """Fit all observations from a start (n,) on the unit cube."""
    cost = TrajectoryCost(observations, simulator, space.materials)
    influence = parameter_influence(observations, space.materials)
    task = LearningTask(cost, space, influence, space.to_parameters(start))
    fit = JointFit(task.fit_task, JointEstimationSettings())
    while fit.steps < MOST_STEPS and not fit.settled:
        fit.step()
    unit = start.copy()
    unit[task.active] = fit.unit
    posterior = curvature_posterior(fit)
    free, ends = one_sided_moves(fit, posterior.deviations)
    # What is known to one side only counts as uniform over its interval.
    factors = np.maximum(ends, 0.5 * free.sum(axis=1) / UNIFORM) / posterior.deviations
    information = np.linalg.inv(posterior.covariance * np.outer(factors, factors))
    information -= task.prior.precision
    whole = np.zeros((start.size, start.size))
    whole[np.ix_(task.active, task.active)] = information
    return ParameterPosterior.from_information(space.materials, unit, whole)


def measure(quick: bool, first_seed: int) -> Outcome:
    """Compare in all worlds, several at a time."""
    worlds = QUICK_WORLDS if quick else WORLDS
    report_progress(f"suggested and random throws in {worlds} worlds")
    seeds = range(first_seed, first_seed + worlds)
    comparisons = side_by_side([partial(compare_throws, seed) for seed in seeds])
    ratio = _ratio_of_means(comparisons)
    return Outcome(
        tables=[_table(comparisons)],
        key_figures={"suggested_over_random": round(ratio, 3)},
        complaints=[f"suggested_over_random: {ratio:.2f}, bar {BAR:g}"] if ratio > BAR else [],
    )


def _ratio_of_means(comparisons: Sequence[Comparison]) -> float:
    """Return the mean number of suggested throws over that of random ones."""
    suggested = np.mean([each.suggested.throws for each in comparisons])
    return float(suggested / np.mean([each.random.throws for each in comparisons]))


def _ratio(comparison: Comparison) -> float:
    return comparison.suggested.throws / comparison.random.throws


def _table(comparisons: Sequence[Comparison]) -> Table:
    return Table.of(
        f"Throws until parameters are known to {PRECISION:.0%} of their bounds",
        comparisons,
        [
            (Column("seed"), lambda c: c.seed),
            (Column("suggested throws"), lambda c: str(c.suggested)),
            (Column("random throws"), lambda c: str(c.random)),
            (Column("ratio", "", ".2f"), _ratio),
            (Column("bar of the means' ratio", "", "g"), lambda c: BAR),
        ],
        note=(
            f"A run is given up after {MOST_THROWS} throws and counts as that number. The defaults "
            "know nothing to that precision however many throws there are."
        ),
        remarks=[
            f"ratio of the means over {len(comparisons)} worlds "
            f"{_ratio_of_means(comparisons):.2f}, median of the ratios "
            f"{np.median([_ratio(each) for each in comparisons]):.2f}"
        ],
    )
