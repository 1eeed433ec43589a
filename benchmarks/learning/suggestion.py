"""Throws needed to know parameters well enough: those that `suggest` names, or random ones.

In a world of its own per seed two balls of different materials can be thrown on a floor or against
a wall of another material. Asked are dynamic friction and restitution of one ball with one of the
surfaces, and rolling friction too if that is the floor. After each throw all throws so far are
fitted jointly with their initial states, as the learner's default method does; enough is known when
the standard deviation of each parameter, the largest by the slopes to either side, is at most
`PRECISION` and none is off by more than twice that. Both ways throw from the same ranges, with the
same errors of execution and the same noise of detections, and begin knowing nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.command import report_progress
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
    DesignSettings,
    Throw,
    ThrownObject,
    ThrowOptions,
    ThrowRanges,
    ViewingConditions,
    gaussian_covariance,
    suggest,
)
from intuitive_physics_learner.joint_estimation import JointEstimationSettings
from intuitive_physics_learner.joint_estimation.joint_fit import JointFit
from intuitive_physics_learner.search.learning_task import LearningTask

SURFACES = ("floor", "wall")
"""Materials of what is thrown against."""

BALLS = ("rubber", "wood")
"""Materials of what is thrown."""

KINDS = {
    "floor": ("dynamic_friction", "rolling_friction", "restitution"),
    "wall": ("dynamic_friction", "restitution"),
}
"""Asked of a ball with each surface; static friction matters to no ball that is thrown."""

TRUTH = {**TRUE_RANGES, "dynamic_friction": Bounds(0.1, 0.5)}
"""What θ_s is drawn from: as in the paper's sets, but for dynamic friction. On a rougher floor none
of the throws slides for longer than a few frames, so that no number of them would be enough."""

MOST_STEPS = 15
"""Of the joint fit after each throw: horizons advance by 0.2 s in one, and four of them scan."""

PRECISION = 0.03
"""Widths: largest standard deviation that is enough, 3 % of the bounds of each parameter."""

MOST_THROWS = 16
"""After which a run is given up, and counts as that number."""

NOISE = 0.002
"""m, standard deviation of a detection on each axis."""

STATE_DEVIATIONS = np.repeat([NOISE, 0.0, 0.05, 1.0], 3)
"""Of initial states as observed: m, rad, m/s, rad/s, three of each. The last is the spin that a
thrown ball has by accident and a camera does not see."""

RATE = 30.0
"""1/s, of the camera."""

DURATION = 1.5
"""s of a track at most."""

VIEW = np.array([[-1.5, 1.5], [-1.5, 1.5], [-0.1, 2.0]])
"""m, what the camera sees."""

RADIUS = 0.04
"""m, of the balls."""

RANGES = ThrowRanges(
    [[-1.0, 0.9], [-1.0, 1.0], [RADIUS, 1.0]], [[-2.0, 2.0], [-2.0, 2.0], [-1.0, 1.0]]
)
"""Of the throws."""

ENVIRONMENT = Environment(
    [Plane("floor", "floor", (0.0, 0.0, 1.0), 0.0), Plane("wall", "wall", (-1.0, 0.0, 0.0), -1.0)]
)
"""A floor z = 0 and a wall x = 1 m."""


@dataclass(frozen=True, eq=False)
class SuggestionResult:
    """Throws needed by both ways.

    Parameters
    ----------
    seeds : of the worlds
    suggested, random : throws needed in each world; `MOST_THROWS` where they were not enough
    exhausted : runs of each way, suggested first, in which they were not enough
    within_2_sigma : share of the asked parameters, at the end of all runs, whose truth lies within
        two stated standard deviations, suggested first
    """

    seeds: tuple[int, ...]
    suggested: tuple[int, ...]
    random: tuple[int, ...]
    exhausted: tuple[int, int]
    within_2_sigma: tuple[float, float]

    @property
    def suggested_over_random(self) -> float:
        """Median over the worlds of the throws needed when suggested, over those at random."""
        return float(np.median(np.divide(self.suggested, self.random)))


@dataclass(frozen=True, eq=False)
class _Run:
    """Throws of one way in one world, and the errors at the end in stated deviations."""

    throws: int
    enough: bool
    errors: list[float]


class _World:
    """True θ_s, what is asked, and all randomness of one seed."""

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
                (ThrownObject(SceneObject(name, name, Sphere(RADIUS)), RANGES, covariance),)
                for name in BALLS
            ),
        )
        times = np.arange(int(DURATION * RATE) + 1) / RATE
        self.viewing = ViewingConditions(times, NOISE, VIEW)

    def observe(self, throw: Throw, rng: np.random.Generator) -> Observation:
        """Make a throw, not quite as meant, and detect it."""
        error = DesignSettings().execution_error
        meant = throw.states[0]
        widths = throw.widths[0]
        position = meant.position + error * widths[0:3] * rng.standard_normal(3)
        position[2] = max(position[2], RADIUS)
        position[0] = min(position[0], 1.0 - RADIUS)
        velocity = meant.linear_velocity + error * widths[6:9] * rng.standard_normal(3)
        spin = STATE_DEVIATIONS[9:12] * rng.standard_normal(3)
        state = ObjectState(position, (0.0, 0.0, 0.0, 1.0), velocity, spin)
        (item,) = throw.scene.objects
        scene = Scene(throw.environment, (item,), (state,))
        positions = self.simulator.rollout([scene], self.truth, self.viewing.times).positions[0, 0]
        inside = ((positions >= VIEW[:, 0]) & (positions <= VIEW[:, 1])).all(axis=1)
        last = max(int(np.logical_and.accumulate(inside).sum()), 2)
        detections = positions[:last] + NOISE * rng.standard_normal((last, 3))
        seen = ObjectState(
            position + STATE_DEVIATIONS[0:3] * rng.standard_normal(3),
            (0.0, 0.0, 0.0, 1.0),
            velocity + STATE_DEVIATIONS[6:9] * rng.standard_normal(3),
            np.zeros(3),
            np.diag(STATE_DEVIATIONS**2),
        )
        track = Trajectory(self.viewing.times[:last], detections)
        return Observation(throw.environment, (ObservedObject(item, track, seen),), 0.0)

    @property
    def indices(self) -> list[int]:
        """Of what is asked among all parameters."""
        return self.asked.indices(ParameterSpace(self.options.materials).names)


def compare_throws(first_seed: int, worlds: int) -> SuggestionResult:
    """Run both ways in worlds of successive seeds.

    Parameters
    ----------
    first_seed : of the worlds; nothing was tuned on those from 2000 on
    worlds : number of them; each takes some 8 s of CPU time
    """
    simulator = make_simulator("auto", threads=1)
    seeds = tuple(range(first_seed, first_seed + worlds))
    suggested, random = [], []
    for number, seed in enumerate(seeds, 1):
        report_progress(f"suggested and random throws, world {number} of {worlds}")
        suggested.append(_run(_World(seed, simulator), suggested=True))
        random.append(_run(_World(seed, simulator), suggested=False))
    return SuggestionResult(
        seeds,
        tuple(run.throws for run in suggested),
        tuple(run.throws for run in random),
        (sum(not run.enough for run in suggested), sum(not run.enough for run in random)),
        (_within(suggested), _within(random)),
    )


def _within(runs: list[_Run]) -> float:
    """Share of errors of at most two stated standard deviations."""
    return float(np.mean([error <= 2.0 for run in runs for error in run.errors]))


def _run(world: _World, *, suggested: bool) -> _Run:
    """Throw until enough is known."""
    space = ParameterSpace(world.options.materials)
    posterior = LearnedParameters.defaults(space.materials).whole_posterior()
    observations: list[Observation] = []
    while True:
        observations.append(world.observe(_next_throw(world, posterior, suggested), world.rng))
        posterior = _fitted(observations, space, posterior.mean, world.simulator)
        deviations = np.sqrt(np.diag(gaussian_covariance(posterior)))[world.indices]
        errors = np.abs(posterior.mean - space.to_unit(world.truth))[world.indices]
        enough = bool(deviations.max() <= PRECISION and errors.max() <= 2.0 * PRECISION)
        if enough or len(observations) == MOST_THROWS:
            return _Run(len(observations), enough, list(errors / deviations))


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
    fit = JointFit(
        cost, task.searched, influence[:, task.active], task.prior, JointEstimationSettings()
    )
    while fit.steps < MOST_STEPS and not fit.settled:
        fit.step()
    unit = start.copy()
    unit[task.active] = fit.unit
    found, sided = fit.posterior()
    factors = sided / found.deviations
    information = np.linalg.inv(found.covariance * np.outer(factors, factors))
    information -= task.prior.precision
    whole = np.zeros((start.size, start.size))
    whole[np.ix_(task.active, task.active)] = information
    return ParameterPosterior.from_information(space.materials, unit, whole)
