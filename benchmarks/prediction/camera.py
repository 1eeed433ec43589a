"""How well are balls predicted that a rendered camera sees, while they fly?

In each of three worlds balls are thrown with another spin, which the suite does not know. θ_s is
learned from the first half of the throws; the second half is predicted: in the first flight, after
the first bounce and after the second. Balls with a pattern are predicted in their first flight with
the same θ_s.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from benchmarks.prediction.camera_world import SeenThrow, Sighting, World, bounces, see_world
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.scene import Scene
from intuitive_physics.simulation import Simulator, make_simulator
from intuitive_physics.state import ANGULAR_VELOCITY, ObjectState
from intuitive_physics_cli.evaluation.prequential import AFTER_BOUNCE
from intuitive_physics_experiments.calibration.calibrate import FIXED_NOISE
from intuitive_physics_experiments.rendering.ball_surface import PATTERNS, PLAIN
from intuitive_physics_learner.learning_session import LearningOptions, learn
from intuitive_physics_learner.search.convergence import ConvergenceCriteria
from intuitive_physics_predictor.distribution import TrajectoryDistribution
from intuitive_physics_predictor.estimation.object_estimate import SceneEstimate, Surroundings
from intuitive_physics_predictor.estimation.weighted_states import WeightedStates
from intuitive_physics_predictor.live.self_calibration import SelfCalibration
from intuitive_physics_predictor.noise import PERCEIVED, StateNoise
from intuitive_physics_predictor.noise_scales import NoiseScales
from intuitive_physics_predictor.noisy_newton import (
    DEFAULT_SAMPLE_COUNT,
    PreparedScene,
    predict_sampled,
)
from intuitive_physics_predictor.parameter_uncertainty import UncertainParameters
from intuitive_physics_predictor.scores.highest_density import highest_density_levels
from intuitive_physics_predictor.scores.proper_scores import energy_scores

AHEAD = (0.2, 0.5, 1.0, 1.5, 2.0)  # s after the moment of a prediction at which it is judged
# Simulations of each prediction: the error of their mean adds little to what is measured
SAMPLES = 200
MOMENTS = ("first_flight", "after_first_bounce", "after_second_bounce")  # when predictions begin


# s, of the predictions that the suite compares with what comes
CALIBRATION_TIMES = np.arange(0.0, 1.05, 0.02)
# Patterns that show how a ball turns
MARKED = tuple(pattern for pattern in PATTERNS if pattern != PLAIN)
PAINTED = 1000  # between the seeds of plain and painted balls
LEARNING_TIME = 20.0  # s of learning at most, in each world


@dataclass(frozen=True, eq=False)
class Judged:
    """One prediction, three ways, held against the truth."""

    # (5,) m of the mean of the estimate's prediction, at `AHEAD`; NaN beyond the throw
    errors: NDArray[np.float64]
    # known_spin, guess: the same from the perceived state with the true spin, and with a guess of
    # 10 rad/s on each axis where it is not seen, as before there were estimates
    known_spin: NDArray[np.float64]
    guess: NDArray[np.float64]
    spin_error: float  # rad/s
    spin_nees: float  # squared error of the spin in variances, of 3 degrees of freedom
    levels: NDArray[np.float64]  # (5, 2) as `highest_density_levels`, NaN beyond the throw
    # scores, scores_of_guess: (5,) m, energy scores of both predictions
    scores: NDArray[np.float64]
    scores_of_guess: NDArray[np.float64]
    # the same of the paper's: fixed noise on the perceived state, and one θ_s
    scores_of_fixed: NDArray[np.float64]


def learn_first_half(world: World, simulator: Simulator) -> LearnedParameters:
    """Learn θ_s, as the learner does by default, from the first half of a world's throws."""
    middle = world.throws[len(world.throws) // 2].throw.start_time
    earlier = [seen for seen in world.observations if seen.start_time < middle]
    options = LearningOptions(criteria=ConvergenceCriteria(time_limit=LEARNING_TIME))
    return learn(earlier, simulator, options).learned


class Follower:
    """Follows the balls of a world as the predictor does with its default settings."""

    def __init__(self, world: World, learned: LearnedParameters, rng: np.random.Generator) -> None:
        self._world = world
        self._rng = rng
        self._uncertain = NoiseScales().parameters(learned)
        self._surroundings = Surroundings(
            world.model.environment, self._uncertain, make_simulator("auto")
        )
        self._calibration = SelfCalibration()
        self.seconds: list[float] = []

    def judge(self, seen: SeenThrow) -> Iterator[tuple[str, Judged]]:
        """Follow a ball frame by frame, and judge the prediction of each moment."""
        estimate = SceneEstimate(self._rng)
        moments = _moments(seen)
        for sighting in seen.sightings:
            found = sighting.seen
            self._compare(sighting)
            noise = self._calibration.applied_to(StateNoise())
            start = perf_counter()
            estimates = estimate.update(
                self._surroundings,
                [found.object],
                [found.state],
                sighting.time,
                [found.detection],
                noise.guess_scale,
            )
            self.seconds.append(perf_counter() - start)
            scene = Scene(self._world.model.environment, (found.object,), (found.state,))
            prepared = PreparedScene.of(scene, self._uncertain, noise, estimates)
            self._calibration.take_prediction(
                _predicted(prepared, CALIBRATION_TIMES, DEFAULT_SAMPLE_COUNT, self._rng),
                sighting.time,
                scene.environment.gravity,
                prepared.guessed,
            )
            if sighting.time in moments:
                judged = _judged(self._world, seen, sighting, prepared, self._uncertain, self._rng)
                yield moments[sighting.time], judged

    def _compare(self, sighting: Sighting) -> None:
        detection = sighting.seen.detection
        if detection is not None:
            self._calibration.take_detection(
                sighting.seen.object.id,
                sighting.time,
                detection.positions[0],
                detection.covariances[0] + detection.bias,
            )


def _moments(seen: SeenThrow) -> dict[float, str]:
    """Return the times at which predictions are judged, with their names."""
    times = np.array([sighting.time for sighting in seen.sightings])
    hits = bounces(seen.throw)
    found: dict[float, str] = {}
    for name, frames, hit in zip(
        MOMENTS, (-1, AFTER_BOUNCE - 1, AFTER_BOUNCE - 1), (0, 0, 1), strict=True
    ):
        if hit >= len(hits) or not times.size:
            continue
        k = int(np.searchsorted(times, hits[hit])) + frames
        free = (
            hit + 1 >= len(hits)
            or name == MOMENTS[0]
            or times[min(k, len(times) - 1)] < (hits[hit + 1])
        )
        if 2 <= k < len(times) and free:
            found[float(times[k])] = name
    return found


def _judged(
    world: World,
    seen: SeenThrow,
    sighting: Sighting,
    prepared: PreparedScene,
    uncertain: UncertainParameters,
    rng: np.random.Generator,
) -> Judged:
    throw, motion = seen.throw, seen.throw.motion
    since = sighting.time - throw.start_time
    spin = world.perceived_direction(
        np.array([np.interp(since, motion.times, v) for v in motion.angular_velocities.T])
    )
    times = np.array(AHEAD)
    there = since + times <= motion.times[-1]
    truth = np.full((len(times), 3), np.nan)
    truth[there] = world.perceived_point(throw.positions_at(sighting.time + times[there]))
    own = _samples(prepared, times, rng)
    before = PreparedScene.of(prepared.scene, uncertain, StateNoise(spin_prior=PERCEIVED))
    guess = _samples(before, times, rng)
    as_paper = StateNoise(False, FIXED_NOISE, FIXED_NOISE, FIXED_NOISE, FIXED_NOISE)
    fixed = PreparedScene.of(prepared.scene, uncertain.learned.parameters, as_paper)
    known = _samples(_with_spin(prepared, spin), times, rng)
    (states,) = prepared.estimates
    error, nees = _spin_error(states, sighting.seen.state, spin)
    levels = np.full((len(times), 2), np.nan)
    for k in np.flatnonzero(there):
        levels[k] = highest_density_levels(own[:, k], truth[k])
    return Judged(
        np.linalg.norm(own.mean(axis=0) - truth, axis=-1),
        np.linalg.norm(known.mean(axis=0) - truth, axis=-1),
        np.linalg.norm(guess.mean(axis=0) - truth, axis=-1),
        error,
        nees,
        levels,
        *(
            energy_scores(samples, np.nan_to_num(truth)) + 0.0 * truth[:, 0]
            for samples in (own, guess, _samples(fixed, times, rng))
        ),
    )


def _samples(
    prepared: PreparedScene, times: NDArray[np.float64], rng: np.random.Generator
) -> NDArray[np.float64]:
    """Positions (SAMPLES, n_times, 3) m of the ball."""
    return _predicted(prepared, times, SAMPLES, rng).positions[:, 0]


def _predicted(
    prepared: PreparedScene, times: NDArray[np.float64], count: int, rng: np.random.Generator
) -> TrajectoryDistribution:
    worlds = prepared.sampled(count, rng)
    return predict_sampled(prepared.scene, worlds, times, simulator=make_simulator("auto"))


def _with_spin(prepared: PreparedScene, spin: NDArray[np.float64]) -> PreparedScene:
    """Return the scene as perceived, with a spin (3,) rad/s that is known."""
    (state,) = prepared.scene.states
    covariance = state.covariance.copy()
    covariance[ANGULAR_VELOCITY] = covariance[:, ANGULAR_VELOCITY] = 0.0
    known = ObjectState(state.position, state.orientation, state.linear_velocity, spin, covariance)
    scene = replace(prepared.scene, states=(known,))
    return PreparedScene.of(scene, prepared.static_parameters, prepared.noise)


def _spin_error(
    states: WeightedStates | None, perceived: ObjectState, spin: NDArray[np.float64]
) -> tuple[float, float]:
    """Error of the spin in rad/s, and squared in variances."""
    state = perceived if states is None else states.state(perceived.orientation)
    apart = state.angular_velocity - spin
    covariance = state.covariance[ANGULAR_VELOCITY, ANGULAR_VELOCITY]
    return float(np.linalg.norm(apart)), float(apart @ np.linalg.solve(covariance, apart))


@dataclass(frozen=True, eq=False)
class JudgedWorld:
    """What was found in a world."""

    moments: dict[str, list[Judged]]  # by name, what was judged
    patterned: list[Judged]  # the same in the first flight of balls with dots, seams or a logo
    seconds: list[float]  # that each estimate took


def judge_world(spin: float, throws: int, seed: int) -> JudgedWorld:
    """See a world, learn from its first half and judge its second."""
    rng = np.random.default_rng([seed, 1])
    world = see_world(spin, throws, seed)
    learned = learn_first_half(world, make_simulator("auto"))
    plain = Follower(world, learned, rng)
    found: dict[str, list[Judged]] = {name: [] for name in MOMENTS}
    for seen in world.throws[throws // 2 :]:
        for name, judged in plain.judge(seen):
            found[name].append(judged)
    painted = see_world(spin, throws // 2, seed + PAINTED, patterns=MARKED)
    follower = Follower(painted, learned, rng)
    patterned = [
        judged
        for seen in painted.throws
        for name, judged in follower.judge(seen)
        if name == MOMENTS[0]
    ]
    return JudgedWorld(found, patterned, plain.seconds)
