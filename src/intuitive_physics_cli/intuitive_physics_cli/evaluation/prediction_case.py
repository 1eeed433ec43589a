"""Observations predicted by noisy Newton, and how often their predicted regions hold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.materials import StaticParameters
from intuitive_physics.observation import Observation
from intuitive_physics.scene import Environment
from intuitive_physics.simulation import Simulator
from intuitive_physics_learner.cost.point_noise import TrackNoise, track_noises
from intuitive_physics_predictor.estimation.weighted_states import WeightedStates
from intuitive_physics_predictor.noise import StateNoise
from intuitive_physics_predictor.noisy_newton import PreparedScene, predict_sampled
from intuitive_physics_predictor.parameter_uncertainty import UncertainParameters
from intuitive_physics_predictor.scores.highest_density import coverage, highest_density_levels

LONGEST_NAME, SHORT_NAME = 16, 8
"""Letters: of an id that is longer than the first, as many as the second are shown."""


@dataclass(frozen=True, eq=False)
class PredictionCase:
    """One object of one observation: what was predicted and what was seen.

    Parameters
    ----------
    name : of the observation and the object, shown to people
    environment : Ω_e
    radius : m, of the smallest sphere about the object
    times : (n_times,) s after the initial state, those at which the object was seen
    samples : (n_samples, n_times, 3) m
    observed : (n_times, 3) m
    covariances : (n_times, 3, 3) m², of the error that each point observed has of its own
    """

    name: str
    environment: Environment
    radius: float
    times: NDArray[np.float64]
    samples: NDArray[np.float64]
    observed: NDArray[np.float64]
    covariances: NDArray[np.float64]

    @property
    def mean(self) -> NDArray[np.float64]:
        """Mean of the samples, (n_times, 3) m."""
        return self.samples.mean(axis=0)

    @property
    def distances(self) -> NDArray[np.float64]:
        """Distance of the mean from what was seen, (n_times,) m."""
        return np.linalg.norm(self.mean - self.observed, axis=1)

    @property
    def error(self) -> float:
        """D̄ (Eq. 6) of the mean, m."""
        return float(self.distances.mean())

    @property
    def spread(self) -> NDArray[np.float64]:
        """Root of the mean squared distance of the samples from their mean, (n_times,) m."""
        offsets = self.samples - self.mean
        return np.asarray(np.sqrt((offsets**2).sum(axis=2).mean(axis=0)))


def predict_cases(
    observations: Sequence[Observation],
    parameters: StaticParameters | UncertainParameters,
    simulator: Simulator,
    rng: np.random.Generator,
    sample_count: int = 100,
    estimates: Sequence[tuple[WeightedStates | None, ...]] | None = None,
) -> list[PredictionCase]:
    """Predict each object of each observation, by a simulation for each sample.

    They begin with the observation's initial states, or with its `estimates` as of `PreparedScene`.
    """
    noises = track_noises(observations)
    starts = estimates if estimates is not None else [()] * len(observations)
    cases = []
    for observation, track_errors, states in zip(observations, noises, starts, strict=True):
        covariances = [_covariances(noise) for noise in track_errors]
        scene = PreparedScene.of(observation.scene(), parameters, StateNoise(), states)
        cases += _cases_of(observation, covariances, scene, simulator, rng, sample_count)
    return cases


def _covariances(noise: TrackNoise) -> NDArray[np.float64]:
    """Covariances (n, 3, 3), m², of the error that each point of a track has of its own.

    Initial states are estimated from points with the same shared error, and count it already.
    """
    roots = np.linalg.inv(noise.whitening)
    return np.asarray(roots @ roots.swapaxes(1, 2))


def _cases_of(
    observation: Observation,
    covariances: Sequence[NDArray[np.float64]],
    prepared: PreparedScene,
    simulator: Simulator,
    rng: np.random.Generator,
    sample_count: int,
) -> list[PredictionCase]:
    after = [
        observed_object.trajectory.times > observation.start_time
        for observed_object in observation.objects
    ]
    since = [
        observed_object.trajectory.times[later] - observation.start_time
        for observed_object, later in zip(observation.objects, after, strict=True)
    ]
    instants = np.unique(np.concatenate(since))
    worlds = prepared.sampled(sample_count, rng)
    distribution = predict_sampled(prepared.scene, worlds, instants, simulator=simulator)
    return [
        PredictionCase(
            name=f"{_short(observation.id)}: {observed_object.object.id}",
            environment=observation.environment,
            radius=observed_object.object.shape.bounding_radius,
            times=times,
            samples=distribution.positions[:, j][:, np.searchsorted(instants, times)],
            observed=observed_object.trajectory.positions[later],
            covariances=noise[later],
        )
        for j, (observed_object, times, later, noise) in enumerate(
            zip(observation.objects, since, after, covariances, strict=True)
        )
    ]


def _short(name: str) -> str:
    """Shorten an id that was made up; keep one that was given."""
    return name if len(name) <= LONGEST_NAME else name[:SHORT_NAME]


LEVELS = np.linspace(0.05, 0.95, 19)
"""Probabilities of regions, shape (19,)."""

POINTS_JUDGED = 30
"""Points of each case, evenly over its time: neighbouring points are strongly correlated."""


def region_coverage(
    cases: Sequence[PredictionCase], rng: np.random.Generator
) -> NDArray[np.float64]:
    """Share of points inside the highest-density region of each of `LEVELS`, shape (19,).

    Every case counts the same. `rng` draws the errors of what was observed, which samples get too.
    """
    shares = []
    for case in cases:
        count = case.times.size
        judged = np.unique(np.linspace(0, count - 1, POINTS_JUDGED).round().astype(int))
        levels = [_levels_at(case, point, rng) for point in judged]
        shares.append([coverage(levels, level) for level in LEVELS])
    return np.asarray(np.mean(shares, axis=0))


HORIZONS = (0.2, 0.5, 1.0, 1.5, 2.0)
"""s ahead at which single points are judged."""

NEAR_HORIZON = 0.05
"""s from a horizon within which a point counts as at it."""


@dataclass(frozen=True)
class HorizonCoverage:
    """Coverage of predicted regions at one time ahead, at one point of each case."""

    horizon: float
    """s."""
    count: int
    """Cases that were seen then."""
    shares: tuple[float, ...]
    """Shares of these inside the regions of each probability."""


def horizon_coverage(
    cases: Sequence[PredictionCase], probabilities: Sequence[float], rng: np.random.Generator
) -> list[HorizonCoverage]:
    """Judge each case at its point nearest to each of `HORIZONS`, where some was seen then."""
    coverages = []
    for horizon in HORIZONS:
        nearest = [int(np.abs(case.times - horizon).argmin()) for case in cases]
        levels = [
            _levels_at(case, point, rng)
            for case, point in zip(cases, nearest, strict=True)
            if abs(case.times[point] - horizon) <= NEAR_HORIZON
        ]
        if levels:
            shares = tuple(coverage(levels, probability) for probability in probabilities)
            coverages.append(HorizonCoverage(horizon, len(levels), shares))
    return coverages


def binomial_error(probability: float, count: int) -> float:
    """Standard error of the share of `count` independent cases that have this probability."""
    return float(np.sqrt(probability * (1.0 - probability) / count))


def _levels_at(case: PredictionCase, point: int, rng: np.random.Generator) -> tuple[float, float]:
    """Levels of what was seen at one point among samples with errors as it has."""
    samples = case.samples[:, point]
    errors = rng.multivariate_normal(np.zeros(3), case.covariances[point], len(samples))
    return highest_density_levels(samples + errors, case.observed[point])
