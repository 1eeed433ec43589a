"""The noise of observed points: its size for each track, its shape, errors that points share."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from intuitive_physics.observation import Detections, Observation, ObservedObject
from intuitive_physics.scene import Environment, SceneObject
from intuitive_physics.shapes import Sphere
from intuitive_physics.state import ObjectState
from intuitive_physics.trajectory import Trajectory
from intuitive_physics_learner.cost.point_noise import detected, track_noises
from intuitive_physics_learner.joint_estimation.normal_equations import (
    NormalEquations,
    joint_posterior,
)
from intuitive_physics_learner.joint_estimation.observation_blocks import observation_blocks
from intuitive_physics_learner.search.gaussian import Gaussian

G = np.array([0.0, 0.0, -9.81])


def flight(rng, times, errors, detections=None, smoothed=None):
    """A ball in free flight, seen with these errors (n, 3) in m."""
    path = [0.1, 0.2, 2.0] + times[:, None] * [1.0, -0.5, 2.0] + 0.5 * times[:, None] ** 2 * G
    positions = path + errors
    state = ObjectState(positions[0], covariance=1e-3**2 * np.eye(12))
    ball = SceneObject("ball", "rubber", Sphere(0.03))
    made = None if detections is None else Detections(times, positions, *detections)
    trajectory = Trajectory(times, positions if smoothed is None else smoothed(path))
    return Observation(
        Environment(gravity=G), (ObservedObject(ball, trajectory, state, made),), -1.0
    )


def sizes(observations):
    """Standard deviation in m of each track, the mean of its points."""
    noises = track_noises([detected(each) for each in observations])
    return [
        float(np.sqrt(np.mean(np.linalg.inv(track.whitening) ** 2 * 3.0))) for (track,) in noises
    ]


def test_each_track_has_a_noise_of_its_own():
    """N(0, σ²) on each axis; the median of n lengths errs by about 0.9 σ / √n."""
    rng = np.random.default_rng(0)
    times = np.sort(rng.uniform(0.0, 1.0, 400))
    true = [0.002, 0.008]
    tracks = [flight(rng, times, rng.normal(0.0, sigma, (400, 3))) for sigma in true]
    np.testing.assert_allclose(sizes(tracks), true, rtol=0.15)


def test_jumps_of_a_few_points_change_no_noise():
    rng = np.random.default_rng(1)
    times = np.arange(200) / 30.0
    errors = rng.normal(0.0, 0.002, (200, 3))
    errors[::25] += 0.5
    assert sizes([flight(rng, times, errors)])[0] == pytest.approx(0.002, rel=0.6)


def test_a_smoothed_track_is_known_as_well_as_its_initial_state():
    rng = np.random.default_rng(2)
    times = np.arange(100) / 30.0
    track = flight(rng, times, np.zeros((100, 3)), smoothed=lambda path: path + 2e-3 * np.sin(path))
    assert sizes([track])[0] == pytest.approx(1e-3, rel=0.05)


@settings(max_examples=20)
@given(factor=st.floats(0.3, 4.0), seed=st.integers(0, 1000))
def test_detections_have_their_covariance_times_a_factor_of_the_track(factor, seed):
    """Errors s L ξ with C = L Lᵀ: the whitened ones are standard normal."""
    rng = np.random.default_rng(seed)
    lower = np.array([[1e-3, 0.0, 0.0], [5e-4, 2e-3, 0.0], [0.0, 1e-3, 4e-3]])
    errors = factor * rng.normal(size=(300, 3)) @ lower.T
    covariances = np.broadcast_to(lower @ lower.T, (300, 3, 3))
    times = np.arange(300) / 60.0
    track = flight(rng, times, errors, (covariances, np.zeros((3, 3))))
    ((noise,),) = track_noises([detected(track)])
    whitened = np.einsum("nij,nj->ni", noise.whitening, errors)
    assert np.mean(whitened**2) == pytest.approx(1.0, rel=0.35)


def test_shared_errors_have_the_covariance_of_the_bias():
    rng = np.random.default_rng(3)
    axis = np.array([2.0, 3.0, 6.0]) / 7.0
    bias = 2e-3**2 * np.outer(axis, axis)
    covariances = np.broadcast_to(1e-3**2 * np.eye(3), (50, 3, 3))
    track = flight(rng, np.arange(50) / 30.0, rng.normal(0, 1e-3, (50, 3)), (covariances, bias))
    ((noise,),) = track_noises([detected(track)])
    np.testing.assert_allclose(noise.shared.T @ noise.shared, bias, atol=1e-12)
    (block,) = observation_blocks([detected(track)], np.ones((1, 1), dtype=bool))
    # Three nuisance parameters more than the components of the initial state, of unit variance.
    assert (block.prior_deviations[0, -3:] == 1.0).all()
    amounts = np.zeros(block.prior_deviations.shape)
    amounts[0, -3:] = 1.5 * axis
    moved = block.displaced(np.zeros((1, 50, 3)), amounts)
    np.testing.assert_allclose(moved[0], np.tile(1.5 * 2e-3 * axis, (50, 1)), atol=1e-9)


def test_shared_errors_do_not_average_out():
    """x_i = θ + b + ε_i / √n with b ~ N(0, β²) common: σ_θ² = (n/σ²)⁻¹ + β², however many i."""
    beta, sigma, count = 0.3, 0.1, 400
    # Unknowns of each: the amount of the shared error in units of β, then θ.
    slopes = np.array([beta, 1.0]) / sigma
    hessian = np.tile(np.outer(slopes, slopes) + np.diag([1.0, 0.0]), (count, 1, 1))
    zero = np.zeros((count, 1), dtype=np.int64)
    every, ones = np.arange(count), np.ones(count)
    equations = NormalEquations(every, zero, 1, hessian, np.zeros((count, 2)))
    common = equations.with_common(zero, 1).eliminated()
    prior = Gaussian.about(np.zeros(2), np.diag([1e-12, 1.0]))
    covariance = joint_posterior(prior, prior.mean, [common], ones).covariance
    assert covariance[0, 0] == pytest.approx(sigma**2 / count + beta**2, rel=1e-6)
    prior = prior.marginal(np.array([0]))
    apart = joint_posterior(prior, prior.mean, [equations.eliminated()], ones).covariance
    assert apart[0, 0] == pytest.approx((sigma**2 + beta**2) / count, rel=1e-6)
