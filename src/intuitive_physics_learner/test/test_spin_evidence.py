"""How balls are thrown is recovered with its stated error, alike in batch and on-line."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.materials import StaticParameters
from intuitive_physics.observation import Observation, ObservedObject
from intuitive_physics.prior_knowledge.initial_spins import InitialSpins, SpinSpread
from intuitive_physics.prior_knowledge.spin_evidence import (
    GRID,
    SpinEvidence,
    SpinLikelihood,
    UnknownSpin,
)
from intuitive_physics.scene import Environment, Plane, Scene, SceneObject
from intuitive_physics.shapes import Sphere
from intuitive_physics.state import ObjectState
from intuitive_physics.trajectory import Trajectory
from intuitive_physics_learner import ConvergenceCriteria, LearningOptions, TrajectoryCost, learn
from intuitive_physics_learner.given_parameters import given_parameters
from intuitive_physics_learner.joint_estimation.joint_fit import JointEstimationSettings, JointFit
from intuitive_physics_learner.joint_estimation.normal_equations import (
    NormalEquations,
    joint_posterior,
)
from intuitive_physics_learner.learning_session import _begin
from intuitive_physics_learner.methods import JOINT_METHOD
from intuitive_physics_learner.online import OnlineOptions
from intuitive_physics_learner.online.online_state import OnlineState
from intuitive_physics_learner.search.gaussian import Gaussian
from intuitive_physics_learner.store import ObservationStore

from .cases import StorelessLearner

STATED = 10.0
"""rad/s, the guess of perception."""

KNOWN = InitialSpins({"ball": SpinSpread(2.5, 6.0, STATED)})

MATERIALS = ["ball", "floor"]
RUBBER = StaticParameters.uniform(
    MATERIALS, static_friction=0.45, dynamic_friction=0.45, rolling_friction=0.015, restitution=0.8
)
CORNER = Environment(
    [
        Plane("floor", "floor", (0, 0, 1), 0.0),
        Plane("wall", "floor", (-1, 0, 0), -2.0),
        Plane("other wall", "floor", (0, 1, 0), -1.5),
    ]
)
OPTIONS = LearningOptions(JOINT_METHOD, ConvergenceCriteria(700))


def measured(spin, deviation, prior=STATED, material="ball"):
    """Posterior of a spin that was measured with a deviation on each axis, under a prior."""
    deviation = np.broadcast_to(deviation, 3)
    variances = 1.0 / (deviation**-2.0 + prior**-2.0)
    mean = variances * deviation**-2.0 * spin
    places = np.arange(3)
    return SpinLikelihood.of(UnknownSpin(material, STATED, places), mean, np.diag(variances), prior)


def spread_of(likelihoods, weight=1.0):
    evidence = SpinEvidence()
    evidence.add_all(likelihoods, weight)
    return evidence.initial_spins().by_material["ball"]


def throws(simulator, count, seed, sigma, frames=45, known_spin=False, guess=STATED):
    """Observe rubber balls thrown into a corner with spins N(0, σ² I), 2 mm of noise at 30 Hz."""
    generator = np.random.default_rng(seed)
    ball, times, observed = SceneObject("ball", "ball", Sphere(0.05)), np.arange(frames) / 30.0, []
    for _ in range(count):
        position = generator.uniform((-0.3, -0.3, 0.5), (0.3, 0.3, 0.9))
        velocity = generator.uniform((1.0, -1.0, -0.5), (2.2, 1.0, 1.0))
        spin = sigma * generator.normal(size=3)
        start = ObjectState(position, linear_velocity=velocity, angular_velocity=spin)
        rollout = simulator.rollout([Scene(CORNER, (ball,), (start,))], RUBBER, times)
        points = rollout.positions[0, 0] + generator.normal(0.0, 0.002, (frames, 3))
        believed = ObjectState(
            position + generator.normal(0.0, 0.001, 3),
            linear_velocity=velocity + generator.normal(0.0, 0.004, 3),
            angular_velocity=known_spin * spin,
            covariance=np.diag(np.repeat([1e-6, 0.0, 16e-6, (not known_spin) * guess**2], 3)),
        )
        observed.append(
            Observation(CORNER, (ObservedObject(ball, Trajectory(times, points), believed),), 0.0)
        )
    return observed


def distance(spread, sigma):
    """How many standard errors an estimate is off."""
    return abs(np.log(spread.deviation / sigma)) / spread.relative_error


@given(st.integers(0, 1000))
def test_the_likelihood_is_that_of_the_normal_distribution(seed):
    generator = np.random.default_rng(seed)
    root = generator.normal(size=(3, 3)) * generator.uniform(0.5, 20.0)
    covariance, mean = root @ root.T + 0.1 * np.eye(3), generator.normal(size=3) * 10.0
    whole = np.linalg.inv(covariance)
    posterior = np.linalg.inv(whole + STATED**-2 * np.eye(3))
    likelihood = SpinLikelihood.of(
        UnknownSpin("ball", STATED, np.arange(3)), posterior @ whole @ mean, posterior, STATED
    )
    got, _ = likelihood.on_grid()
    for k in (0, 60, 75, 100):
        spread = np.exp(2.0 * GRID[k]) * np.eye(3) + covariance
        true = multivariate_normal(np.zeros(3), spread).logpdf(mean)
        none = multivariate_normal(np.zeros(3), covariance).logpdf(mean)
        assert got[k] == pytest.approx(true - none, rel=1e-5, abs=1e-4)


@pytest.mark.parametrize("sigma", [2.0, 10.0, 40.0, 200.0])
def test_the_spread_is_recovered_with_its_stated_error(sigma):
    distances = []
    for seed in range(40):
        generator, noise = np.random.default_rng(seed), 0.3 * sigma
        points = generator.normal(0.0, sigma, (30, 3)) + generator.normal(0.0, noise, (30, 3))
        spread = spread_of([measured(spin, noise) for spin in points])
        distances.append(distance(spread, sigma))
        assert 20.0 < spread.count <= 30.0
    # Of 40 honest ones 27 ± 3 are below one and 38 ± 1.3 below two.
    assert np.mean(np.array(distances) < 1.0) > 0.45
    assert np.mean(np.array(distances) < 2.0) > 0.82


def test_nothing_is_known_without_a_throw():
    assert not SpinEvidence().initial_spins()


def test_one_throw_moves_the_guess_part_of_the_way_and_more_of_them_farther():
    for spin in (2.0, 40.0):
        moves = []
        for count in (1, 3, 10, 100):
            spread = spread_of([measured(np.full(3, spin), 1e-3)] * count)
            assert spread.count == pytest.approx(count, rel=1e-3)
            assert spread.stated == pytest.approx(STATED)
            moves.append(np.log(spread.deviation / STATED) / np.log(spin / STATED))
        assert np.all(np.diff(moves) > 0.0)
        assert 0.5 < moves[0] < 0.97
        assert moves[-1] == pytest.approx(1.0, abs=0.02)


def test_uninformative_throw_moves_nothing():
    nothing = SpinLikelihood.of(
        UnknownSpin("ball", STATED, np.arange(3)), np.zeros(3), STATED**2 * np.eye(3), STATED
    )
    alone = spread_of([nothing] * 100)
    assert (alone.deviation, alone.count) == (pytest.approx(STATED), 0.0)
    # Of a throw that says something of one axis, one axis counts.
    one_axis = measured(np.array([3.0, 0.0, 0.0]), np.array([1e-3, 1e9, 1e9]))
    assert spread_of([one_axis]).count == pytest.approx(1.0 / 3.0, rel=1e-3)
    with_nothing, without = spread_of([one_axis, *[nothing] * 50]), spread_of([one_axis])
    assert with_nothing.deviation == pytest.approx(without.deviation, rel=1e-12)
    assert with_nothing.count == pytest.approx(without.count, rel=1e-12)


@given(st.lists(st.floats(-50.0, 50.0), min_size=1, max_size=6), st.randoms())
def test_the_order_of_throws_is_nothing(spins, random):
    likelihoods = [measured(np.array([spin, 2.0, -1.0]), 0.5) for spin in spins]
    shuffled = random.sample(likelihoods, len(likelihoods))
    a, b = spread_of(likelihoods), spread_of(shuffled)
    assert (a.deviation, a.count) == (pytest.approx(b.deviation), pytest.approx(b.count))


@given(st.floats(1.0, 100.0))
def test_the_prior_of_the_fit_is_taken_out(prior):
    spin = np.array([3.0, -7.0, 12.0])
    wanted, got = measured(spin, 0.7), measured(spin, 0.7, prior)
    np.testing.assert_allclose(got.precision, wanted.precision, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(got.pull, wanted.pull, rtol=1e-6, atol=1e-9)


@given(st.floats(0.5, 300.0), st.floats(0.1, 1000.0))
def test_evidence_from_a_published_version(deviation, count):
    spins = InitialSpins({"ball": SpinSpread(deviation, count, STATED)})
    (again,) = SpinEvidence.about(spins).initial_spins().by_material.values()
    assert again.deviation == pytest.approx(deviation, rel=1e-3)
    assert again.count == pytest.approx(count)


def test_forgotten_evidence_leaves_the_guess():
    evidence = SpinEvidence()
    evidence.add_all([measured(np.full(3, 2.0), 0.1)] * 20)
    counts, deviations = [], []
    for _ in range(5):
        (spread,) = evidence.initial_spins().by_material.values()
        counts.append(spread.count)
        deviations.append(spread.deviation)
        evidence.discount(0.1)
    np.testing.assert_allclose(np.array(counts[1:]) / counts[:-1], 0.1, rtol=0.02)
    assert np.all(np.diff(deviations) > 0.0)
    assert deviations[-1] == pytest.approx(STATED, rel=0.1)


@given(st.floats(-50.0, 50.0))
def test_evidence_survives_json(spin):
    evidence, likelihood = SpinEvidence(), measured(np.array([spin, 1.0, 2.0]), 0.3)
    again = SpinLikelihood.from_dict(json.loads(json.dumps(likelihood.to_dict())))
    evidence.add_all([again], 0.3)
    read = SpinEvidence.from_dict(json.loads(json.dumps(evidence.to_dict())))
    assert read.to_dict() == evidence.to_dict()
    assert read.initial_spins() == evidence.initial_spins()


@pytest.mark.parametrize("sigma", [2.0, 10.0, 40.0])
def test_learned_in_batch_and_on_line_alike(event_driven, sigma):
    observed = throws(event_driven, 16, 3, sigma)
    batch = learn(observed, event_driven, OPTIONS).learned.initial_spins.by_material["ball"]
    assert distance(batch, sigma) < 2.5
    assert 8.0 < batch.count < 16.0
    assert batch.stated == pytest.approx(STATED)
    learner = StorelessLearner(event_driven, OnlineOptions(window=8))
    learner.learn_from_all(observed[:8])
    learner = StorelessLearner(
        event_driven,
        OnlineOptions(window=8),
        OnlineState.from_json(learner.state.to_json()),
        learner.seen.values(),
    )
    learner.learn_from_all(observed[8:])
    online = learner.state.published.initial_spins.by_material["ball"]
    assert abs(np.log(online.deviation / batch.deviation)) < 1.5 * batch.relative_error
    assert online.count == pytest.approx(batch.count, rel=0.25)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_spread_of_spins_converges_with_the_fit(event_driven, seed):
    # The estimate suits the spread of the step before: taken for the posterior's mean, a narrow
    # spread and spins of before make a wide one, and that one with spins of no size a narrow one.
    observed = throws(event_driven, 5, seed, 0.1, frames=150, guess=0.1)
    _, task = _begin(observed, event_driven, OPTIONS, None, TrajectoryCost)
    fit = JointFit(task.fit_task, JointEstimationSettings())
    deviations = []
    while not fit.settled and fit.steps < 40:
        fit.step()
        deviations.append(fit.model.spins.by_material["ball"].deviation)
    assert fit.settled
    assert deviations[-1] == pytest.approx(deviations[-2], rel=0.2)
    assert deviations[-1] == pytest.approx(0.1, rel=0.5)


@given(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0))
def test_posterior_means_are_the_same_wherever_a_linear_problem_is_linearised(state, unit):
    # y = s + u of variance v, s ~ N(0, a²), u ~ N(m, b²): E s = a² (y - m) / (a² + b² + v).
    y, v, a, m, b = 1.2, 0.3, 0.7, 0.4, 0.2
    hessian = np.array([[[1.0 / v + a**-2, 1.0 / v], [1.0 / v, 1.0 / v]]])
    gradient = np.array([[(state + unit - y) / v + state * a**-2, (state + unit - y) / v]])
    eliminated = NormalEquations(np.array([0]), np.array([[0]]), 1, hessian, gradient).eliminated()
    prior = Gaussian.about(np.array([m]), np.array([[b**-2]]))
    posterior = joint_posterior(prior, np.array([unit]), [eliminated], np.ones(1))
    means = eliminated.state_means(np.array([[state]]), np.array([unit]), posterior)
    assert means[0, 0] == pytest.approx(a**2 * (y - m) / (a**2 + b**2 + v))


def test_search_without_spins_keeps_earlier_spins(event_driven):
    observed = throws(event_driven, 2, 0, 2.0, frames=15)
    first = learn(observed, event_driven, OPTIONS).learned
    rule = LearningOptions("random", ConvergenceCriteria(5))
    after = learn(observed, event_driven, rule, previous=replace(first, initial_spins=KNOWN))
    assert after.learned.initial_spins == KNOWN
    # A spin that was measured is none of which balls are thrown with unseen.
    observations = throws(event_driven, 2, 0, 2.0, frames=15, known_spin=True)
    assert not learn(observations, event_driven, OPTIONS).learned.initial_spins


def test_a_fit_continues_exactly_with_its_widened_priors(event_driven):
    observed = throws(event_driven, 4, 5, 100.0)
    states: list[dict] = []
    whole = learn(observed, event_driven, OPTIONS, on_checkpoint=states.append).learned
    state = json.loads(json.dumps(states[-1], allow_nan=False))
    again = learn(observed, event_driven, OPTIONS, resume=state).learned
    assert again.initial_spins == whole.initial_spins


@settings(max_examples=10)
@given(st.integers(1, 6))
def test_adopted_spins_are_kept_and_later_throws_add_to_them(count):
    learner = StorelessLearner(None)
    spins = InitialSpins({"ball": SpinSpread(2.5, float(count), STATED)})
    from_others = replace(LearnedParameters.defaults(MATERIALS), initial_spins=spins)
    learner.adopt(from_others, informed=True)
    (spread,) = learner.state.initial_spins().by_material.values()
    assert spread.deviation == pytest.approx(2.5, rel=1e-3)
    learner.adopt(from_others, informed=False)
    assert not learner.state.initial_spins()


def test_a_version_keeps_them_in_the_store(tmp_path):
    learned = replace(LearnedParameters.defaults(MATERIALS), initial_spins=KNOWN)
    with ObservationStore(tmp_path / "store.db") as store:
        store.add_parameters(learned)
    with ObservationStore(tmp_path / "store.db") as store:
        assert store.newest_parameters().initial_spins == KNOWN


def test_values_that_a_user_gives_leave_them_unless_he_gives_others():
    defaults = LearnedParameters.defaults(MATERIALS)
    newest = replace(defaults, initial_spins=KNOWN)
    assert given_parameters(defaults, newest=newest).initial_spins == KNOWN
    others = InitialSpins({"floor": SpinSpread(7.0, 1.0, STATED)})
    given = replace(defaults, initial_spins=others)
    both = given_parameters(given, newest=newest).initial_spins
    assert both == KNOWN.updated(others)
    # Single parameters say nothing of throws.
    named = given_parameters(given, names=["density[ball]"], newest=newest)
    assert named.initial_spins == KNOWN
    assert given_parameters(given).initial_spins == others
