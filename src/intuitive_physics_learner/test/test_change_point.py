"""The likelihood ratio of a change: its distribution without one, its power with one."""

import numpy as np

from intuitive_physics_learner.online.change_point import change_probability, find_change
from intuitive_physics_learner.search.gaussian import Gaussian, LocalLikelihood

SIZE = 6
"""Parameters: two pairs of three."""

FAMILIES = {("ball", "floor"): np.array([0, 1, 2]), ("ball", "wall"): np.array([3, 4, 5])}

CENTRE = np.full(SIZE, 0.5)


def observed(generator, truth, sharpness=1e4):
    """The likelihood of an observation of all parameters, taken about a point beside its best."""
    slopes = generator.normal(size=(SIZE + 2, SIZE))
    information = sharpness * slopes.T @ slopes
    best = truth + np.linalg.solve(
        information, np.sqrt(sharpness) * slopes.T @ generator.normal(size=len(slopes))
    )
    about = CENTRE + 0.01 * generator.normal(size=SIZE)
    scores = information @ (about - best)
    return LocalLikelihood(np.arange(SIZE), about, information, scores, 0.0)


def known_from(generator, truth, count):
    return Gaussian.nothing(SIZE).plus([observed(generator, truth) for _ in range(count)])


def test_probability_is_uniform_without_a_change():
    generator = np.random.default_rng(0)
    covariance = 1e-4 * np.eye(SIZE) + 5e-5
    prior = Gaussian.about(CENTRE, np.linalg.inv(covariance))
    changes = []
    for _ in range(1000):
        truth = generator.multivariate_normal(CENTRE, covariance)
        likelihoods = [observed(generator, truth) for _ in range(3)]
        changes.append(change_probability(prior, likelihoods, FAMILIES["ball", "floor"]))
    places = np.sort(changes)
    # Kolmogorov's test at 1e-3.
    assert np.abs(places - (np.arange(1000) + 0.5) / 1000).max() < 1.95 / np.sqrt(1000)


def looked_for(information, recent, weight=0.0, rate=1e-4):
    counts = dict.fromkeys(FAMILIES, 100)
    weighted = [(likelihood, weight) for likelihood in recent]
    return find_change(information, CENTRE, weighted, FAMILIES, counts, rate)


def test_no_alarm_in_a_long_stationary_stream():
    generator = np.random.default_rng(1)
    information, recent, alarms = known_from(generator, CENTRE, 8), [], 0
    for _ in range(1000):
        likelihood = observed(generator, CENTRE)
        information = information.plus([likelihood])
        recent = [*recent, likelihood][-8:]
        alarms += looked_for(information, recent, weight=1.0) is not None
    # 0.1 are expected at most.
    assert alarms <= 1


def test_change_of_one_pair_is_located():
    generator = np.random.default_rng(2)
    information = known_from(generator, CENTRE, 20)
    after = CENTRE + np.array([0.0, 0.0, 0.1, 0.0, 0.0, 0.0])
    recent = [observed(generator, CENTRE) for _ in range(3)]
    recent += [observed(generator, after) for _ in range(4)]
    change = looked_for(information, recent)
    assert change.pair == ("ball", "floor")
    assert change.length in (4, 5)
    assert change.probability < 1e-6


def test_one_disturbed_observation_is_no_change():
    generator = np.random.default_rng(3)
    information = known_from(generator, CENTRE, 20)
    recent = [observed(generator, CENTRE) for _ in range(7)]
    recent[4] = observed(generator, CENTRE + 0.2)
    assert looked_for(information, recent) is None


def test_disturbed_observations_that_disagree_are_no_change():
    generator = np.random.default_rng(4)
    information = known_from(generator, CENTRE, 20)
    recent = [observed(generator, CENTRE + generator.normal(0.0, 0.1, SIZE)) for _ in range(6)]
    assert looked_for(information, recent) is None


def test_nothing_is_a_change_before_something_is_known():
    generator = np.random.default_rng(5)
    recent = [(observed(generator, CENTRE + 0.1), 0.0) for _ in range(6)]
    information = known_from(generator, CENTRE, 1)
    counts = dict.fromkeys(FAMILIES, 1)
    assert find_change(information, CENTRE, recent, FAMILIES, counts, 1e-4) is None
