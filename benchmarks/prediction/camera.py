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

from benchmarks.prediction.camera_world import SeenThrow, World, bounces, see_world
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.scene import Scene
from intuitive_physics.simulation import make_simulator
from intuitive_physics.state import ANGULAR_VELOCITY, ObjectState
from intuitive_physics_cli.evaluation.prequential import AFTER_BOUNCE
from intuitive_physics_experiments.calibration.calibrate import FIXED_NOISE
from intuitive_physics_experiments.rendering.ball_surface import PATTERNS, PLAIN
from intuitive_physics_learner.learning_session import LearningOptions, learn
from intuitive_physics_learner.search.convergence import ConvergenceCriteria
from intuitive_physics_predictor.distribution import TrajectoryDistribution
from intuitive_physics_predictor.estimation.object_estimate import SceneEstimate, Surroundings
from intuitive_physics_predictor.live.self_calibration import SelfCalibration
from intuitive_physics_predictor.noise import PERCEIVED, StateNoise
from intuitive_physics_predictor.noise_scales import NoiseScales
from intuitive_physics_predictor.noisy_newton import (
    DEFAULT_SAMPLE_COUNT,
    PreparedScene,
    predict_sampled,
)
from intuitive_physics_predictor.scores.highest_density import highest_density_levels
from intuitive_physics_predictor.scores.proper_scores import energy_scores

AHEAD = (0.2, 0.5, 1.0, 1.5, 2.0)  # s after the moment of a prediction at which it is judged
# Simulations of each prediction: the error of their mean adds little to what is measured
SAMPLES = 200
MOMENTS = ("first_flight", "after_first_bounce", "after_second_bounce")  # when predictions begin
# Ways to predict: from the estimate; from the perceived state with a guess of 10 rad/s on each axis
# where the spin is not seen; the same with the true spin; and the paper's, with fixed noise on the
# perceived state and one θ_s
ESTIMATE, GUESS, KNOWN_SPIN, FIXED = "estimate", "guess", "known_spin", "fixed"
# s, of the predictions that the suite compares with later detections
CALIBRATION_TIMES = np.arange(0.0, 1.05, 0.02)
# Patterns that show how a ball turns
MARKED = tuple(pattern for pattern in PATTERNS if pattern != PLAIN)
PAINTED = 1000  # between the seeds of plain and painted balls


@dataclass(frozen=True, eq=False)
class Judged:
    """One prediction, made in each way, against the truth at `AHEAD`; NaN beyond the throw."""

    errors: dict[str, NDArray[np.float64]]  # (5,) m of the mean, by way
    scores: dict[str, NDArray[np.float64]]  # (5,) m, energy scores, by way
    levels: NDArray[np.float64]  # (5, 2) as `highest_density_levels`, of the estimate
    spin_error: float  # rad/s, of the estimate
    spin_nees: float  # squared error of the spin in variances, of 3 degrees of freedom


@dataclass(frozen=True, eq=False)
class JudgedWorld:
    """The judged predictions of a world."""

    moments: dict[str, list[Judged]]  # by name
    patterned: list[Judged]  # in the first flight of balls with dots, seams or a logo
    seconds: list[float]  # of each estimate


def judge_world(spin: float, throws: int, learning_time: float, seed: int) -> JudgedWorld:
    """Perceive a world, learn from its first half and judge predictions of its second.

    The spin (rad/s) is the standard deviation of the initial spin about each axis; learning takes
    at most so long (s).
    """
    rng = np.random.default_rng([seed, 1])
    world = see_world(spin, throws, seed)
    learned = _learn_first_half(world, learning_time)
    plain = _Follower(world, learned, rng)
    moments: dict[str, list[Judged]] = {name: [] for name in MOMENTS}
    for throw in world.throws[throws // 2 :]:
        for name, judged in plain.judge(throw):
            moments[name].append(judged)
    painted = see_world(spin, throws // 2, seed + PAINTED, patterns=MARKED)
    follower = _Follower(painted, learned, rng)
    patterned = [
        judged
        for throw in painted.throws
        for name, judged in follower.judge(throw)
        if name == MOMENTS[0]
    ]
    return JudgedWorld(moments, patterned, plain.seconds)


def _learn_first_half(world: World, learning_time: float) -> LearnedParameters:
    """Learn θ_s with the learner's defaults from the first half of a world's throws."""
    middle = world.throws[len(world.throws) // 2].throw.start_time
    earlier = [item for item in world.observations if item.start_time < middle]
    options = LearningOptions(criteria=ConvergenceCriteria(time_limit=learning_time))
    return learn(earlier, make_simulator("auto"), options).learned


class _Follower:
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

    def judge(self, throw: SeenThrow) -> Iterator[tuple[str, Judged]]:
        """Follow a ball frame by frame, and judge the prediction of each moment."""
        estimate = SceneEstimate(self._rng)
        moments = _moments(throw)
        for time, perceived in throw.sightings:
            detection = perceived.detection
            if detection is not None:
                self._calibration.take_detection(
                    perceived.object.id,
                    time,
                    detection.positions[0],
                    detection.covariances[0] + detection.bias,
                )
            noise = self._calibration.applied_to(StateNoise())
            start = perf_counter()
            updates = estimate.updates(
                self._surroundings,
                [perceived.object],
                [perceived.state],
                time,
                [detection],
                noise.guess_scale,
            )
            estimates = tuple(updates)
            self.seconds.append(perf_counter() - start)
            scene = Scene(self._world.model.environment, (perceived.object,), (perceived.state,))
            prepared = PreparedScene.of(scene, self._uncertain, noise, estimates)
            self._calibration.take_prediction(
                self._predicted(prepared, CALIBRATION_TIMES, DEFAULT_SAMPLE_COUNT),
                time,
                scene.environment.gravity,
                prepared.guessed,
            )
            if time in moments:
                yield moments[time], self._judged(throw, time, prepared)

    def _judged(self, seen: SeenThrow, time: float, prepared: PreparedScene) -> Judged:
        """Predict in each way at a time, s, and compare with the truth."""
        throw, motion, times = seen.throw, seen.throw.motion, np.array(AHEAD)
        since = time - throw.start_time
        spin = self._world.perceived_direction(
            np.array([np.interp(since, motion.times, v) for v in motion.angular_velocities.T])
        )
        there = since + times <= motion.times[-1]
        truth = np.full((len(times), 3), np.nan)
        truth[there] = self._world.perceived_point(throw.positions_at(time + times[there]))
        scene, uncertain = prepared.scene, self._uncertain
        as_paper = StateNoise(False, FIXED_NOISE, FIXED_NOISE, FIXED_NOISE, FIXED_NOISE)
        ways = {
            ESTIMATE: prepared,
            GUESS: PreparedScene.of(scene, uncertain, StateNoise(spin_prior=PERCEIVED)),
            KNOWN_SPIN: _with_spin(prepared, spin),
            FIXED: PreparedScene.of(scene, uncertain.learned.parameters, as_paper),
        }
        # Positions (SAMPLES, 5, 3) m of the ball
        samples = {
            way: self._predicted(ready, times, SAMPLES).positions[:, 0]
            for way, ready in ways.items()
        }
        levels = np.full((len(times), 2), np.nan)
        for k in np.flatnonzero(there):
            levels[k] = highest_density_levels(samples[ESTIMATE][:, k], truth[k])
        (states,), (perceived,) = prepared.estimates, scene.states
        state = perceived if states is None else states.state(perceived.orientation)
        error = state.angular_velocity - spin
        covariance = state.covariance[ANGULAR_VELOCITY, ANGULAR_VELOCITY]
        return Judged(
            errors={
                way: np.linalg.norm(positions.mean(axis=0) - truth, axis=-1)
                for way, positions in samples.items()
            },
            scores={
                way: energy_scores(positions, np.nan_to_num(truth)) + 0.0 * truth[:, 0]
                for way, positions in samples.items()
            },
            levels=levels,
            spin_error=float(np.linalg.norm(error)),
            spin_nees=float(error @ np.linalg.solve(covariance, error)),
        )

    def _predicted(
        self, prepared: PreparedScene, times: NDArray[np.float64], count: int
    ) -> TrajectoryDistribution:
        """Return some samples at times (n,) s ahead."""
        worlds = prepared.sampled(count, self._rng)
        return predict_sampled(prepared.scene, worlds, times, simulator=make_simulator("auto"))


def _moments(seen: SeenThrow) -> dict[float, str]:
    """Return the times at which predictions are judged, with their names."""
    times = np.array([time for time, _ in seen.sightings])
    hits = bounces(seen.throw)
    moments: dict[float, str] = {}
    for name, frames, hit in zip(
        MOMENTS, (-1, AFTER_BOUNCE - 1, AFTER_BOUNCE - 1), (0, 0, 1), strict=True
    ):
        if hit >= len(hits) or not times.size:
            continue
        k = int(np.searchsorted(times, hits[hit])) + frames
        is_free = (
            hit + 1 >= len(hits)
            or name == MOMENTS[0]
            or times[min(k, len(times) - 1)] < hits[hit + 1]
        )
        if 2 <= k < len(times) and is_free:
            moments[float(times[k])] = name
    return moments


def _with_spin(prepared: PreparedScene, spin: NDArray[np.float64]) -> PreparedScene:
    """Return the scene as perceived, with a spin (3,) rad/s that is known."""
    (state,) = prepared.scene.states
    covariance = state.covariance.copy()
    covariance[ANGULAR_VELOCITY] = covariance[:, ANGULAR_VELOCITY] = 0.0
    known = ObjectState(state.position, state.orientation, state.linear_velocity, spin, covariance)
    scene = replace(prepared.scene, states=(known,))
    return PreparedScene.of(scene, prepared.static_parameters, prepared.noise)
