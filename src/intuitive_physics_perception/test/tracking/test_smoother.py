"""The filter and the smoother are honest, and the smoother knows what came later."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from intuitive_physics_perception.detection.detections import DetectedSphere
from intuitive_physics_perception.settings import PerceptionSettings
from intuitive_physics_perception.tracking.episodes import smooth
from intuitive_physics_perception.tracking.tracker import Tracker

from ..conftest import FLOOR

SETTINGS = PerceptionSettings()
STEP = 1.0 / 30.0
RADIUS = 0.05
FRAMES, RUNS = 14, 120


def driven_flight(rng, deviation):
    """Positions and velocities (FRAMES, 3) under gravity and the filter's own process noise: an
    acceleration that is constant over each step, drawn anew for the next."""
    position, velocity = rng.uniform(-1, 1, 3) + [0, 0, 4.0], rng.normal(0.0, 1.5, 3)
    places, speeds = [], []
    for _ in range(FRAMES):
        places.append(position)
        speeds.append(velocity)
        acceleration = FLOOR.gravity + deviation * rng.normal(size=3)
        position = position + velocity * STEP + 0.5 * acceleration * STEP**2
        velocity = velocity + acceleration * STEP
    return np.array(places), np.array(speeds)


def noisy_sphere(rng, place):
    """A detection whose noise grows with range and goes together in place and radius."""
    distance = np.linalg.norm(place - [-2.0, 0.0, 1.0])
    spread = np.full((4, 4), 0.3) + 0.7 * np.eye(4)
    covariance = (0.0005 + 0.0005 * distance**2) ** 2 * spread
    error = rng.multivariate_normal(np.zeros(4), covariance)
    return DetectedSphere(place + error[:3], RADIUS + error[3], covariance, 200, distance)


def followed(rng, places, hidden=()):
    tracker = Tracker(FLOOR, SETTINGS)
    for k, place in enumerate(places):
        tracker.update(k * STEP, [] if k in hidden else [noisy_sphere(rng, place)])
    (track,) = tracker.tracks
    return track


def squared_errors(rng, hidden=()):
    """Normalised squared errors (RUNS, FRAMES) of filter and smoother, 7 degrees of freedom."""
    filtered, smoothed = [], []
    for _ in range(RUNS):
        places, speeds = driven_flight(rng, SETTINGS.acceleration_noise)
        truth = np.column_stack([places, speeds, np.full(FRAMES, RADIUS)])
        track = followed(rng, places, hidden)
        for kept, means, covariances in (
            (filtered, [s.mean for s in track.steps], [s.covariance for s in track.steps]),
            (smoothed, *smooth(list(track.steps))[1:]),
        ):
            errors = truth - np.stack(means)
            scaled = np.linalg.solve(np.stack(covariances), errors[:, :, None])[:, :, 0]
            kept.append((errors * scaled).sum(axis=1))
    return np.array(filtered), np.array(smoothed)


@pytest.mark.parametrize("hidden", [(), (6, 7, 8)], ids=["seen", "hidden"])
def test_squared_errors_are_as_large_as_the_covariances_say(rng, hidden) -> None:
    # The sum over runs of normalised squared errors (NEES) obeys χ² with 7 degrees of freedom a
    # run. Bands hold 99.99 % each, as there is one for each frame. At first the velocity is known
    # by its prior alone, which these throws do not fill.
    filtered, smoothed = squared_errors(rng, hidden)
    low, high = chi2.ppf([5e-5, 1.0 - 5e-5], 7 * RUNS)
    for nees in (filtered[:, 2:], smoothed[:, 2:]):
        assert ((nees.sum(axis=0) > low) & (nees.sum(axis=0) < high)).all()


def test_smoothing_halves_the_error_in_the_middle(rng) -> None:
    ends, middles = [], []
    for _ in range(30):
        places, _ = driven_flight(rng, 0.0)
        track = followed(rng, places)
        _, means, _ = smooth(list(track.steps))
        ends.append(np.linalg.norm(track.steps[7].mean[:3] - places[7]))
        middles.append(np.linalg.norm(means[7, :3] - places[7]))
    # Half of what tells of the middle comes later: variances add up as information does.
    assert np.mean(np.square(middles)) < 0.7 * np.mean(np.square(ends))


def test_the_path_goes_through_the_gap_and_ends_where_it_was_last_seen(rng) -> None:
    places, _ = driven_flight(rng, 0.0)
    times, means, _ = smooth(list(followed(rng, places, hidden=(5, 6, 11, 12, 13)).steps))
    assert times == pytest.approx(STEP * np.arange(11))
    assert np.linalg.norm(means[5:7, :3] - places[5:7], axis=1).max() < 0.01


def test_the_last_state_is_the_filter_s_own(rng) -> None:
    places, _ = driven_flight(rng, 0.0)
    track = followed(rng, places)
    _, means, covariances = smooth(list(track.steps))
    assert means[-1] == pytest.approx(track.mean)
    assert covariances[-1] == pytest.approx(track.covariance)
