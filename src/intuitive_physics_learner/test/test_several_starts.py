"""The start with the most evidence is kept; starts that evidence cannot separate widen σ."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from intuitive_physics.parameter_posterior import UNIFORM_PRECISION
from intuitive_physics_learner import ConvergenceCriteria
from intuitive_physics_learner.joint_estimation import JointEstimationSettings, several_starts
from intuitive_physics_learner.joint_estimation.joint_fit import LARGEST_VOTE
from intuitive_physics_learner.joint_estimation.several_starts import (
    CHANCE_EVIDENCE,
    DROP_STEPS,
    LEFT,
    STARTS,
    SeveralStarts,
    compared_evidences,
    drawn_starts,
)
from intuitive_physics_learner.joint_search.joint_search import FEWEST_FOR_STARTS, JointSearch
from intuitive_physics_learner.search.gaussian import Gaussian

E = 3
"""Index of the only parameter that has an effect."""


def two_optima(e):
    """Return the effect of e: as observed at 0.8, nearly so at 0.3, and wrong between."""
    return np.interp(e, [0.0, 0.3, 0.6, 0.8, 1.0], [1.3, 1.02, 1.3, 1.0, 0.7])


@pytest.fixture
def deceptive_task(gliding_task):
    """Make a task that begins at e = 0.5, from where it is downhill to the wrong optimum."""
    return gliding_task([0.8] * 4, effect=two_optima, position_deviation=0.002, noise=0.002)


def run(task, starts, steps=25):
    fits = SeveralStarts(task.fit_task, JointEstimationSettings(scan_steps=()), np.array(starts))
    for _ in range(steps):
        fits.step()
    return fits


def test_one_start_is_lost_and_several_find_the_optimum(deceptive_task):
    prior = deceptive_task.fit_task.prior
    own = prior.mean
    assert abs(run(deceptive_task, [own]).best.unit[E] - 0.8) > 0.2
    drawn = drawn_starts(prior, 5, np.random.default_rng(0))
    several = run(deceptive_task, [own, *drawn])
    several.choose()
    assert several.best.unit[E] == pytest.approx(0.8, abs=0.02)


def test_the_worse_are_dropped_and_their_simulations_count(deceptive_task):
    fit_task = deceptive_task.fit_task
    drawn = drawn_starts(fit_task.prior, 5, np.random.default_rng(1))
    fits = SeveralStarts(fit_task, JointEstimationSettings(), drawn)
    for _ in range(DROP_STEPS - 1):
        fits.step()
    assert len(fits.fits) == 5
    before = fits.simulations
    fits.step()
    assert len(fits.fits) == len(fits.starts) == LEFT
    assert fits.simulations > before


@pytest.mark.parametrize(
    ("evidences", "left"), [((0.0, -5.0, -30.0), 2), ((0.0, -30.0, -40.0), 1), ((0.0,) * 3, LEFT)]
)
def test_a_second_fit_is_left_where_evidence_cannot_tell_it_apart(
    gliding_task, monkeypatch, evidences, left
):
    """By chance evidences differ by 10."""
    monkeypatch.setattr(
        several_starts, "compared_evidences", lambda *arguments: np.array(evidences)
    )
    starts = drawn_starts(gliding_task([0.6] * 3).prior, 3, np.random.default_rng(0))
    assert len(run(gliding_task([0.6] * 3), starts, DROP_STEPS).fits) == left


def ended(fits):
    """Take steps until all fits have converged."""
    while not all(fit.settled for fit in fits.fits):
        fits.step()
    return fits


@pytest.fixture
def ending_early(monkeypatch):
    """Let no fit explain all points."""
    monkeypatch.setattr(several_starts, "durations", lambda fit: np.full(fit.horizons.size, 100.0))


def test_where_motions_end_early_a_fit_begins_again(deceptive_task, ending_early):
    """Once, at the best θ_s, with the observed initial states."""
    starts = drawn_starts(deceptive_task.prior, 4, np.random.default_rng(0))
    fits = ended(run(deceptive_task, starts, 1))
    count = len(fits.fits)
    assert not fits.settled
    fits.step()
    assert [fit.steps for fit in fits.fits[count:]] == [1]
    np.testing.assert_array_equal(fits.starts[-1], fits.best.unit)
    ended(fits)
    assert fits.settled
    assert len(fits.fits) == len(fits.starts) == count + 1
    fits.choose()
    assert fits.best.unit[E] == pytest.approx(0.8, abs=0.02)


def test_what_is_explained_to_its_end_is_not_fitted_again(deceptive_task):
    starts = drawn_starts(deceptive_task.prior, 4, np.random.default_rng(0))
    fits = ended(run(deceptive_task, starts, 1))
    assert fits.settled
    assert not fits.ends_early.any()


def test_one_start_does_not_begin_again(deceptive_task, ending_early):
    fits = ended(run(deceptive_task, [deceptive_task.fit_task.prior.mean], 1))
    assert fits.settled
    assert fits.ends_early.all()


def test_optima_that_the_observations_cannot_tell_apart_widen_the_deviation(gliding_task):
    # f(e) = 0.64 - |e - ½|: both e = 0.2 and e = 0.8 give the 0.34 observed.
    task = gliding_task(
        [0.2] * 3, effect=lambda e: 0.64 - abs(e - 0.5), position_deviation=0.002, noise=0.002
    )
    low, high = np.full((2, 4), 0.5)
    low[E], high[E] = 0.3, 0.7
    fits = run(task, [low, high])
    fits.choose()
    units = sorted(fit.unit[E] for fit in fits.fits)
    assert units == pytest.approx([0.2, 0.8], abs=0.01)
    # Equal weights: ½ 0.6².
    assert fits.spread[E] == pytest.approx(0.18, rel=0.1)


@pytest.mark.parametrize("difference", [3.0, 30.0, 300.0])
def test_what_evidence_differs_by_chance_does_not_count(gliding_task, monkeypatch, difference):
    # w₂/w₁ = exp(-Δ / c), and with the distance d of two fits the spread is d² w₂ / (w₁ + w₂).
    fits = run(gliding_task([0.6] * 3), np.array([[0.5] * 4, [0.7] * 4]), steps=1)
    apart = fits.fits[1].unit - fits.fits[0].unit
    evidences = np.array([0.0, -difference])
    monkeypatch.setattr(several_starts, "compared_evidences", lambda *a, **k: evidences)
    other = np.exp(-difference / CHANCE_EVIDENCE)
    fits.choose()
    np.testing.assert_allclose(fits.spread, apart**2 * other / (1.0 + other), rtol=1e-9)


def test_fits_that_end_at_one_place_have_no_spread(gliding_task):
    task = gliding_task([0.6] * 3, position_deviation=0.002, noise=0.002)
    starts = drawn_starts(task.prior, 3, np.random.default_rng(0))
    starts[:, :E] = 0.5
    fits = run(task, starts)
    fits.choose()
    assert fits.spread[E] < 1e-6


def test_continues_exactly(deceptive_task, ending_early):
    """Before the worse fits are dropped, after it, and when one has begun again."""
    starts = drawn_starts(deceptive_task.prior, 4, np.random.default_rng(0))
    again = ended(run(deceptive_task, starts, 1)).steps + 2
    for stopped in (2, 5, again):
        whole = run(deceptive_task, starts, again + 3)
        state = json.loads(json.dumps(run(deceptive_task, starts, stopped).state()))
        resumed = SeveralStarts(
            deceptive_task.fit_task, JointEstimationSettings(scan_steps=()), starts
        )
        resumed.load_state(state)
        for _ in range(again + 3 - stopped):
            resumed.step()
        resumed.choose()
        whole.choose()
        assert resumed.state() == whole.state()


@settings(max_examples=50)
@given(
    seed=st.integers(0, 2**32 - 1),
    count=st.integers(0, 12),
    n=st.integers(1, 6),
    known=st.floats(0.001, 0.28),
)
def test_drawn_starts_fill_the_range_of_the_prior(seed, count, n, known):
    rng = np.random.default_rng(seed)
    mean = rng.random(n)
    free = drawn_starts(Gaussian.within_bounds(mean), count, rng)
    assert free.shape == (count, n)
    # One in each of as many equal parts of each parameter's range.
    np.testing.assert_array_equal(
        np.sort(np.floor(count * free.clip(max=1.0 - 1e-9)), axis=0),
        np.tile(np.arange(count)[:, None], n),
    )
    narrow = Gaussian.about(mean, np.eye(n) * known**-2)
    near = drawn_starts(narrow, count, rng)
    assert ((near >= 0.0) & (near <= 1.0)).all()
    assert (np.abs(near - mean) <= known * np.sqrt(UNIFORM_PRECISION) + 1e-12).all()


@pytest.fixture
def stated(monkeypatch):
    """Make fits that state the log evidences of observations, those of θ_s being zero."""

    def stated_evidences(task, fit, horizons, steps=0):
        return fit.evidences, 0.0

    monkeypatch.setattr(several_starts, "log_evidences", stated_evidences)
    return lambda *evidences: SimpleNamespace(evidences=np.array(evidences), horizons=np.ones(1))


def test_no_single_observation_decides_between_two_fits(stated):
    # The second one explains three of four a little worse and the last one, which took another
    # turn, by thousands better; then that one as well as it should.
    first, second = stated(-1.0, -1.0, -1.0, -5000.0), stated(-2.5, -2.5, -2.5, -2.5)
    assert np.argmax(compared_evidences(None, (first, second))) == 0
    other = stated(-1.5, -1.5, -1.5, -2.5)
    assert np.argmax(compared_evidences(None, (first, other))) == 1


def test_no_fit_has_the_advantage_of_its_own_horizon(stated, monkeypatch):
    # Up to the horizons the first one explains more; a little beyond, where it ends, far less.
    first, second = stated(0.0, 0.0, 0.0), stated(-1.0, -1.0, -1.0)
    ahead = {1.0: 0.0, 1.5: 9.0}
    monkeypatch.setattr(
        several_starts,
        "log_evidences",
        lambda task, fit, horizons, steps: (
            fit.evidences - (fit is first) * ahead[horizons[0]],
            0.0,
        ),
    )
    assert np.argmax(compared_evidences(None, (first, second))) == 0
    assert np.argmax(compared_evidences(None, (first, second), beyond=(0.0, 0.5))) == 1


@given(st.lists(st.lists(st.floats(-1e4, 1e2), min_size=3, max_size=3), min_size=2, max_size=5))
def test_votes_are_bounded_and_the_difference_of_two_is_clipped(drawn):
    made = [SimpleNamespace(horizons=np.ones(1)) for _ in drawn]
    for fit, evidences in zip(made, drawn, strict=True):
        fit.evidences = np.array(evidences)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            several_starts, "log_evidences", lambda task, fit, horizons, steps: (fit.evidences, 0.0)
        )
        compared = compared_evidences(None, made)
        first = compared_evidences(None, made[:2])
    assert np.ptp(compared) <= 3 * LARGEST_VOTE + 1e-6
    expected = np.clip(np.subtract(*drawn[:2]), -LARGEST_VOTE, LARGEST_VOTE).sum()
    assert first[0] - first[1] == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(
    ("criteria", "fits"),
    [
        (ConvergenceCriteria(FEWEST_FOR_STARTS - 1), 1),
        (ConvergenceCriteria(FEWEST_FOR_STARTS), STARTS),
        (ConvergenceCriteria(time_limit=1e-6), 1),
        (ConvergenceCriteria(time_limit=1e6), STARTS),
    ],
)
def test_a_search_that_ends_soon_has_one_start(deceptive_task, criteria, fits):
    search = JointSearch(deceptive_task, np.random.default_rng(0))
    search.plan(criteria)
    search.step(1)
    assert len(search._staged.jointly.fits) == fits
