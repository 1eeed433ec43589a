"""What other pairs suggest of a pair, against closed forms and over many random worlds."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import truncnorm

from intuitive_physics.materials import pair_count, parameter_count
from intuitive_physics.parameter_posterior import ParameterPosterior
from intuitive_physics.prior_knowledge.pair_prior import (
    PairPriorSettings,
    matching_truncated_normals,
    pair_suggestions,
    with_pair_prior,
)

UNIFORM = 1.0 / np.sqrt(12.0)


def names(m):
    return [f"material {i}" for i in range(m)]


def restitution_places(m):
    return m + 4 * np.arange(pair_count(m)) + 3


def seen(m, values, chosen, noise):
    """Posterior of restitutions (ψ,), of which those chosen were measured with a noise."""
    size = parameter_count(m)
    places = restitution_places(m)[chosen]
    mean, factor = np.full(size, 0.5), np.zeros((places.size, size))
    mean[places] = np.clip(values[chosen], 0.0, 1.0)
    factor[np.arange(places.size), places] = 1.0 / noise
    return ParameterPosterior(names(m), mean, factor)


WORLDS = {
    "independent": lambda a, b, rng: rng.random(a.size),
    "mean of two": lambda a, b, rng: 0.5 * (a + b),
    "root of two": lambda a, b, rng: np.sqrt(a * b),
    "mean and scatter": lambda a, b, rng: 0.5 * (a + b) + rng.uniform(-0.15, 0.15, a.size),
}


def ranks(make, m, share, noise, count, seed=0):
    """Where unseen truths lie in the draws, and how wide these are."""
    rng = np.random.default_rng(seed)
    first, second = np.triu_indices(m)
    shares, widths = [], []
    for _ in range(count):
        own = rng.random(m)
        true = np.clip(make(own[first], own[second], rng), 0.0, 1.0)
        chosen = rng.random(true.size) < share
        measured = true + rng.normal(0.0, noise, true.size)
        drawn = with_pair_prior(seen(m, measured, chosen, noise)).draw(300, rng)
        unseen = drawn[:, restitution_places(m)[~chosen]]
        shares.append((unseen < true[~chosen]).mean(axis=0))
        widths.append(unseen.std(axis=0))
    return np.concatenate(shares), np.concatenate(widths)


@pytest.mark.parametrize("world", WORLDS)
@pytest.mark.parametrize(("m", "share"), [(4, 0.5), (8, 0.4)])
def test_intervals_of_unseen_pairs_hold_the_truth(world, m, share):
    shares, widths = ranks(WORLDS[world], m, share, 0.03, 240 // m**2 + 12)
    within_one, within_two = (np.mean(np.abs(shares - 0.5) < p / 2) for p in (0.683, 0.954))
    # Errors of one world are alike, and there are some dozen worlds; sums may be wider than needed.
    assert within_one > 0.56
    assert within_two > 0.88
    if world == "independent":
        assert widths.mean() > 0.9 * UNIFORM
    elif m == 8:
        assert widths.mean() < 0.65 * UNIFORM


def test_nothing_seen_suggests_nothing():
    empty = seen(5, np.full(15, 0.5), np.zeros(15, dtype=bool), 0.1)
    suggested = pair_suggestions(empty)
    assert (suggested.mean == 0.5).all()
    assert suggested.standard_deviations == pytest.approx(np.full(65, UNIFORM))
    assert with_pair_prior(empty).to_dict() == empty.to_dict()


def test_one_pair_seen_suggests_almost_nothing():
    one = seen(5, np.full(15, 0.9), np.arange(15) == 3, 0.01)
    deviations = pair_suggestions(one).standard_deviations
    assert deviations.min() > 0.94 * UNIFORM


def test_what_is_suggested_of_a_pair_does_not_depend_on_what_was_seen_of_it():
    values = np.random.default_rng(0).random(15)
    chosen = np.arange(15) != 7
    # A member of the grid at a time, as the weights of several depend on all that was seen.
    alone = PairPriorSettings(own_shares=(0.4,), material_shares=(0.75,), unexplained=0.0)
    without = pair_suggestions(seen(5, values, chosen, 0.05), alone)
    place = restitution_places(5)[7]
    for value in (0.0, 1.0):
        values[7] = value
        suggested = pair_suggestions(seen(5, values, np.full(15, True), 0.05), alone)
        assert suggested.mean[place] == pytest.approx(without.mean[place])
        assert suggested.standard_deviations[place] == pytest.approx(
            without.standard_deviations[place]
        )


def test_agrees_with_the_conditional_of_the_joint_normal_distribution():
    m, noise, share, part = 4, 0.1, 0.6, 0.5
    rng = np.random.default_rng(1)
    values, chosen = rng.random(10), np.arange(10) < 7
    first, second = np.triu_indices(m)
    design = np.eye(m)[first] + np.eye(m)[second]
    covariance = (
        (1 - share) * np.ones((10, 10))
        + share * part / 2 * design @ design.T
        + share * (1 - part) * np.eye(10)
    ) / 12
    data = covariance[np.ix_(chosen, chosen)] + noise**2 * np.eye(7)
    across = covariance[np.ix_(~chosen, chosen)]
    mean = 0.5 + across @ np.linalg.solve(data, values[chosen] - 0.5)
    left = covariance[np.ix_(~chosen, ~chosen)] - across @ np.linalg.solve(data, across.T)
    alone = PairPriorSettings(own_shares=(share,), material_shares=(part,), unexplained=0.0)
    suggested = pair_suggestions(seen(m, values, chosen, noise), alone)
    places = restitution_places(m)[~chosen]
    assert suggested.mean[places] == pytest.approx(mean)
    assert suggested.standard_deviations[places] == pytest.approx(np.sqrt(np.diag(left)))


def test_other_coefficients_and_densities_stay_as_they_are():
    values = np.full(36, 0.8)
    before = seen(8, values, np.arange(36) < 20, 0.02)
    after = with_pair_prior(before)
    own = np.zeros(before.mean.size, dtype=bool)
    own[restitution_places(8)] = True
    assert not after.factor[:, ~own].any()
    assert (after.mean[~own] == before.mean[~own]).all()
    measured = restitution_places(8)[:20]
    assert after.mean[measured] == pytest.approx(np.full(20, 0.8), abs=1e-3)
    part = with_pair_prior(before, names(8)[5:])
    assert part.materials == tuple(names(8)[5:])
    assert part.mean[restitution_places(3)] == pytest.approx(np.full(6, 0.8), abs=0.02)


def test_an_interval_is_not_narrowed():
    before = seen(8, np.full(36, 0.8), np.arange(36) < 20, 0.02)
    ends = np.full((before.mean.size, 2), np.nan)
    place = restitution_places(8)[3]
    ends[place] = [0.2, 0.9]
    sided = ParameterPosterior(before.materials, before.mean, before.factor, before.bounds, ends)
    after = with_pair_prior(sided)
    assert after.information[place, place] == pytest.approx(before.information[place, place])


@settings(max_examples=60)
@given(st.floats(0.0, 1.0), st.floats(0.02, 1.0))
def test_truncated_normals_have_the_moments_where_they_can(mean, deviation):
    (centre,), (precision,) = matching_truncated_normals(np.array([mean]), np.array([deviation]))
    assert 0.0 <= centre <= 1.0
    assert precision >= 0.0
    if precision < 1e-6 or centre in (0.0, 1.0):
        return
    sigma = precision**-0.5
    found = truncnorm(-centre / sigma, (1.0 - centre) / sigma, centre, sigma)
    assert found.mean() == pytest.approx(mean, abs=1e-4)
    assert found.std() == pytest.approx(deviation, abs=1e-4)


def test_truncated_normals_of_typical_moments():
    centres, precisions = matching_truncated_normals(
        np.array([0.5, 0.5, 0.9, 0.7]), np.array([0.05, UNIFORM, 0.1, 0.2])
    )
    assert precisions[0] == pytest.approx(400.0)
    assert precisions[1] == pytest.approx(0.0, abs=1e-6)
    # A mean near an end needs a centre there.
    assert centres[2] == 1.0
    assert precisions[2] == pytest.approx(1 / (0.1**2 + 0.1**2), rel=0.01)
    assert 0.7 < centres[3] < 1.0
