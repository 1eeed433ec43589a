"""Fit horizons advance as far as the motion can be predicted, and retreat where a fit fails."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from intuitive_physics_learner import TrajectoryCost
from intuitive_physics_learner.joint_estimation import JointEstimationSettings, fit_horizons
from intuitive_physics_learner.joint_estimation.fit_horizons import (
    FAILED_LENGTH,
    MISFIT_POINTS,
    MOST_RETREATS,
    RETREAT,
    TrajectoryFits,
    advanced_horizons,
    first_horizons,
    misfit_length,
    misfit_starts,
)
from intuitive_physics_learner.joint_estimation.joint_fit import JointFit
from intuitive_physics_learner.joint_estimation.linearisation import Linearisation
from intuitive_physics_learner.joint_estimation.observation_blocks import observation_blocks

from .cases import rerouted

SETTINGS = JointEstimationSettings()
ADVANCE = SETTINGS.largest_advance
NOISE = 0.01
"""m"""


@pytest.fixture
def block(gliding_task):
    """Two balls seen at 100 points, 0.04 s apart, with free initial positions."""
    task = gliding_task([0.5, 0.5], position_deviation=0.02, count=100)
    (made,) = observation_blocks(task.cost.observations, task.influence)
    return replace(made, whitening=np.broadcast_to(np.eye(3) / NOISE, made.whitening.shape))


def bent(block, bends):
    """A linearisation of which only its error (W, P) in m is asked."""
    nothing = np.zeros((*block.times.shape, 3))
    slopes = np.zeros((len(nothing), 1, *nothing.shape[1:]))
    valid = np.isfinite(block.times)
    return Linearisation(nothing, slopes, valid, bends, np.zeros_like(slopes))


def test_a_fit_begins_with_the_first_points_or_the_first_time(block, monkeypatch):
    # The tenth point is at 0.4 s, the twentieth at 0.8 s.
    np.testing.assert_allclose(first_horizons(block), 0.4)
    monkeypatch.setattr(fit_horizons, "FIRST_POINTS", 20)
    np.testing.assert_allclose(first_horizons(block), 0.5)


def test_horizons_advance_to_where_the_linearisation_error_exceeds_its_limit(block):
    # An error κ t² may be 2 σ + s t with a spread of s t: t* = (s + √(s² + 8 κ σ)) / (2 κ).
    curvature, speed = np.array([[0.021], [0.06]]), 0.03
    linear = bent(block, curvature * block.times**2)
    spreads = speed * block.times
    ends = (speed + np.sqrt(speed**2 + 8.0 * curvature[:, 0] * NOISE)) / (2.0 * curvature[:, 0])
    expected = np.floor(ends / 0.04) * 0.04
    horizons = first_horizons(block)
    for _ in range(20):
        before = horizons
        horizons = advanced_horizons(block, linear, spreads, horizons, ADVANCE)
        assert (horizons >= before).all()
        assert (horizons <= before + ADVANCE + 1e-12).all()
    np.testing.assert_allclose(horizons, expected)


def test_horizons_advance_to_where_the_spread_exceeds_its_limit(block):
    spreads = 0.1 * block.times
    horizons = np.array([0.4, 2.0])
    for _ in range(20):
        horizons = advanced_horizons(
            block, bent(block, 0.0 * block.times), spreads, horizons, ADVANCE
        )
    # 0.1 m/s reaches 0.15 m at 1.5 s, before which 1.48 s is the last point; what was fitted
    # already stays so.
    np.testing.assert_allclose(horizons, [1.48, 2.0])


def test_horizons_end_with_the_trajectory(block):
    horizons = np.array([3.9, 3.95])
    predictable = bent(block, 0.0 * block.times)
    moved = advanced_horizons(block, predictable, 0.0 * block.times, horizons, ADVANCE)
    np.testing.assert_allclose(moved, block.durations)


HALF = MISFIT_POINTS // 2
"""Good points that a misfit's window of neighbours begins with."""


@given(first=st.integers(6, 90))
def test_a_misfit_starts_where_half_of_its_neighbours_are_off(first):
    # Of nine neighbours more than half are off as soon as five follow: the window begins four
    # earlier.
    times = 0.04 * np.arange(1, 101)[None]
    residuals = np.zeros((1, 100, 3))
    residuals[0, first:, 0] = 10.0 * NOISE
    block = _Times(times)
    start = misfit_starts(block, residuals, np.array([4.0]))
    np.testing.assert_allclose(start, times[0, first - HALF])
    beyond = misfit_starts(block, residuals, times[0, first - 1 : first])
    assert np.isinf(beyond).all()


class _Times:
    """The part of a block on which misfits depend."""

    def __init__(self, times):
        self.times = times

    def whitened(self, residuals):
        return residuals / NOISE


@pytest.mark.parametrize(("window", "points"), [(9, 151), (6, 60), (1, 10)])
def test_noise_alone_is_a_misfit_as_seldom_as_stated(window, points):
    """The median of n lengths of N(0, 1)³ exceeds c with P(Bin(n, P(χ₃ > c)) ≥ ⌈n/2⌉) at most."""
    rate = 0.2
    limit = misfit_length(window, points, rate)
    lengths = np.linalg.norm(np.random.default_rng(3).normal(size=(20_000, window, 3)), axis=2)
    share = float((np.median(lengths, axis=1) > limit).mean())
    expected = rate * window / points
    # Even windows take the mean of two lengths, both of which seldom exceed the limit: below it.
    lower = 0.0 if window % 2 == 0 else expected - 4.0 * np.sqrt(expected / 20_000)
    assert lower <= share <= expected + 4.0 * np.sqrt(expected / 20_000)


def test_two_outliers_are_no_misfit(block):
    residuals = np.zeros((2, 100, 3))
    residuals[:, 50:52] = 1.0
    assert np.isinf(misfit_starts(block, residuals, block.durations)).all()


def test_a_horizon_retreats_to_before_its_misfit_and_others_reach_their_goals(block):
    fits = TrajectoryFits.initial(block)
    fits.horizons = np.array([3.0, 3.0])
    residuals = np.zeros((2, 100, 3))
    residuals[1, 49:, 0] = 10.0 * NOISE
    goals = np.array([3.2, 3.2])
    assert fits.advance(block, residuals, goals)
    np.testing.assert_array_equal(fits.misfits, [False, True])
    start = block.times[1, 49 - HALF]
    np.testing.assert_allclose(fits.horizons, [3.2, start - RETREAT])


def test_a_horizon_that_retreats_twice_and_gets_no_farther_stays(block):
    fits = TrajectoryFits.initial(block)
    fits.horizons = np.array([3.0, 3.0])
    good, failing = np.zeros((2, 2, 100, 3))
    failing[1, 49:, 0] = 10.0 * NOISE

    def advance(residuals, to):
        return fits.advance(block, residuals, np.full(2, to))

    assert advance(good, 3.2)
    for _ in range(MOST_RETREATS):
        assert not advance(failing, 3.2)
        retreated = fits.horizons.copy()
        assert retreated[1] < 3.2
        assert not advance(good, 3.2)
    np.testing.assert_array_equal(fits.horizons, [3.2, retreated[1]])
    # Retreats are counted from zero again once a horizon gets farther than before.
    fits.retreats[:] = MOST_RETREATS - 1
    assert advance(good, 3.4)
    np.testing.assert_array_equal(fits.retreats, 0)


def test_a_fit_settles_where_one_motion_cannot_be_explained_to_its_end(gliding_task, glide):
    task = gliding_task([0.6] * 4, position_deviation=0.02, noise=0.002, count=60)
    *others, last = task.cost.observations
    kick = [0.0, 1.0, 0.0]
    kicked = rerouted(last, lambda t, path: path + np.maximum(t - 1.2, 0.0)[:, None] * kick)
    task = replace(task, cost=TrajectoryCost([*others, kicked], glide))
    fit = JointFit(task.fit_task, SETTINGS)
    for _ in range(60):
        fit.step()
    assert fit.settled
    assert fit.unit[3] == pytest.approx(0.6, abs=0.002)
    assert fit.observation_fits()[3].horizon < 1.5


def test_losses_are_hubers_and_the_priors(block):
    fits = TrajectoryFits.initial(block)
    fits.horizons = np.array([0.04, 0.08])
    estimates = np.zeros((1, 2, 3))
    estimates[0, 0, 0] = 2.0 * block.prior_deviations[0, 0]
    residuals = np.zeros((1, 2, 100, 3))
    residuals[0, :, 0, 0] = 2.0 * NOISE
    residuals[0, :, 1, 0] = 5.0 * NOISE
    # ½ 2² inside; beyond 3 σ, 3 (5 - 3/2); later points do not count; ½ 2² of the prior.
    got = fits.losses(block, estimates, residuals)
    np.testing.assert_allclose(got, [[2.0 + 2.0, 2.0 + 10.5]])
    residuals[0, 0, 0] = np.nan
    failed = fits.losses(block, estimates, residuals)[0, 0]
    assert failed == pytest.approx(2.0 + 3.0 * (FAILED_LENGTH - 1.5))


def test_joint_fit_reaches_the_end_of_predictable_motion(gliding_task):
    task = gliding_task([0.6, 0.6, 0.6], position_deviation=0.02, count=60)
    fit = JointFit(task.fit_task, SETTINGS)
    for _ in range(40):
        fit.step()
    assert fit.settled
    assert fit.misfits == 0.0
    assert fit.unit[3] == pytest.approx(0.6, abs=1e-4)
    (part,) = fit.state()["fits"]
    np.testing.assert_allclose(part["horizons"], 60 * 0.04)


def test_draws_begin_with_the_estimate_and_spread_as_they_should(block):
    fits = TrajectoryFits.initial(block)
    d = fits.estimate.shape[1]
    factor = np.random.default_rng(0).normal(size=(2, d, d))
    covariances = factor @ factor.transpose(0, 2, 1)
    # What is known exactly is not drawn.
    covariances[:, 0], covariances[:, :, 0] = 0.0, 0.0
    draws = fits.draws(np.random.default_rng(1), covariances, 4000)
    np.testing.assert_array_equal(draws[0], fits.estimate)
    for row in range(2):
        np.testing.assert_allclose(
            np.cov(draws[1:, row].T), covariances[row], atol=0.1 * covariances.max()
        )
