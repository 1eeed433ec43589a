"""The calibration on observations: perceived ones in a folder, or a recorded set."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.observation import Observation, ObservedObject
from intuitive_physics.scene import Environment, Scene
from intuitive_physics.simulation import make_simulator
from intuitive_physics.state import ObjectState
from intuitive_physics.trajectory import Trajectory
from intuitive_physics_cli.evaluation.evaluation import split
from intuitive_physics_experiments.calibration.calibrate import Calibration, calibrate
from intuitive_physics_experiments.calibration.launch_spread import launch_spread
from intuitive_physics_experiments.calibration.options import CalibrationOptions
from intuitive_physics_experiments.flight_fits import (
    SMALLEST_NOISE,
    AirFactors,
    fit_initial_state_in_air,
    fit_noisy_flight,
    flight_length,
    with_known_rotation,
)
from intuitive_physics_learner.cost.point_noise import detected
from intuitive_physics_learner.learning_session import LearningOptions, learn
from intuitive_physics_learner.search.parameter_search import ConvergenceCriteria, SearchProgress
from intuitive_physics_predictor.scores.noise_fit import FITTED_SCALES
from intuitive_physics_predictor.scores.outcomes import Outcome

WINDOW = 7  # Points of a stretch that a parabola is laid through to see the noise

# m on each axis: the error that is the same in all frames, which no parabola shows, of a camera
# whose detections do not state it. Of rendered cameras, whose truth is known, it is 0.6 to 1.4 mm.
SYSTEMATIC = 1e-3

SAME_TIME = 1e-3  # s between points of two objects that count as seen at once
SURELY_FREE = 0.1  # Share of such stretches that nothing but gravity acts on
BY_CHANCE = 0.999  # Quantile of χ² below which a window is free flight


def observed_outcomes(
    observations: Sequence[Observation],
    points: int,
    horizons: Sequence[float],
    densities: Mapping[str, float] | None = None,
) -> list[Outcome]:
    """Return each observation as seen for its first points (at least 4), and what was seen later.

    Initial states are fitted again to those points before the first bounce, because those of an
    observation may know more of its motion. Horizons are s after the last of the points; the points
    nearest in time to them count. Where an object was not seen within a frame of a horizon, the
    outcome is not known. `densities` are kg/m³ by material, of objects that air acts on.
    """
    return [
        _outcome(detected(observation), points, np.array(horizons), densities or {})
        for observation in observations
    ]


@dataclass(frozen=True, eq=False)
class PointNoise:
    """The errors of one object's points."""

    covariances: NDArray[np.float64]  # (n, 3, 3) m², of the error that each point has of its own
    shared: NDArray[np.float64]  # (3, 3) m², covariance of the error that is the same in all points


def point_noise(observed_object: ObservedObject) -> PointNoise:
    """Return the errors of the points of an object, as `detected` returns it.

    Detections state them, up to a factor that the track shows. Points without are as noisy as their
    track shows, and share an error of `SYSTEMATIC`.
    """
    trajectory, detections = observed_object.trajectory, observed_object.detections
    if detections is None:
        variance = max(free_flight_noise(trajectory), SMALLEST_NOISE) ** 2
        every = np.broadcast_to(variance * np.eye(3), (len(trajectory), 3, 3))
        return PointNoise(every, SYSTEMATIC**2 * np.eye(3))
    factor = free_flight_noise(trajectory, detections.covariances) or 1.0
    return PointNoise(factor**2 * detections.covariances, detections.bias)


def free_flight_noise(
    trajectory: Trajectory, covariances: NDArray[np.float64] | None = None
) -> float:
    """Standard deviation of the noise of positions, in m on each axis; 0 where it is unknown.

    Estimated from how far seven points in a row lie from a parabola. Where a ball bounces high, a
    bounce spoils most groups of seven; only those count that chance can explain, given the noise of
    the best tenth of them. (The median of all would be too large: with a bounce every ten points
    the squared errors of a rendered rubber ball by 60 %.) With the covariances (n, 3, 3) m² that
    are stated of the points, the result is a factor on the stated standard deviations.
    """
    times, positions = trajectory.times, trajectory.positions
    if len(times) < WINDOW:
        return 0.0
    whitening = np.broadcast_to(np.eye(3), (len(times), 3, 3))
    if covariances is not None:
        whitening = np.linalg.inv(np.linalg.cholesky(covariances))
    whitened = np.einsum("nij,nj->ni", whitening, positions)
    freedom = 3 * (WINDOW - 3)
    squares = []
    for first in range(len(times) - WINDOW + 1):
        rows = slice(first, first + WINDOW)
        since = times[rows] - times[first]
        # A parabola of each axis, whitened as the points are.
        design = np.einsum("nij,nk->nikj", whitening[rows], np.vander(since / since[-1], 3))
        _, residuals, *_ = np.linalg.lstsq(design.reshape(3 * WINDOW, 9), whitened[rows].ravel())
        squares.append(residuals.sum())
    variance = np.quantile(squares, SURELY_FREE) / chi2.ppf(SURELY_FREE, freedom)
    free = [square for square in squares if square <= variance * chi2.ppf(BY_CHANCE, freedom)]
    return float(np.sqrt(np.mean(free) / freedom))


def _outcome(
    observation: Observation,
    points: int,
    horizons: NDArray[np.float64],
    densities: Mapping[str, float],
) -> Outcome:
    start = max(
        float(observed_object.trajectory.times[0]) for observed_object in observation.objects
    )
    noises = [point_noise(observed_object) for observed_object in observation.objects]
    states, clock = [], observation.objects[0].trajectory.times - start
    for observed_object, noise in zip(observation.objects, noises, strict=True):
        if len(observed_object.trajectory) < points:
            raise InvalidInputError(
                f"object {observed_object.object.id} of observation {observation.id} was seen "
                f"{len(observed_object.trajectory)} times; expected at least {points}"
            )
        states.append(
            _initial_state(
                observed_object, start, points, noise, observation.environment, densities
            )
        )
    last = float(clock[min(int(np.searchsorted(clock, 0.0)) + points, len(clock)) - 1])
    frame = float(np.median(np.diff(clock)))
    nearest = np.abs(clock[:, None] - (last + horizons)).argmin(axis=0)
    near = np.abs(clock[nearest] - (last + horizons)) <= frame
    times = np.where(near, clock[nearest], last + horizons)
    positions = np.full((len(observation.objects), len(times), 3), np.nan)
    covariances = np.zeros((*positions.shape, 3))
    for k, (observed_object, noise) in enumerate(zip(observation.objects, noises, strict=True)):
        clock_times = observed_object.trajectory.times - start
        at = np.abs(clock_times[:, None] - times).argmin(axis=0)
        close = np.abs(clock_times[at] - times) <= SAME_TIME
        positions[k, close] = observed_object.trajectory.positions[at[close]]
        covariances[k, close] = noise.covariances[at[close]] + noise.shared
    scene = Scene(observation.environment, observation.scene().objects, tuple(states))
    return Outcome(scene, times, positions, covariances)


def _initial_state(
    observed_object: ObservedObject,
    start: float,
    points: int,
    noise: PointNoise,
    environment: Environment,
    densities: Mapping[str, float],
) -> ObjectState:
    """State at `start`; of orientation and spin, what the observation says."""
    first = int(np.searchsorted(observed_object.trajectory.times, start))
    rows = slice(first, first + points)
    times, positions = (
        observed_object.trajectory.times[rows],
        observed_object.trajectory.positions[rows],
    )
    known, gravity = observed_object.initial_state, environment.gravity
    if observed_object.object.drag_coefficient:
        mass = observed_object.object.shape.mass(densities[observed_object.object.material])
        air = AirFactors.of(observed_object.object, environment.air_density, mass)
        fitted = fit_initial_state_in_air(times, positions, gravity, air)
        position, velocity = fitted.position, fitted.linear_velocity
        covariance = fitted.covariance.copy()
    else:
        covariances = noise.covariances[rows]
        free = flight_length(times, positions, gravity, covariances)
        position, velocity, covariance = fit_noisy_flight(
            times[:free], positions[:free], gravity, covariances[:free]
        )
    return with_known_rotation(known, position, velocity, covariance)


# Share of the observations where they are split once: θ_s is learned from these and the noise is
# fitted to them.
PAST_SHARE = 0.5


def splits_of(
    observations: Sequence[Observation], count: int, seed: int
) -> list[tuple[list[Observation], list[Observation]]]:
    """Return past and held-out observations, each in their first order.

    One split holds out one part. Of more, the observations fall into as many parts at random, which
    are held out in turn, so that each observation is held out once.
    """
    if count == 1:
        return [split(observations, PAST_SHARE, seed)]
    if not 1 <= count <= len(observations):
        raise InvalidInputError(
            f"{count} splits of {len(observations)} observations were asked for; expected at least "
            "1 and at most as many as there are observations"
        )
    part = np.empty(len(observations), dtype=np.int64)
    part[np.random.default_rng(seed).permutation(len(observations))] = (
        np.arange(len(observations)) % count
    )
    return [
        (
            [
                observation
                for observation, its_part in zip(observations, part, strict=True)
                if its_part != number
            ],
            [
                observation
                for observation, its_part in zip(observations, part, strict=True)
                if its_part == number
            ],
        )
        for number in range(count)
    ]


@dataclass(frozen=True, eq=False)
class ObservedCalibration:
    """Result of a calibration on observations."""

    calibration: Calibration  # of all observations that were held out
    # θ_s, from the past; from all observations where there are several splits
    learned: LearnedParameters
    notes: tuple[str, ...]  # paragraphs on what only this set can show


def calibrate_on_observations(
    observations: Sequence[Observation],
    options: CalibrationOptions,
    *,
    same_settings: bool = False,
    start: LearnedParameters | None = None,
    on_progress: Callable[[SearchProgress], None] | None = None,
) -> ObservedCalibration:
    """Learn and fit the noise with one part, predict the other part from its first points.

    Of several splits the scores are pooled; θ_s is then learned from all observations, and each
    noise scale is the median over the splits. `same_settings`: all are shots of a launcher that was
    set once, and their spread is compared too, in the first split. Learning starts from `start`, or
    from the defaults. Progress is that of searches in this process.
    """
    parts = splits_of(observations, options.splits, options.seed)
    if options.cores == 1 or len(parts) == 1:
        results = [_calibrated(*part, options, start, on_progress) for part in parts]
    else:
        with ProcessPoolExecutor(options.cores, get_context("spawn")) as pool:
            jobs = [pool.submit(_calibrated, *part, options, start) for part in parts]
            results = [job.result() for job in jobs]
    calibrations, versions = zip(*results, strict=True)
    notes: tuple[str, ...] = ()
    if same_settings:
        spread = launch_spread(
            *parts[0],
            calibrations[0].scales.parameters(versions[0]),
            seed=options.seed,
            simulator=make_simulator(options.engine),
        )
        notes = (spread.to_markdown(),)
    whole = versions[0]
    if len(parts) > 1:
        whole = _learned(observations, options, start, on_progress)
    return ObservedCalibration(Calibration.pooled(calibrations), whole, notes)


def _learned(
    past: Sequence[Observation],
    options: CalibrationOptions,
    start: LearnedParameters | None,
    on_progress: Callable[[SearchProgress], None] | None,
) -> LearnedParameters:
    criteria = ConvergenceCriteria(max_iterations=options.iterations)
    return learn(
        past,
        make_simulator(options.engine),
        LearningOptions(criteria=criteria, seed=options.seed),
        previous=start,
        on_progress=on_progress,
    ).learned


def _calibrated(
    past: Sequence[Observation],
    held_out: Sequence[Observation],
    options: CalibrationOptions,
    start: LearnedParameters | None,
    on_progress: Callable[[SearchProgress], None] | None = None,
) -> tuple[Calibration, LearnedParameters]:
    """Calibrate on one split; also return θ_s as learned from its past."""
    learned = _learned(past, options, start, on_progress)
    densities = dict(zip(learned.materials, learned.parameters.density.tolist(), strict=True))
    calibration = calibrate(
        observed_outcomes(past, options.points, options.horizons, densities),
        observed_outcomes(held_out, options.points, options.horizons, densities),
        learned,
        options.horizons,
        scales_to_fit=fitted_scales((*past, *held_out)),
        sample_count=options.samples,
        seed=options.seed,
        simulator=make_simulator(options.engine),
    )
    return calibration, learned


def fitted_scales(observations: Sequence[Observation]) -> tuple[str, ...]:
    """Return the noise scales that observations identify.

    Nobody sees the spin of a ball. Where every object has detections, the covariances of initial
    states follow from theirs, and a scale of them could only be chance.
    """
    stated = all(
        each.detections is not None for observation in observations for each in observation.objects
    )
    return ("spin", *(name for name in FITTED_SCALES if not (stated and name == "state")))
