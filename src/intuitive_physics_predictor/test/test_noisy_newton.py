"""Draws of θ_d and the distributions they lead to."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import ndtri

from intuitive_physics.errors import InvalidInputError, UnknownNameError, UnsupportedSceneError
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.materials import StaticParameters, parameter_count
from intuitive_physics.prior_knowledge.initial_spins import InitialSpins, SpinSpread
from intuitive_physics.scene import Environment, Plane, Scene, SceneObject
from intuitive_physics.shapes import Box, Sphere
from intuitive_physics.simulation import WorldStatus, make_simulator
from intuitive_physics.simulation.contact_noise import ContactNoise
from intuitive_physics.state import ObjectState
from intuitive_physics_predictor.noise import (
    StateNoise,
    StateSpread,
    with_spin_prior,
)
from intuitive_physics_predictor.noisy_newton import (
    PredictionFailedError,
    PreparedScene,
    predict,
)
from intuitive_physics_predictor.parameter_uncertainty import UncertainParameters

G = 9.81
THETA = StaticParameters.uniform(["ball", "floor"])


def flying_scene(covariance=None, height=100.0, velocity=(1.0, 0.0, 0.0), count=1) -> Scene:
    floor = Environment([Plane("floor", "floor", (0, 0, 1), 0.0)])
    objects = tuple(SceneObject(f"ball_{k}", "ball", Sphere(0.05)) for k in range(count))
    states = tuple(
        ObjectState((3.0 * k, 0, height), (0, 0, 0, 1), velocity, (0, 0, 0), covariance)
        for k in range(count)
    )
    return Scene(floor, objects, states)


def random_covariance(seed):
    root = np.random.default_rng(seed).normal(size=(12, 12)) * 0.01
    return root @ root.T


def test_drawn_states_have_the_perceived_covariance():
    # Of n draws the sample covariance is off by about sqrt(2 / n) of itself.
    covariance = random_covariance(0)
    state = ObjectState((1, 2, 3), (0, 0, 0, 1), (4, 5, 6), (7, 8, 9), covariance)
    n = 40_000
    drawn = StateSpread.of([state], StateNoise()).draw(n, np.random.default_rng(1))[:, 0]
    # Small rotations: the rotation vector is twice the quaternion's vector part.
    errors = np.hstack([drawn[:, 0:3], 2 * drawn[:, 3:6], drawn[:, 7:13]])
    np.testing.assert_allclose(
        np.cov(errors.T), covariance, atol=4 * np.sqrt(2 / n) * covariance.max()
    )
    expected = np.concatenate([state.position, state.linear_velocity, state.angular_velocity])
    np.testing.assert_allclose(drawn[:, [0, 1, 2, *range(7, 13)]].mean(axis=0), expected, atol=1e-3)


def test_fixed_noise_is_the_papers_option():
    # N(0, σ) on each axis of each part, whatever was perceived.
    noise = StateNoise(
        perceived=False, position=0.1, rotation=0.02, linear_velocity=0.3, angular_velocity=0.4
    )
    state = ObjectState((0, 0, 0), covariance=np.eye(12))
    drawn = StateSpread.of([state], noise).draw(20_000, np.random.default_rng(0))[:, 0]
    spread = drawn.std(axis=0)
    truth = [0.1] * 3 + [0.01] * 3 + [0.3] * 3 + [0.4] * 3
    np.testing.assert_allclose(spread[[*range(6), *range(7, 13)]], truth, rtol=0.03)


def spin_scene(guess):
    covariance = np.diag(np.repeat([1e-6, 0.0, 1e-4, guess**2], 3))
    return flying_scene(covariance)


def thrown_with(deviation, material="ball"):
    spins = InitialSpins({material: SpinSpread(deviation, 12.0, 10.0)})
    return replace(LearnedParameters.defaults(["ball", "floor"]), initial_spins=spins)


@pytest.mark.parametrize(
    ("prior", "guess", "learned", "drawn"),
    [
        ("learned", 10.0, thrown_with(2.0), 2.0),
        ("learned", 10.0, thrown_with(40.0), 40.0),
        # Nothing is known of this material, or of any, or the spin was seen to be about zero.
        ("learned", 10.0, thrown_with(2.0, "floor"), 10.0),
        ("learned", 10.0, LearnedParameters.defaults(["ball", "floor"]), 10.0),
        ("learned", 0.5, thrown_with(2.0), 0.5),
        ("perceived", 10.0, thrown_with(2.0), 10.0),
        ("fixed", 10.0, thrown_with(2.0), 0.0),
    ],
)
def test_an_unseen_spin_is_drawn_as_balls_are_thrown(prior, guess, learned, drawn):
    scene = spin_scene(guess)
    noise = StateNoise(angular_velocity=3.0, spin_prior=prior)
    prepared = PreparedScene.of(scene, UncertainParameters(learned), noise)
    states = prepared.spread.draw(4000, np.random.default_rng(0))[:, 0]
    expected = [0.001] * 3 + [0.01] * 3 + [np.hypot(drawn, 3.0)] * 3
    np.testing.assert_allclose(states[:, [0, 1, 2, *range(7, 13)]].std(axis=0), expected, rtol=0.05)
    assert prepared.scene is scene


def test_learned_spins_are_for_unseen_spins_alone():
    scene, learned = spin_scene(10.0), thrown_with(2.0)
    (state,), (ball,) = scene.states, scene.objects
    rolling = state.covariance.copy()
    rolling[9, 9] = 1.0
    seen = state.with_covariance(rolling)
    assert with_spin_prior(seen, ball, learned) is seen


def test_wrong_spin_prior():
    with pytest.raises(UnknownNameError, match="spin prior is 'guess'; expected one of learned,"):
        StateNoise(spin_prior="guess")


@given(st.integers(0, 2**31), st.integers(1, 3), st.integers(1, 5))
@settings(max_examples=30, deadline=None)
def test_drawn_orientations_are_unit(seed, objects, count):
    scene = flying_scene(np.eye(12) * 9.0, count=objects)
    drawn = StateSpread.of(scene.states, StateNoise()).draw(count, np.random.default_rng(seed))
    assert drawn.shape == (count, objects, 13)
    np.testing.assert_allclose(np.linalg.norm(drawn[..., 3:7], axis=-1), 1.0, atol=1e-12)


def test_free_flight_spreads_as_theory_says():
    # x(t) = x0 + v0 t + g t²/2: the covariance is Σ_xx + t (Σ_xv + Σ_vx) + t² Σ_vv.
    covariance = random_covariance(3)
    times = np.array([0.0, 0.5, 1.0])
    distribution = predict(
        flying_scene(covariance), THETA, times, rng=np.random.default_rng(0), sample_count=20_000
    )
    xx, xv, vv = covariance[:3, :3], covariance[:3, 6:9], covariance[6:9, 6:9]
    for k, t in enumerate(times):
        truth = xx + t * (xv + xv.T) + t**2 * vv
        np.testing.assert_allclose(
            distribution.covariance[0, k], truth, atol=0.04 * np.trace(truth)
        )
        centre = np.array([t, 0, 100 - 0.5 * G * t**2])
        np.testing.assert_allclose(
            distribution.mean[0, k], centre, atol=5 * np.sqrt(np.trace(truth) / 20_000)
        )


def test_exactly_known_states_have_one_future():
    distribution = predict(flying_scene(), THETA, [0.0, 1.0], rng=np.random.default_rng(0))
    assert distribution.positions.shape == (20, 1, 2, 3)
    assert np.ptp(distribution.positions, axis=0).max() == 0.0
    assert distribution.weights.sum() == pytest.approx(1.0)


def test_same_seed_same_answer_and_other_seed_another():
    scene = flying_scene(np.eye(12) * 1e-4, height=0.5)
    times = np.linspace(0, 2, 20)

    def run(seed):
        return predict(scene, THETA, times, rng=np.random.default_rng(seed)).positions

    np.testing.assert_array_equal(run(5), run(5))
    assert (run(5) != run(6)).any()


def test_material_uncertainty_spreads_the_rebound():
    # Dropped from rest at height h a ball rises to e² h: x(e) is monotonous, so the quantiles of
    # the height follow from those of e.
    size = parameter_count(2)
    learned = LearnedParameters(
        THETA, np.full(size, 0.05), np.ones(size, bool), 1, 0.0, 1, "cma_es"
    )
    h, r, e = 1.0, 0.05, 0.5
    fall = np.sqrt(2 * h / G)
    time = fall * (1 + e)  # the top of the mean rebound
    scene = flying_scene(height=h + r, velocity=(0, 0, 0))
    heights = predict(
        scene,
        UncertainParameters(learned),
        [time],
        rng=np.random.default_rng(0),
        sample_count=4000,
    ).of("ball_0")[:, 0, 2]
    restitutions = e + 0.05 * ndtri(np.array([0.1, 0.5, 0.9]))
    since = time - fall
    truth = r + restitutions * G * fall * since - 0.5 * G * since**2
    # Of n draws the q-quantile is off by some sqrt(q (1 - q) / n) / density, 0.3 % of h here.
    np.testing.assert_allclose(np.quantile(heights, [0.1, 0.5, 0.9]), truth, atol=0.01)


def test_size_noise_spreads_where_a_ball_lies():
    # Perceived at the height of its mean radius it comes to lie at the height of its own.
    scene = flying_scene(height=0.5, velocity=(0, 0, 0))
    heights = predict(
        scene, THETA, [5.0], rng=np.random.default_rng(0), sample_count=2000, size_noise=0.1
    ).of("ball_0")[:, 0, 2]
    np.testing.assert_allclose(np.log(heights / 0.05).std(), 0.1, rtol=0.06)


def test_scaled_noise_is_scaled():
    covariance = random_covariance(1)
    state = ObjectState((0, 0, 0), covariance=covariance)
    scaled = StateNoise(scale=2.0, spin_scale=3.0).covariance(state)
    np.testing.assert_allclose(scaled[:9, :9], 4 * covariance[:9, :9])
    np.testing.assert_allclose(scaled[9:, 9:], 9 * covariance[9:, 9:])
    np.testing.assert_allclose(scaled[:9, 9:], 6 * covariance[:9, 9:])


def test_two_futures_stay_two():
    # A ball dropped on a ball that lies on the floor goes left or right: the samples lie on both
    # sides, and hardly any near their mean in between.
    floor = Environment([Plane("floor", "floor", (0, 0, 1), 0.0)])
    scene = Scene(
        floor,
        (SceneObject("top", "ball", Sphere(0.05)), SceneObject("bottom", "ball", Sphere(0.05))),
        (
            ObjectState((0, 0, 0.4), covariance=np.diag([1e-4] + [0] * 11)),
            ObjectState((0, 0, 0.05)),
        ),
    )
    distribution = predict(scene, THETA, [0.0, 2.0], rng=np.random.default_rng(0), sample_count=200)
    sideways = distribution.of("top")[:, 1, 0]
    assert (sideways > 0.1).sum() > 60
    assert (sideways < -0.1).sum() > 60
    assert abs(distribution.mean[0, 1, 0]) < 0.1


def test_invalid_prediction_is_refused():
    rng = np.random.default_rng(0)
    with pytest.raises(InvalidInputError, match="sample count"):
        predict(flying_scene(), THETA, [1.0], rng=rng, sample_count=0)
    with pytest.raises(UnknownNameError, match="'ball'"):
        predict(flying_scene(), StaticParameters.uniform(["floor"]), [1.0], rng=rng)
    with pytest.raises(PredictionFailedError, match="none of 3"):
        predict(
            flying_scene(velocity=(1e308, 1e308, -1e308)), THETA, [1.0], rng=rng, sample_count=3
        )
    with pytest.raises(InvalidInputError, match="noise"):
        StateNoise(position=-1.0)
    with pytest.raises(InvalidInputError, match="noise"):
        StateNoise(linear_velocity=float("nan"))
    with pytest.raises(UnsupportedSceneError, match="friction"):
        predict(box_scene(), THETA, [1.0], rng=rng, simulator=make_simulator("bullet"))


@pytest.mark.parametrize(("height", "falls"), [(-0.01, False), (-0.04, True)])
def test_a_ball_perceived_in_a_table_top_does_not_end_the_prediction(height, falls):
    # It is held if its centre is behind by less than half a radius, else it is below and falls.
    corners = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]
    table = Environment([Plane("table", "floor", (0, 0, 1), 0.0, corners)])
    state = ObjectState((0, 0, height), covariance=np.eye(12) * 1e-8)
    scene = Scene(table, (SceneObject("ball", "ball", Sphere(0.05)),), (state,))
    predicted = predict(scene, THETA, [0.5], rng=np.random.default_rng(1), sample_count=20)
    assert predicted.failed_count == 0
    assert ((predicted.positions[..., 2] < -0.5) == falls).all()


class HalfFails:
    """Simulator in which every second world fails."""

    def rollout_batch(self, worlds, times, *, orientations=False, push_out=False):
        rollout = make_simulator("auto").rollout_batch(worlds, times, orientations=orientations)
        status = rollout.status.copy()
        status[::2] = WorldStatus.NOT_FINITE
        return replace(rollout, status=status)


def test_samples_that_fail_are_left_out_and_counted():
    whole, half = (
        predict(
            flying_scene(np.eye(12) * 1e-4),
            THETA,
            [0.1],
            rng=np.random.default_rng(1),
            sample_count=5,
            simulator=simulator,
        )
        for simulator in (None, HalfFails())
    )
    assert (whole.failed_count, half.failed_count) == (0, 3)
    np.testing.assert_array_equal(half.positions, whole.positions[1::2])
    np.testing.assert_allclose(half.weights, 0.5)


def box_scene():
    scene = flying_scene()
    box = SceneObject("b", "ball", Box((0.1, 0.1, 0.1)))
    return Scene(scene.environment, (box,), scene.states)


def test_any_shape_is_predicted_without_a_word_about_engines():
    # In free flight a box moves as a ball does.
    box, ball = (
        predict(scene, THETA, [0.1], rng=np.random.default_rng(0)).positions
        for scene in (box_scene(), flying_scene())
    )
    np.testing.assert_allclose(box, ball, atol=1e-9)


def predicted_heights(contact_noise, samples=1500):
    """Heights (n_samples,) of a ball dropped from 1 m at e = 0.6, 0.3 s after its first bounce."""
    theta = StaticParameters.uniform(["ball", "floor"], restitution=0.6)
    return predict(
        flying_scene(height=1.05, velocity=(0, 0, 0)),
        theta,
        [np.sqrt(2 / G) + 0.3],
        rng=np.random.default_rng(4),
        sample_count=samples,
        contact_noise=contact_noise,
    ).positions[:, 0, 0, 2]


def test_noise_at_impacts_spreads_what_follows_them():
    # z = (e + σ z) v t - g t²/2 after the bounce: standard deviation σ v t.
    heights = predicted_heights(ContactNoise(restitution=0.03))
    spread = 0.03 * np.sqrt(2 * G) * 0.3
    assert abs(heights.std() / spread - 1) < 4.5 / np.sqrt(2 * heights.size)


def test_no_noise_at_impacts_is_none():
    still = predicted_heights(None, samples=3)
    np.testing.assert_array_equal(still, predicted_heights(ContactNoise(), samples=3))
    assert (still == still[0]).all()
