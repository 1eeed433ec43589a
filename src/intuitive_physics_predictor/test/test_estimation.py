"""States by everything that was seen: what bounces say of the spin, and how surely."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2

from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.materials import StaticParameters, parameter_names
from intuitive_physics.observation import Detections, SeenSpin
from intuitive_physics.scene import Environment, Plane, Scene, SceneObject
from intuitive_physics.shapes import Box, Sphere
from intuitive_physics.simulation import make_simulator, pack_worlds
from intuitive_physics.state import ANGULAR_VELOCITY, LINEAR_VELOCITY, POSITION, ObjectState
from intuitive_physics_predictor.estimation import trajectory_fit
from intuitive_physics_predictor.estimation.modes import Modes, derivative_steps, find_modes
from intuitive_physics_predictor.estimation.object_estimate import (
    ObjectEstimate,
    SceneEstimate,
    Surroundings,
)
from intuitive_physics_predictor.estimation.pair_knowledge import PairKnowledge
from intuitive_physics_predictor.estimation.weighted_states import WeightedStates, draw_weighted
from intuitive_physics_predictor.live.live_prediction import Inputs, PerceivedStates
from intuitive_physics_predictor.live.predictor import Predictor
from intuitive_physics_predictor.live.settings import PredictionOptions, PredictionSettings
from intuitive_physics_predictor.noise import StateNoise
from intuitive_physics_predictor.noisy_newton import PreparedScene
from intuitive_physics_predictor.parameter_uncertainty import UncertainParameters

RADIUS = 0.05
BALL = SceneObject("ball", "rubber", Sphere(RADIUS))
ROOM = Environment([Plane("floor", "room", (0, 0, 1), 0.0)], frame_id="room")
MATERIALS = ("rubber", "room")
SIMULATOR = make_simulator("auto")
NOISE = 0.002
"""m, of each coordinate of a detection."""
STEP = 1.0 / 30.0
"""s between detections."""
PRIOR_SPIN = 10.0
"""rad/s about each axis."""


def learned(friction=0.5, restitution=0.7):
    parameters = StaticParameters.uniform(
        MATERIALS,
        static_friction=friction,
        dynamic_friction=friction,
        rolling_friction=0.01,
        restitution=restitution,
    )
    count = len(parameter_names(MATERIALS))
    return LearnedParameters(
        parameters, np.full(count, 1e-4), np.ones(count, dtype=bool), 1, 0.001, 10, "cma_es"
    )


def surroundings(environment=ROOM, **coefficients):
    return Surroundings(environment, UncertainParameters(learned(**coefficients)), SIMULATOR)


def world_of(around):
    scene = Scene(around.environment, (BALL,), (ObjectState((0, 0, 1)),))
    return pack_worlds([scene], around.uncertain.learned.parameters)


def path_of(around, state, times):
    """True positions (n, 3), m."""
    worlds = world_of(around).repeated(state.to_vector()[None, None])
    return SIMULATOR.rollout_batch(worlds, times, orientations=False).positions[0, 0]


def uncertain(state, spin=PRIOR_SPIN, rng=None):
    """A state as it is perceived: 1 mm and 4 mm/s off, the spin unknown."""
    variances = np.zeros(12)
    variances[POSITION], variances[LINEAR_VELOCITY] = 1e-6, 16e-6
    variances[ANGULAR_VELOCITY] = spin**2
    errors = np.zeros(6) if rng is None else rng.standard_normal(6)
    return ObjectState(
        state.position + 1e-3 * errors[:3],
        linear_velocity=state.linear_velocity + 4e-3 * errors[3:],
        covariance=np.diag(variances),
    )


def seen_flight(around, start, count):
    """Yield time, perceived state and detection of each frame of an exact flight."""
    times = STEP * np.arange(count)
    path = path_of(around, start, np.sort([*times, *(times + 1e-4)])).reshape(count, 2, 3)
    for time, (place, next_place) in zip(times, path, strict=True):
        state = ObjectState(place, linear_velocity=(next_place - place) / 1e-4)
        yield time, uncertain(state), detection(time, place)


def effective_count(states):
    """Number of independent samples with as much information, 1 / Σ w²."""
    return 1.0 / (states.weights @ states.weights)


def detection(time, position, bias=0.0):
    return Detections([time], position[None], NOISE**2 * np.eye(3)[None], bias**2 * np.eye(3))


NOTHING = Detections([-1.0], np.zeros((1, 3)), np.eye(3)[None], np.zeros((3, 3)))
"""Detections before the beginning."""


def estimate_of(around, frames):
    """Follow a ball through frames of time, perceived state and detection."""
    estimate = ObjectEstimate(np.random.default_rng(3))
    for time, state, detected in frames:
        estimate.update(around, BALL, state, time, detected)
    return estimate


def followed(around, state, duration, rng, spin=PRIOR_SPIN):
    """Follow a ball from `state` on for `duration` s; return the states at the end, and when."""
    times = STEP * np.arange(1, round(duration / STEP) + 1)
    places = path_of(around, state, times) + NOISE * rng.standard_normal((len(times), 3))
    frames = [(0.0, uncertain(state, spin, rng), NOTHING)]
    for time, place in zip(times, places, strict=True):
        frames.append((time, uncertain(state, spin), detection(time, place)))
    return estimate_of(around, frames).states, float(times[-1])


def test_a_bounce_that_sticks_gives_the_spin_along_its_plane():
    # A solid ball (κ = 2/5) that sticks leaves with v' = (v + κ r ω × n …) / (1 + κ), rolling:
    # ω' = n × v' / r. The spin after the bounce is known as well as v': to 0.1 m/s / r here.
    around = surroundings(friction=1.0)
    start = ObjectState((0, 0, 0.4), linear_velocity=(0.6, 0.2, -1.0), angular_velocity=(4, -7, 2))
    states, _ = followed(around, start, 0.5, np.random.default_rng(1))
    mean, covariance = states.moments
    rolling = np.cross([0, 0, 1], mean[3:6]) / RADIUS
    np.testing.assert_allclose(mean[6:8], rolling[:2], atol=0.02)
    assert np.sqrt(covariance[[6, 7], [6, 7]]).max() < 0.1 / RADIUS * 0.5
    # About the normal nothing acts: what was not known before is not known now.
    assert np.sqrt(covariance[8, 8]) == pytest.approx(PRIOR_SPIN, rel=0.3)


@pytest.mark.parametrize("spin", [10.0, 36.0, 100.0])
def test_bounces_say_nothing_of_the_spin_about_their_normal_however_wide_it_is(spin):
    # From 1 m it bounces after (2 · 0.95 / g)^½ = 0.44 s and, with e = 0.7, 0.62 s later again. The
    # normal is no axis of the coordinates.
    normal = np.array([1.0, 2.0, 3.0]) / np.sqrt(14.0)
    room = Environment(
        [Plane("floor", "room", normal, 0.0)], gravity=-9.81 * normal, frame_id="room"
    )
    around = surroundings(room)
    across, along = np.array([2.0, -1.0, 0.0]) / np.sqrt(5.0), np.array([0.6, 0.0, -0.2])
    start = ObjectState(
        normal, linear_velocity=along, angular_velocity=spin * (0.5 * across + 2.0 * normal)
    )
    states, _ = followed(around, start, 0.9, np.random.default_rng(1), spin)
    mean, covariance = states.moments
    deviation = np.sqrt(normal @ covariance[6:9, 6:9] @ normal)
    assert deviation == pytest.approx(spin, rel=0.2)
    assert abs(mean[6:9] @ normal) < 0.3 * spin
    # Weights of a posterior that is normal are nearly alike: widening by 1.1 leaves 80 % of 200.
    assert effective_count(states) > 120


def test_a_bounce_that_slips_gives_the_direction_of_the_slip_only():
    # Friction is μ (1 + e) v_n along the slip, whatever its speed: along it the spin stays as
    # unknown as it was, across it the direction of the slip tells it.
    around = surroundings(friction=0.05)
    start = ObjectState((0, 0, 0.4), linear_velocity=(2.0, 0.0, -1.0), angular_velocity=(3, 5, 0))
    states, _ = followed(around, start, 0.5, np.random.default_rng(2))
    _, covariance = states.moments
    # The slip is along x: the spin about y moves the point of contact along x.
    assert np.sqrt(covariance[7, 7]) > 0.6 * PRIOR_SPIN


@pytest.mark.parametrize("spin", [2.0, 10.0, 40.0])
def test_the_spin_is_within_its_uncertainty(spin):
    # Squared error of the spin in variances: χ² of 3 degrees of freedom, here no larger than that
    # of 99.9 % for the sum of all throws; `CORRELATION` makes it smaller.
    rng = np.random.default_rng(4)
    around = surroundings()
    squares, count = 0.0, 12
    for _ in range(count):
        start = ObjectState(
            (*rng.uniform(-0.3, 0.3, 2), rng.uniform(0.4, 0.7)),
            linear_velocity=(*rng.uniform(-1.0, 1.0, 2), rng.uniform(-0.5, 0.5)),
            angular_velocity=spin * rng.standard_normal(3),
        )
        states, time = followed(around, start, 0.7, rng, spin)
        mean, covariance = states.moments
        apart = mean[6:9] - spin_at(around, start, time)
        squares += apart @ np.linalg.solve(covariance[6:9, 6:9] + 1e-4 * np.eye(3), apart)
    assert squares < chi2.ppf(0.999, 3 * count)


def spin_at(around, state, time):
    """True spin (3,) rad/s after `time` s, from how the ball turns in 0.1 ms."""
    worlds = world_of(around).repeated(state.to_vector()[None, None])
    turns = SIMULATOR.rollout_batch(worlds, [time, time + 1e-4, time + 2e-4]).orientations[:, 0]
    return trajectory_fit._turn(turns[:, 0], turns[:, 1])[0] / 1e-4


SURFACE = 0.5
"""rad/s about each axis, error of a spin that the surface shows."""


def shown(around, state, duration, rng, begun=0.0):
    """Follow a ball whose surface shows its first spin in every frame; return the states then.

    Parameters
    ----------
    begun : s since when the ball was seen before the first state
    """
    spin = SeenSpin(state.angular_velocity + SURFACE, SURFACE**2 * np.eye(3), -begun)
    perceived = uncertain(state, rng=rng)
    if begun > 0.0:
        # As perception publishes it: the product of the guess and of what the surface shows.
        variances = np.diag(perceived.covariance).copy()
        variances[ANGULAR_VELOCITY] = 1.0 / (PRIOR_SPIN**-2 + SURFACE**-2)
        mean = spin.mean * variances[ANGULAR_VELOCITY] / SURFACE**2
        perceived = ObjectState(
            perceived.position,
            linear_velocity=perceived.linear_velocity,
            angular_velocity=mean,
            covariance=np.diag(variances),
        )
    frames = [(0.0, perceived, replace(NOTHING, spin=spin if begun > 0.0 else None))]
    times = STEP * np.arange(1, round(duration / STEP) + 1)
    for time, place in zip(times, path_of(around, state, times), strict=True):
        frames.append((time, perceived, replace(detection(time, place), spin=spin)))
    return estimate_of(around, frames).states


@pytest.mark.parametrize("begun", [0.0, 0.1])
def test_spin_shown_in_one_flight_counts_once(begun):
    # Of the densities N(0, σ₀²) and N(ω + σ, σ²) the product has the variance 1 / (σ₀⁻² + σ⁻²),
    # however many frames say so, and whether the first state has it or not.
    start = ObjectState((0, 0, 1.5), linear_velocity=(1, 0, 1), angular_velocity=(6, -9, 4))
    states = shown(surroundings(), start, 0.4, np.random.default_rng(6), begun)
    mean, covariance = states.moments
    variance = 1.0 / (PRIOR_SPIN**-2 + SURFACE**-2)
    # Standard error of a deviation from samples, and of a mean.
    effective = effective_count(states)
    deviations = np.sqrt(np.diag(covariance)[6:9] / variance)
    np.testing.assert_allclose(deviations, 1.0, atol=4.0 / np.sqrt(2.0 * effective))
    expected = variance / SURFACE**2 * (start.angular_velocity + SURFACE)
    np.testing.assert_allclose(mean[6:9], expected, atol=4.0 * SURFACE / np.sqrt(effective))


def test_the_longest_fit_goes_on_with_what_the_surface_has_shown():
    start = ObjectState((0, 0, 9.0), linear_velocity=(1, 0, 1), angular_velocity=(6, -9, 4))
    states = shown(surroundings(), start, 1.4, np.random.default_rng(7))
    _, covariance = states.moments
    # Two fits follow one another; were the flight counted in both, this would be 0.71 σ.
    deviations = np.sqrt(np.diag(covariance)[6:9]) / SURFACE
    np.testing.assert_allclose(deviations, 1.0, atol=4.0 / np.sqrt(2.0 * effective_count(states)))


def test_the_spin_that_a_surface_showed_is_known_after_the_bounce():
    around = surroundings(friction=0.05)
    start = ObjectState((0, 0, 0.5), linear_velocity=(2, 0.5, 0), angular_velocity=(6, -9, 4))
    times = STEP * np.arange(1, 13)
    path = path_of(around, start, times)
    spin = SeenSpin(start.angular_velocity, SURFACE**2 * np.eye(3), STEP)
    frames = [(0.0, uncertain(start), NOTHING)]
    for time, place in zip(times, path, strict=True):
        shown_spin = spin if time < 0.28 else None
        frames.append((time, uncertain(start), replace(detection(time, place), spin=shown_spin)))
    mean, covariance = estimate_of(around, frames).states.moments
    after = spin_at(around, start, float(times[-1]))
    assert np.linalg.norm(after - start.angular_velocity) > 1.0
    # A slip turns the ball by 5/2 μ (1 + e) v_n / r = 13 rad/s, as surely as μ is known: 20 %.
    assert np.sqrt(np.diag(covariance)[6:9]).max() < 0.3 * PRIOR_SPIN
    apart = mean[6:9] - after
    assert apart @ np.linalg.solve(covariance[6:9, 6:9], apart) < chi2.ppf(0.999, 3)


def test_an_estimate_is_better_than_the_perceived_state_after_a_bounce():
    around = surroundings()
    rng = np.random.default_rng(5)
    start = ObjectState((0, 0, 0.5), linear_velocity=(1, 0.5, 0), angular_velocity=(6, -9, 4))
    states, time = followed(around, start, 0.6, rng)
    mean, covariance = states.moments
    true = path_of(around, start, [time, time + 0.5])
    after = ObjectState(mean[:3], linear_velocity=mean[3:6], angular_velocity=mean[6:9])
    ahead = path_of(around, after, [0.5])[0]
    without = ObjectState(mean[:3], linear_velocity=mean[3:6])
    assert np.linalg.norm(mean[:3] - true[0]) < 3.0 * np.sqrt(np.trace(covariance[:3, :3]))
    assert np.linalg.norm(ahead - true[1]) < 0.5 * np.linalg.norm(
        path_of(around, without, [0.5])[0] - true[1]
    )


def test_a_hand_begins_a_new_estimate():
    # Held still in the air: no free flight explains it, and what is perceived is all there is.
    around = surroundings()
    estimate = ObjectEstimate(np.random.default_rng(0))
    place = np.array([0.0, 0.0, 1.0])
    moving = ObjectState(place, linear_velocity=(0.2, 0, 0), covariance=1e-4 * np.eye(12))
    without = 0
    for k in range(30):
        estimate.update(around, BALL, moving, k * STEP, detection(k * STEP, place))
        without += estimate.states is None
    assert without >= 6


FLYING = ObjectState((0, 0, 1.0), linear_velocity=(1, 0, 0))


def test_spin_is_a_guess_until_a_bounce_shows_it():
    around = surroundings(friction=1.0)
    start = ObjectState((0, 0, 0.4), linear_velocity=(0.6, 0.2, -1.0), angular_velocity=(4, -7, 2))
    # The bounce is after 0.17 s.
    guess, _ = followed(around, start, 0.1, np.random.default_rng(1))
    assert guess.spin_is_guess
    measured, _ = followed(around, start, 0.4, np.random.default_rng(1))
    assert not measured.spin_is_guess


@pytest.mark.parametrize("scale", [0.5, 1.0, 2.0])
def test_a_guess_is_as_wide_as_earlier_guesses_should_have_been(scale):
    around = surroundings()
    estimate = SceneEstimate(np.random.default_rng(0))
    for time, state, detected in seen_flight(around, FLYING, 6):
        (states,) = estimate.updates(around, [BALL], [state], time, [detected], scale)
    _, covariance = states.moments
    # 200 samples know a standard deviation to 1 / sqrt(400); here to five of these.
    spins = np.sqrt(np.diag(covariance)[6:9])
    np.testing.assert_allclose(spins, scale * PRIOR_SPIN, rtol=0.25)
    assert states.spin_is_guess


def test_perceived_spin_is_no_guess():
    around = surroundings()
    estimate = SceneEstimate(np.random.default_rng(0))
    for time, state, detected in seen_flight(around, FLYING, 6):
        covariance = state.covariance.copy()
        covariance[9, 9] = 1.0
        measured = state.with_covariance(covariance)
        (states,) = estimate.updates(around, [BALL], [measured], time, [detected], 2.0)
    assert np.sqrt(states.moments[1][6, 6]) == pytest.approx(1.0, rel=0.25)
    assert not states.spin_is_guess


def test_resting_or_undetected_object_has_no_estimate():
    around = surroundings()
    estimate = estimate_of(around, seen_flight(around, FLYING, 6))
    assert estimate.states is not None
    estimate.update(around, BALL, FLYING, 7 * STEP, None)
    assert estimate.states is None
    still = ObjectState((0, 0, RADIUS), covariance=1e-6 * np.eye(12))
    estimate.update(around, BALL, still, 8 * STEP, detection(8 * STEP, still.position))
    assert estimate.states is None


def test_time_that_goes_back_forgets():
    around = surroundings()
    frames = list(seen_flight(around, FLYING, 6))
    estimate = estimate_of(around, frames)
    assert estimate.states is not None
    time, state, detected = frames[1]
    estimate.update(around, BALL, state, time, detected)
    assert estimate.states is None


def test_other_surroundings_keep_what_is_known():
    around = surroundings()
    scene_estimate = SceneEstimate(np.random.default_rng(0))
    for k, (time, state, detected) in enumerate(seen_flight(around, FLYING, 9)):
        if k == 6:
            around = surroundings(restitution=0.6)
        (states,) = scene_estimate.updates(around, [BALL], [state], time, [detected])
    # In free flight nothing depends on θ_s: the speed is known better than one frame says.
    assert np.sqrt(states.moments[1][3, 3]) < 0.004


def test_boxes_are_left_to_perception():
    box = SceneObject("box", "rubber", Box((0.1, 0.1, 0.1)))
    state = ObjectState((0, 0, 1.0), linear_velocity=(1, 0, 0))
    estimate = SceneEstimate(np.random.default_rng(0))
    detections = [detection(0.0, state.position)]
    assert list(estimate.updates(surroundings(), [box], [state], 0.0, detections)) == [None]


class TwoMinima:
    """Residuals (ξ₀² - 1) / 0.1: as likely at ξ₀ = 1 as at -1."""

    def __init__(self, unknowns):
        self.unknowns = unknowns

    def residuals(self, standard):
        return (standard[:, :1] ** 2 - 1.0) / 0.1

    def residuals_and_states(self, standard, time):
        return self.residuals(standard), self.unknowns.values(standard)


def test_two_explanations_stay_two():
    knowledge = PairKnowledge(np.empty(0), np.empty((0, 0)), 0, np.empty(0, dtype=int), False, {})
    unknowns = trajectory_fit.Unknowns.of_moments(np.zeros(12), np.eye(12), knowledge)
    fit = TwoMinima(unknowns)
    starts = np.zeros((2, 12))
    starts[:, 0] = (0.6, -0.7)
    modes = find_modes(fit, starts, np.array([0.01 * np.eye(12)] * 2))
    # Each to a part of its standard deviation of 0.05: the descent ends where little is to gain.
    assert sorted(modes.centres[:, 0]) == pytest.approx([-1.0, 1.0], abs=0.02)
    states = draw_weighted(fit, modes, 4000, 0.0, np.random.default_rng(0))
    first = states.values @ np.linalg.inv(unknowns.root).T
    share = states.weights[first[:, 0] > 0.0].sum()
    # Half of them, with the standard error of the effective number of samples.
    assert share == pytest.approx(0.5, abs=4.0 * 0.5 / np.sqrt(effective_count(states)))
    # About each, the density is normal with the variance 1 / (1 + 20²).
    apart = np.abs(first[:, 0]) - 1.0
    assert np.sqrt(states.weights @ apart**2) == pytest.approx(1.0 / np.sqrt(401.0), rel=0.1)


def test_derivative_steps_follow_the_information():
    # Each difference δ is 0.3 standard deviations of the posterior: δᵀ H δ = 0.09, and none has
    # anything to do with another.
    turn, _ = np.linalg.qr(np.random.default_rng(0).standard_normal((3, 3)))
    information = (turn * [1.0, 4.0, 1e10]) @ turn.T
    (steps,) = derivative_steps(information[None])
    np.testing.assert_allclose(steps @ information @ steps.T, 0.09 * np.eye(3), atol=1e-5)


@given(st.tuples(*[st.floats(-300.0, 300.0)] * 3))
def test_a_spin_is_read_from_two_orientations(spin):
    # A free sphere turns about a fixed axis: q(t) = exp(ω t / 2).
    spin = np.array(spin)
    rate = np.linalg.norm(spin)
    angles = 0.5 * rate * trajectory_fit.INSTANT * np.arange(2.0)
    axis = spin / rate if rate > 0.0 else np.zeros(3)
    turns = np.column_stack([np.sin(angles)[:, None] * axis, np.cos(angles)])
    rate_of_turn = trajectory_fit._turn(turns[None, 0], turns[None, 1])[0] / trajectory_fit.INSTANT
    # Rounding of a quaternion, over an instant.
    np.testing.assert_allclose(rate_of_turn, spin, atol=1e-15 / trajectory_fit.INSTANT * 20.0)


@given(st.lists(st.floats(0.0, 1.0), min_size=4, max_size=4))
def test_pairs_are_written_as_the_space_has_them(units):
    around = surroundings()
    world = world_of(around)
    knowledge = PairKnowledge.of(around.uncertain, world)
    tables = knowledge.tables(world, np.array([units]))
    posterior = around.uncertain.learned.whole_posterior()
    unit = posterior.mean.copy()
    names = parameter_names(MATERIALS)
    pair = [k for k, name in enumerate(names) if "rubber" in name and "room" in name]
    unit[pair] = units
    expected = posterior.space.to_parameters(unit).pair("rubber", "room")
    pair_values = tables["coefficients"][0, :, 0, 1]
    assert pair_values.tolist() == pytest.approx(list(expected.values()), rel=1e-12, abs=1e-12)
    np.testing.assert_array_equal(tables["coefficients"][0, :, 1, 0], pair_values)


def weighted(motion, spread=0.0, count=50):
    """States of a ball about a motion (9,), all equally likely."""
    around = surroundings()
    knowledge = PairKnowledge.of(around.uncertain, world_of(around))
    unknowns = trajectory_fit.Unknowns.of_moments(np.zeros(12), np.eye(12), knowledge)
    rng = np.random.default_rng(0)
    values = np.zeros((count, 12 + len(knowledge.mean)))
    values[:, :9] = motion + spread * rng.standard_normal((count, 9))
    values[:, 12:] = knowledge.mean
    return WeightedStates(values, np.full(count, 1.0 / count), unknowns)


def test_samples_begin_at_the_estimate_with_its_parameters():
    motion = np.array([0, 0, 1.0, 1, 2, 3, 4, 5, 6])
    estimate = weighted(motion, spread=0.1)
    scene = Scene(ROOM, (BALL,), (ObjectState((9, 9, 9)),))
    prepared = PreparedScene.of(
        scene, UncertainParameters(learned(restitution=0.2)), StateNoise(), (estimate,)
    )
    worlds = prepared.sampled(50, np.random.default_rng(1))
    motions = worlds.states[:, 0][:, [0, 1, 2, 7, 8, 9, 10, 11, 12]]
    # Every sample of equal weight once.
    drawn, expected = (rows[np.argsort(rows[:, 0])] for rows in (motions, estimate.values[:, :9]))
    np.testing.assert_allclose(drawn, expected, atol=1e-12)
    # Restitution is what the estimate goes with, not what others were drawn with.
    np.testing.assert_allclose(worlds.coefficients[:, 3, 0, 1], 0.7, atol=1e-3)


def test_noise_scales_stretch_the_estimate_and_fixed_noise_alone_leaves_it_out():
    motion = np.array([0, 0, 1.0, 1, 2, 3, 4, 5, 6])
    estimate = weighted(motion, spread=0.1)
    mean = estimate.moments[0][:9]
    scene = Scene(ROOM, (BALL,), (ObjectState((9, 9, 9)),))
    no_noise = StateNoise(scale=0.0, spin_scale=0.0)
    prepared = PreparedScene.of(scene, learned().parameters, no_noise, (estimate,))
    states = prepared.sampled(5, np.random.default_rng(1)).states[:, 0]
    np.testing.assert_allclose(states[:, :3], np.tile(mean[:3], (5, 1)), atol=1e-12)
    np.testing.assert_allclose(states[:, 10:], np.tile(mean[6:], (5, 1)), atol=1e-12)
    fixed = StateNoise(perceived=False)
    states = PreparedScene.of(scene, learned().parameters, fixed, (estimate,)).sampled(
        5, np.random.default_rng(1)
    )
    np.testing.assert_array_equal(states.states[:, 0, :3], 9.0)


def test_chosen_samples_are_as_frequent_as_their_weights():
    estimate = replace(weighted(np.zeros(9), count=3), weights=np.array([0.5, 0.3, 0.2]))
    chosen = estimate.choose(100, np.random.default_rng(0))
    # Systematic: the counts are off by less than one.
    np.testing.assert_allclose(np.bincount(chosen), [50, 30, 20], atol=1.0)


def test_the_state_has_the_moments():
    estimate = weighted(np.array([0, 0, 1.0, 1, 2, 3, 4, 5, 6]), spread=0.2, count=20_000)
    state = estimate.state(np.array([0.0, 0.0, 0.0, 1.0]))
    np.testing.assert_allclose(state.angular_velocity, [4, 5, 6], atol=0.01)
    rows = np.r_[POSITION, LINEAR_VELOCITY, ANGULAR_VELOCITY]
    np.testing.assert_allclose(state.covariance[np.ix_(rows, rows)], 0.04 * np.eye(9), atol=0.003)


def test_a_predictor_begins_where_the_estimate_is():
    around = surroundings()
    start = ObjectState((0, 0, 0.4), linear_velocity=(0.5, 0, -1), angular_velocity=(0, -8, 0))
    options = PredictionOptions(horizon=0.5, sample_count=20)
    inputs = Inputs(ROOM, 1, learned(), None)
    frames = list(seen_flight(around, start, 13))

    def fed(estimate_states):
        predictor = Predictor(
            PredictionSettings(replace(options, estimate_states=estimate_states)), 0, inputs
        )
        for time, state, detected in frames:
            frame = PerceivedStates((BALL,), (state,), time, 50.0 + time, 0.0, "room", (detected,))
            predictor.take(states=frame)
        return predictor

    predictor = fed(True)
    (states,) = predictor.snapshot.estimates
    now = frames[-1][0]
    made = predictor.predict(now=now, monotonic=50.0 + now)
    ahead = path_of(around, start, [now + 0.5])[0]
    assert np.linalg.norm(made.distribution.mean[0, -1] - ahead) < 0.03
    assert made.prepared.estimates == (states,)
    assert fed(False).snapshot.estimates == ()


def test_states_are_taken_over_object_by_object_and_predicted_from_when_all_are_done():
    others = [replace(BALL, id=name) for name in ("first", "second", "third")]
    predictor = Predictor(
        PredictionSettings(PredictionOptions()), 0, Inputs(ROOM, 1, learned(), None)
    )
    frames = []
    for time, state, detected in seen_flight(surroundings(), FLYING, 3):
        apart = [replace_place(state, k) for k in range(3)]
        detections = [replace(detected, positions=[state.position]) for state in apart]
        frames.append(
            PerceivedStates(
                tuple(others), tuple(apart), time, 50.0 + time, 0.0, "room", tuple(detections)
            )
        )
    first, second, third = frames
    predictor.take(states=first)
    steps = predictor.take_states(second)
    assert [next(steps, "done"), next(steps, "done")] == [None, None]
    assert predictor.is_taking
    assert predictor.snapshot.inputs.states is first
    assert next(steps, "done") == "done"
    assert not predictor.is_taking
    assert predictor.snapshot.inputs.states is second
    assert len(predictor.snapshot.estimates) == 3
    # What is left of a frame is done before the next one begins.
    left = predictor.take_states(third)
    next(left)
    predictor.take(states=replace(third, stamp=third.stamp + STEP))
    assert next(left, "done") == "done"
    assert predictor.snapshot.inputs.states.stamp == third.stamp + STEP


def replace_place(state, number):
    """The state 2 m further along y, times a number."""
    return ObjectState(
        state.position + (0, 2.0 * number, 0),
        linear_velocity=state.linear_velocity,
        covariance=state.covariance,
    )


def test_an_estimate_depends_on_the_seed_alone():
    around = surroundings()
    start = ObjectState((0, 0, 0.4), linear_velocity=(0.5, 0, -1), angular_velocity=(0, -8, 0))
    first, second = (followed(around, start, 0.4, np.random.default_rng(7))[0] for _ in range(2))
    np.testing.assert_array_equal(first.values, second.values)
    np.testing.assert_array_equal(first.weights, second.weights)


def touching(spread=1e-3, count=200, depth=0.0):
    """A scene of a ball that touches the floor by its estimate, and the estimate."""
    motion = np.array([0, 0, RADIUS - depth, 1, 2, 3, 4, 5, 6])
    scene = Scene(ROOM, (BALL,), (ObjectState((0, 0, RADIUS)),))
    return scene, weighted(motion, spread, count)


def test_of_an_estimate_the_samples_outside_of_surfaces_are_used():
    scene, estimate = touching()
    prepared = PreparedScene.of(scene, UncertainParameters(learned()), StateNoise(), (estimate,))
    states = prepared.sampled(100, np.random.default_rng(1)).states[:, 0]
    assert states[:, 2].min() >= RADIUS - 1e-9
    outside = estimate.values[estimate.values[:, 2] >= RADIUS - 1e-9, 2]
    assert np.isin(states[:, 2], outside).all()
    # About half of 200 can be, each once.
    assert len(np.unique(states[:, 2])) >= 0.9 * min(len(outside), 100)


def test_where_an_estimate_is_inside_draws_of_its_moments_are_not():
    scene, estimate = touching(depth=0.004)
    prepared = PreparedScene.of(scene, UncertainParameters(learned()), StateNoise(), (estimate,))
    states = prepared.sampled(100, np.random.default_rng(1)).states[:, 0]
    assert states[:, 2].min() >= RADIUS - 1e-9
    # What four standard deviations leave of a normal distribution lies within a quarter of one.
    assert np.mean(states[:, 2]) < RADIUS + 0.5e-3
    np.testing.assert_allclose(states[:, 7:13].mean(axis=0), [1, 2, 3, 4, 5, 6], atol=1e-3)


def test_too_few_possible_samples_are_not_all_there_is():
    estimate = weighted(np.zeros(9), spread=1.0, count=50)
    possible = np.arange(50) < 5
    assert estimate.where(possible) is estimate
    half = estimate.where(np.arange(50) < 25)
    np.testing.assert_allclose(half.weights, np.where(np.arange(50) < 25, 1 / 25, 0.0))


class LinearFit:
    """Residuals r = k (a · ξ) of one row: the posterior is normal with H = I + k² a aᵀ."""

    unknowns = None

    def __init__(self, axis, slope):
        self.axis, self.slope = axis, slope

    def residuals_and_states(self, standard, time):
        return self.slope * (standard @ self.axis)[:, None], standard


@given(st.floats(0.0, 12.0), st.integers(0, 1000))
def test_samples_are_finite_where_an_unknown_is_very_certain(decades, seed):
    # Along a the variance is 1 / (1 + k²), across it 1. Rounding takes k² ε from H: from k = 10⁸ on
    # nothing is left of the prior, and H may have negative eigenvalues.
    rng = np.random.default_rng(seed)
    axis = rng.standard_normal(12)
    axis /= np.linalg.norm(axis)
    slope = 10.0**decades
    information = np.eye(12) + slope**2 * np.outer(axis, axis)
    modes = Modes(np.zeros((1, 12)), information[None], np.zeros(1), np.zeros((1, 1)))
    states = draw_weighted(LinearFit(axis, slope), modes, 400, 0.0, rng)
    along = states.values @ axis
    across = states.values - along[:, None] * axis
    assert np.isfinite(states.weights).all()
    assert np.std(along) < 1.3 / np.hypot(1.0, slope) + 1e-6
    if decades < 7.0:
        # Samples are drawn 1.1 times as wide; the sum of 11 · 400 squares is known to 2 %.
        assert np.mean(np.sum(across**2, axis=1)) / 11.0 == pytest.approx(1.21, abs=0.12)
