"""The calibration on the paper's synthetic set: learn, fit the noise, predict what was held out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.materials import StaticParameters
from intuitive_physics.observation import Observation, ObservedObject
from intuitive_physics.scene import Environment, Scene
from intuitive_physics.simulation import Simulator, make_simulator
from intuitive_physics.state import ObjectState
from intuitive_physics_experiments.calibration.calibrate import (
    OURS,
    Calibration,
    Scores,
    calibrate,
    score,
)
from intuitive_physics_experiments.calibration.options import HORIZONS, CalibrationOptions
from intuitive_physics_experiments.flight_fits import (
    FEWEST_POINTS,
    fit_noisy_flight,
    flight_length,
    with_known_rotation,
)
from intuitive_physics_experiments.paper.paper_dataset import (
    POSITION_NOISE,
    PaperRun,
    make_paper_dataset,
)
from intuitive_physics_experiments.paper.paper_room import SHAPE_KINDS
from intuitive_physics_learner.learning_session import LearningOptions, learn
from intuitive_physics_learner.methods import JOINT_METHOD
from intuitive_physics_learner.search.parameter_search import ConvergenceCriteria, SearchProgress
from intuitive_physics_predictor.noise_scales import NoiseScales
from intuitive_physics_predictor.scores.outcomes import Outcome, noisy_prediction

# Standard deviations of a point by which an object may be nearer to something than it seems.
MARGIN = 3.0


def with_first_points(observation: Observation, points: int, noise: float) -> Observation:
    """Return an observation whose initial states are fitted to its first points."""
    states = initial_states(observation, points, noise)
    return replace(
        observation,
        objects=tuple(
            ObservedObject(observed.object, observed.trajectory, state)
            for observed, state in zip(observation.objects, states, strict=True)
        ),
    )


def initial_states(observation: Observation, points: int, noise: float) -> list[ObjectState]:
    """Fit free flight to each object's first points; orientation and spin are as observed.

    Points, at least 3 of each object, have noise of a standard deviation in m on each axis. A point
    does not count, at the latest, where the object's bounding sphere has come near a plane or
    another object's: a gentle touch bends a path by less than noise, and points after it would be
    taken for flight. The first three always count.
    """
    gravity = observation.environment.gravity
    states = []
    for observed in observation.objects:
        near = _near_something(
            observed, observation.objects, observation.environment, points, noise
        )
        free = max(int(near.argmax()) if near.any() else len(near), FEWEST_POINTS)
        times, positions = observed.trajectory.times[:free], observed.trajectory.positions[:free]
        count = flight_length(times, positions, gravity, noise)
        position, velocity, covariance = fit_noisy_flight(
            times[:count], positions[:count], gravity, noise
        )
        states.append(with_known_rotation(observed.initial_state, position, velocity, covariance))
    return states


def _near_something(
    observed: ObservedObject,
    objects: Sequence[ObservedObject],
    environment: Environment,
    points: int,
    noise: float,
) -> NDArray[np.bool_]:
    """Whether an object may touch a plane or another object at each of its first points."""
    times, positions = observed.trajectory.times[:points], observed.trajectory.positions[:points]
    radius = observed.object.shape.bounding_radius
    near = np.zeros(len(times), dtype=bool)
    for plane in environment.planes:
        near |= plane.signed_distances(positions) < radius + MARGIN * noise
    for other in objects:
        if other is not observed:
            track = other.trajectory
            there = np.column_stack([np.interp(times, track.times, x) for x in track.positions.T])
            reach = radius + other.object.shape.bounding_radius + MARGIN * np.sqrt(2.0) * noise
            near |= np.linalg.norm(positions - there, axis=1) < reach
    return near


def paper_outcomes(
    runs: Sequence[PaperRun],
    parameters: StaticParameters,
    simulator: Simulator,
    points: int,
    horizons: Sequence[float] = HORIZONS,
    rng: np.random.Generator | None = None,
    ahead_of: int | None = None,
) -> list[Outcome]:
    """Return each run as seen for its first points (at least 3), and what then truly happened.

    The state is fitted to those points before the first contact; `parameters` are the true θ_s and
    `simulator` the engine that moved the objects. Horizons are s after the last of these points, or
    after point `ahead_of`, so that predictions from more and from fewer points are of the same
    instants. With `rng` the outcome has the noise with which a learner sees it.
    """
    last = points if ahead_of is None else ahead_of
    if last < points:
        raise InvalidInputError(
            f"horizons count from point {last} and {points} points are seen; expected them to "
            "count from the last one that is seen, or a later one"
        )
    outcomes = [
        _outcome(run, parameters, simulator, points, last, np.array(horizons)) for run in runs
    ]
    return outcomes if rng is None else [_seen(outcome, rng) for outcome in outcomes]


def _outcome(
    run: PaperRun,
    parameters: StaticParameters,
    simulator: Simulator,
    points: int,
    last: int,
    horizons: NDArray[np.float64],
) -> Outcome:
    states = initial_states(run.observation, points, POSITION_NOISE)
    after = run.observation.objects[0].trajectory.times[last - 1] + horizons
    truth = simulator.rollout([run.scene], parameters, after, orientations=False).positions[0]
    return Outcome(Scene(run.scene.environment, run.scene.objects, tuple(states)), after, truth)


def _seen(outcome: Outcome, rng: np.random.Generator) -> Outcome:
    noise = rng.normal(0.0, POSITION_NOISE, outcome.positions.shape)
    covariances = np.broadcast_to(POSITION_NOISE**2 * np.eye(3), (*noise.shape, 3))
    return Outcome(outcome.scene, outcome.times, outcome.positions + noise, covariances)


# Share of the runs that are not held out: θ_s is learned from these, the noise fitted to the
# others.
LEARNED_SHARE = 0.6

LEARNED_POINTS = 30  # Points, at most, that initial states of what is learned from are fitted to

# Scales of θ_s. Positions have the noise that initial states are fitted with, so their covariances
# are right as they are, and a scale of them could only be chance.
FITTED_SCALES = ("static_parameters", "unidentified")

# Where the noise fit begins. Joint estimation fits whole trajectories and keeps near its start what
# they do not depend on, and throws of the same objects in the same room depend on it as little:
# values from all over the bounds would only spread what is known.
START = NoiseScales(unidentified=0.2)


@dataclass(frozen=True, eq=False)
class PaperCalibration:
    """Result of a calibration on the synthetic set."""

    calibration: Calibration  # of predictions from `points` points
    learned: LearnedParameters  # θ_s
    # scores of ours by how many points were seen, all at the same instants: horizons count from the
    # last of the most points
    by_points: dict[int, Scores]

    def summary(self) -> dict[str, Any]:
        """Return coverage of the 90 % regions by horizon, and our score against the baselines'.

        The ratios are the largest of all horizons. Where `energy_score_vs_best_baseline` is below
        1, ours is better than every baseline at every horizon.
        """
        result = self.calibration
        covered = result.scores[OURS].coverage(0.9)
        return {
            "coverage_90": {
                f"{horizon:g}": round(float(share), 4)
                for horizon, share in zip(result.horizons, covered, strict=True)
            },
            "energy_score_vs_best_baseline": _largest(result.energy_score_vs_best_baseline),
            "energy_score_vs_fitted_noise": _largest(result.energy_score_vs_fitted_noise),
        }


def calibrate_on_paper_set(
    options: CalibrationOptions,
    on_progress: Callable[[SearchProgress], None] | None = None,
) -> PaperCalibration:
    """Make the set, learn θ_s from a part, fit the noise to another, score on the rest.

    Joint estimation learns, because the set obeys the laws it simulates: it takes the noise of
    initial states for what it is. A search by J alone makes θ_s answer for it, far beyond the
    uncertainty it states (boxes get too little friction), and no scale mends a wrong mean.
    """
    simulator = make_simulator(options.engine)
    dataset = make_paper_dataset(
        options.objects,
        options.throws + options.held_out,
        np.random.default_rng(options.seed),
        engine=options.engine,
        initial_states="flight",
        kinds=options.kinds or SHAPE_KINDS,
    )
    runs = (*dataset.training, *dataset.test)
    known = options.throws / (options.throws + options.held_out)
    first, second = (round(share * known * len(runs)) for share in (LEARNED_SHARE, 1.0))
    if not 1 <= first < second < len(runs):
        raise InvalidInputError(
            f"the set's {len(runs)} runs fall into {first} to learn from, {second - first} to fit "
            f"the noise to and {len(runs) - second} held out; expected some of each, ask for more"
        )
    learned = learn(
        [
            with_first_points(run.observation, LEARNED_POINTS, POSITION_NOISE)
            for run in runs[:first]
        ],
        simulator,
        LearningOptions(
            method=JOINT_METHOD,
            criteria=ConvergenceCriteria(max_iterations=options.iterations),
            seed=options.seed,
        ),
        on_progress=on_progress,
    ).learned
    truth = (dataset.parameters, simulator)
    noise = np.random.default_rng([options.seed, 1])
    result = calibrate(
        paper_outcomes(runs[first:second], *truth, options.points, options.horizons, noise),
        paper_outcomes(runs[second:], *truth, options.points, options.horizons),
        learned,
        options.horizons,
        scales_to_fit=FITTED_SCALES,
        start=START,
        sample_count=options.samples,
        seed=options.seed,
        simulator=simulator,
    )
    ours = noisy_prediction(learned, result.scales, options.samples, simulator)
    most = max(options.point_counts, default=options.points)
    by_points = {
        points: score(
            paper_outcomes(runs[second:], *truth, points, options.horizons, ahead_of=most),
            ours,
            options.seed + 1,
        )
        for points in options.point_counts
    }
    return PaperCalibration(result, learned, by_points)


def _largest(ratios: NDArray[np.float64]) -> float:
    return round(float(ratios.max()), 4)
