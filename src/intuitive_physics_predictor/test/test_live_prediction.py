"""What is predicted now: carried forward, of the newest input, the same from the same seed."""

from __future__ import annotations

from dataclasses import asdict, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from intuitive_physics.errors import InvalidInputError, UnknownNameError
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.materials import StaticParameters, parameter_names
from intuitive_physics.regions import BoxRegion, HalfSpaceRegion
from intuitive_physics.scene import Environment, Plane, Scene, SceneObject
from intuitive_physics.shapes import Box, Sphere
from intuitive_physics.simulation.core.kernel import roll_worlds
from intuitive_physics.state import ObjectState
from intuitive_physics_predictor.compile import warm_up
from intuitive_physics_predictor.live.live_prediction import (
    Inputs,
    NothingToPredictError,
    PerceivedStates,
    predict_scene,
)
from intuitive_physics_predictor.live.predictor import Predictor
from intuitive_physics_predictor.live.question import Event, Question, answer
from intuitive_physics_predictor.live.settings import (
    PredictionOptions,
    PredictionSettings,
    output_times,
)
from intuitive_physics_predictor.noise import StateNoise
from intuitive_physics_predictor.noise_scales import NOISE_SCALES, NoiseScales

ROOM = Environment([Plane("floor", "wood", (0, 0, 1), 0.0)], frame_id="room")
COVARIANCE = np.diag([1e-6] * 3 + [0.0] * 3 + [1e-4] * 3 + [1e-2] * 3)
STATE = ObjectState((0, 0, 1.0), (0, 0, 0, 1), (2.0, 0, 0), (0, 0, 0), COVARIANCE)
STATES = PerceivedStates(
    (SceneObject("ball", "rubber", Sphere(0.05)),), (STATE,), 1000.0, 50.0, 0.0, "room"
)
SETTINGS = PredictionSettings(PredictionOptions(horizon=1.0))


def learned(materials=("rubber", "wood"), deviation=0.01):
    size = len(parameter_names(materials))
    return LearnedParameters(
        StaticParameters.uniform(materials),
        np.full(size, deviation),
        np.ones(size, dtype=bool),
        version=4,
        cost=0.01,
        observation_count=9,
        method="cma_es",
    )


INPUTS = Inputs(ROOM, 7, learned(), STATES)


def now(age, inputs=INPUTS, options=SETTINGS, seed=1):
    """Predict from states of this age in s."""
    predictor = Predictor(options, seed, inputs)
    return predictor.predict(now=1000.0 + age, monotonic=50.0 + age)


@given(st.floats(0.0, 0.5))
@settings(max_examples=30)
def test_carrying_forward_is_looking_later_at_the_same_samples(age):
    # With the same seed the noise is the same, so what is predicted for one instant does not
    # depend on when it was predicted: the engine's closed form is evaluated elsewhere, to rounding.
    made = now(age)
    assert made.start == pytest.approx(1000.0 + age, abs=1e-9)
    at_stamp = SETTINGS.predict(now(0.0).prepared, age + SETTINGS.times, seed=1, sample_count=20)
    # Stamps of 1000 s hold 1e-13 s, and nothing is faster than 10 m/s.
    np.testing.assert_allclose(made.distribution.positions, at_stamp.positions, atol=1e-9)
    np.testing.assert_array_equal(made.distribution.times, SETTINGS.times)
    assert (made.static_parameters_version, made.environment_version) == (4, 7)


def test_states_from_just_ahead_of_the_clock_are_begun_from():
    ahead = replace(INPUTS, states=replace(STATES, stamp=1000.05, delay=-0.05))
    made = now(0.0, ahead)
    assert made.start == 1000.05
    np.testing.assert_allclose(made.distribution.mean[0, 0], [0, 0, 1], atol=2e-3)


def test_prediction_can_begin_at_a_stamp_of_another_clock():
    strange = replace(INPUTS, states=replace(STATES, stamp=5.0, delay=995.0))
    options = PredictionSettings(PredictionOptions(horizon=1.0, carry_forward=False))
    assert now(0.3, strange, options).start == 5.0
    with pytest.raises(NothingToPredictError, match="carry_forward"):
        now(0.3, strange)


@pytest.mark.parametrize(
    ("inputs", "age", "reason"),
    [
        (replace(INPUTS, environment=None), 0.0, "no environment yet"),
        (replace(INPUTS, states=None), 0.0, "no object states yet"),
        (INPUTS, 0.7, "0.7 s old; expected at most 0.5 s"),
        (
            replace(INPUTS, states=replace(STATES, stamp=1003.0, delay=-3.0)),
            0.0,
            "3.0 s in the future",
        ),
        (replace(INPUTS, states=replace(STATES, stamp=997.0, delay=3.0)), 0.0, "3.0 s old"),
        (
            replace(INPUTS, states=replace(STATES, objects=(), states=())),
            0.0,
            "no objects are seen",
        ),
    ],
)
def test_nothing_is_predicted_from_what_is_missing_or_old(inputs, age, reason):
    with pytest.raises(NothingToPredictError, match=reason):
        now(age, inputs)


def test_a_clock_that_stands_still_makes_nothing_stale_before_its_time():
    # A paused bag: no new states, and its clock does not go on.
    for silent in (0.0, 0.2, 0.45):
        Predictor(SETTINGS, 0, INPUTS).predict(now=1000.0, monotonic=50.0 + silent)
    with pytest.raises(NothingToPredictError, match=r"are 0\.6 s old"):
        Predictor(SETTINGS, 0, INPUTS).predict(now=1000.0, monotonic=50.6)


def test_another_frame_is_refused():
    with pytest.raises(InvalidInputError, match="'moon'; expected 'room'"):
        now(0.0, replace(INPUTS, states=replace(STATES, frame_id="moon")))


def test_materials_nobody_learned_of_may_be_anything():
    # Free flight is the same; after the bounce the samples differ as restitution may.
    known, unknown = now(0.0), now(0.0, replace(INPUTS, learned=None))
    spread = [made.distribution.covariance[0, :, 2, 2] for made in (known, unknown)]
    np.testing.assert_allclose(spread[1][:40], spread[0][:40], rtol=1e-6)
    assert spread[1][-1] > 4 * spread[0][-1]


@pytest.mark.parametrize("shape", [Sphere(0.05), Box((0.1, 0.1, 0.1))])
def test_asked_again_the_samples_are_the_very_same(shape):
    seen = replace(STATES, objects=(SceneObject("ball", "rubber", shape),))
    made = now(0.1, replace(INPUTS, states=seen))
    again = made.repeat(made.distribution.times, 20)
    np.testing.assert_array_equal(again.positions, made.distribution.positions)
    assert again.orientations.shape == (*made.distribution.positions.shape[:-1], 4)
    more = made.repeat(made.distribution.times, 500)
    assert more.positions.shape[0] == 500
    # Both are of the same distribution: σ = 2 cm after 0.2 s and less, 20 samples.
    np.testing.assert_allclose(
        more.mean[0, :20], made.distribution.mean[0, :20], atol=5 * 0.003 / np.sqrt(20)
    )


def test_no_prediction_is_of_a_kind_that_was_not_compiled():
    # Another type of array would have the kernels compiled anew, for seconds, at a tick.
    warm_up()
    compiled = len(roll_worlds.signatures)
    options = PredictionOptions(horizon=1.0, size_scale=0.01, contact_scale=0.05)
    now(0.1, options=PredictionSettings(options))
    now(0.1, replace(INPUTS, learned=None))
    now(0.1).repeat(SETTINGS.times, 5)
    assert len(roll_worlds.signatures) == compiled


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ({"horizon": 0.5, "time_step": 1.0}, "time step"),
        ({"horizon": 60.0, "time_step": 0.001, "sample_count": 10_000}, "ask for fewer"),
    ],
)
def test_options_that_do_not_go_together(options, word):
    with pytest.raises(InvalidInputError, match=word):
        PredictionSettings(PredictionOptions(**options))


def test_every_noise_scale_is_an_option_and_reaches_the_noise():
    values = {name: 0.25 + 0.1 * k for k, name in enumerate(NOISE_SCALES)}
    options = PredictionOptions(**{f"{name}_scale": value for name, value in values.items()})
    assert asdict(options.noise_scales) == values
    assert (options.state_noise.scale, options.state_noise.spin_scale) == (
        values["state"],
        values["spin"],
    )


def test_the_defaults_believe_perception_and_learner():
    assert PredictionOptions().noise_scales == NoiseScales()
    assert PredictionOptions().state_noise == StateNoise()


@given(st.floats(0.01, 60.0), st.floats(0.001, 1.0))
def test_output_times_reach_the_horizon(horizon, time_step):
    if time_step > horizon:
        return
    times = output_times(horizon, time_step)
    assert times[0] == 0.0
    assert horizon - time_step < times[-1] <= horizon * (1 + 1e-9)
    np.testing.assert_allclose(np.diff(times), time_step)


def test_a_scene_that_is_asked_about_begins_at_its_states():
    made = predict_scene(
        now(0.0).scene, learned(), SETTINGS, [0.0, 0.2], seed=1, sample_count=20, start=5.0
    )
    assert (made.start, made.states_stamp) == (5.0, 5.0)
    # The noise is that of the same seed, whoever asks.
    at_once = now(0.0).distribution.positions
    np.testing.assert_allclose(made.distribution.positions, at_once[:, :, [0, 20]], atol=1e-9)


@pytest.mark.parametrize(
    ("height", "times", "word"),
    [(0.01, [0.0], "overlaps plane 'floor'"), (1.0, [0.1, 0.1], "strictly increase")],
)
def test_a_scene_that_cannot_be_is_refused(height, times, word):
    scene = Scene(ROOM, STATES.objects, (ObjectState((0, 0, height)),))
    with pytest.raises(InvalidInputError, match=word):
        predict_scene(scene, None, SETTINGS, times, seed=0, sample_count=2, start=0.0)


def test_questions_are_answered_from_a_prediction():
    made = now(0.1, replace(INPUTS, learned=learned(deviation=1e-4)))
    below = answer(Question(Event.FALLS_BELOW, "ball", height=0.5), made)
    assert below.forecast.probability == pytest.approx(1.0)
    # 0.5 m of fall take 0.319 s, of which 0.1 s are over.
    assert np.mean(below.forecast.times) == pytest.approx(0.219, abs=0.01)
    floor = answer(Question(Event.TOUCHES, "ball", other_id="floor", sample_count=7), made)
    assert len(floor.forecast.times) == 7
    # Rolling at less than 2 m/s against 5/7 · 0.01 g it stops within 29 s of its last bounce.
    far = answer(Question(Event.COMES_TO_REST, "ball", horizon=60.0), made)
    assert far.forecast.probability == pytest.approx(1.0)
    box = BoxRegion((0.7, 0, 0.5), (0, 0, 0, 1), (0.5, 0.5, 0.5))
    caught = answer(Question(Event.INTERCEPTS, "ball", region=box, reach=0.1), made)
    assert caught.forecast.probability == pytest.approx(1.0)
    x, _, z = caught.position
    assert z == pytest.approx(1 - 9.81 * x**2 / 8, abs=0.02)
    assert 2.0 * (0.1 + caught.time) == pytest.approx(x, abs=0.02)


@pytest.mark.parametrize(
    ("question", "error"),
    [
        (Question(Event.FALLS_BELOW, "cup"), UnknownNameError),
        (Question(Event.ENTERS_REGION, "ball"), InvalidInputError),
        (
            Question(Event.INTERCEPTS, "ball", region=HalfSpaceRegion((0, 0, 1), 0), reach=0.1),
            InvalidInputError,
        ),
        (Question(Event.COMES_TO_REST, "ball", horizon=-1.0), InvalidInputError),
    ],
)
def test_questions_without_answer(question, error):
    with pytest.raises(error, match="expected"):
        answer(question, now(0.0))


def test_the_options_of_noise_at_impacts_reach_the_samples():
    # The perceived spread is cut to none, so that what is left is of the bounce at 0.44 s.
    exact = {"state_scale": 0.0, "spin_scale": 0.0, "static_parameters_scale": 0.0}
    for option in ("impact_restitution_noise", "impact_tilt_noise"):
        settings = PredictionSettings(PredictionOptions(horizon=1.0, **exact, **{option: 0.05}))
        made = now(0.0, options=settings)
        spread = made.distribution.positions[:, 0].std(axis=0).max(axis=1)
        fallen = settings.times < 0.4
        assert spread[fallen].max() < 1e-12
        assert spread[~fallen].max() > 1e-3
