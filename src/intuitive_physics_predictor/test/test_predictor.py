"""One owner of all that is kept between predictions: it changes no prediction, to the bit."""

from __future__ import annotations

import threading
import time
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.scene import Environment, Plane, SceneObject
from intuitive_physics.shapes import Sphere
from intuitive_physics.state import ObjectState
from intuitive_physics_predictor.live.live_prediction import (
    Inputs,
    NothingToPredictError,
    PerceivedStates,
    predict_scene,
)
from intuitive_physics_predictor.live.pacer import Pacer
from intuitive_physics_predictor.live.predictor import Predictor
from intuitive_physics_predictor.live.question import Event, Question, answer
from intuitive_physics_predictor.live.settings import PredictionOptions, PredictionSettings
from intuitive_physics_predictor.noisy_newton import PreparedScene

ROOM = Environment([Plane("floor", "wood", (0, 0, 1), 0.0)], frame_id="room")
COVARIANCE = np.diag([1e-6] * 3 + [0.0] * 3 + [1e-4] * 3 + [1e-2] * 3)
STATE = ObjectState((0, 0, 1.0), (0, 0, 0, 1), (2.0, 0, 0), (0, 0, 0), COVARIANCE)
BALL = SceneObject("ball", "rubber", Sphere(0.05))
SEEN = PerceivedStates((BALL,), (STATE,), 1000.0, 50.0, 0.0, "room")
ELSEWHERE = replace(SEEN, states=(ObjectState((0, 0, 1.5), covariance=COVARIANCE),))
LEARNED = LearnedParameters.defaults(("rubber", "wood"))
INPUTS = Inputs(ROOM, 7, LEARNED, SEEN)
OPTIONS = PredictionOptions(horizon=0.5, sample_count=3)
SETTINGS = PredictionSettings(OPTIONS)


def predicted(predictor, age=0.1):
    """Predict from states of this age in s."""
    return predictor.predict(now=1000.0 + age, monotonic=50.0 + age)


def assert_same(one, other):
    assert one.seed == other.seed
    np.testing.assert_array_equal(one.distribution.positions, other.distribution.positions)


@given(st.integers(0, 3), st.integers(0, 3), st.integers(1, 3), st.booleans(), st.booleans())
@settings(max_examples=30)
def test_samples_drawn_ahead_change_no_prediction(seed, ahead, count, other_scene, noisy):
    # Drawn ahead or not, and of whatever: the same question has the same answer, to the bit.
    options = PredictionSettings(
        replace(OPTIONS, sample_count=count, size_scale=0.1 * noisy, impact_tilt_noise=0.1 * noisy)
    )
    alone = Predictor(options, seed, INPUTS)
    after = Predictor(options, ahead, replace(INPUTS, states=ELSEWHERE) if other_scene else INPUTS)
    after.draw_ahead()
    after.set(seed=seed)
    after.take(states=SEEN)
    assert_same(predicted(after), predicted(alone))


def test_samples_drawn_ahead_are_not_drawn_again(monkeypatch):
    predictor = Predictor(SETTINGS, 1, INPUTS)
    predictor.draw_ahead()
    drawn = []
    draw = PreparedScene.sampled
    monkeypatch.setattr(
        PreparedScene, "sampled", lambda *arguments: drawn.append(1) or draw(*arguments)
    )
    predicted(predictor)
    assert not drawn
    predicted(predictor)
    assert len(drawn) == 1


def test_requests_between_two_predictions_leave_what_is_drawn_ahead(monkeypatch):
    asked, alone = Predictor(SETTINGS, 1, INPUTS), Predictor(SETTINGS, 1, INPUTS)
    for predictor in (asked, alone):
        predicted(predictor)
        predictor.draw_ahead()
    snapshot = asked.snapshot
    answer(Question(Event.FALLS_BELOW, "ball", height=0.5, sample_count=7), snapshot.newest)
    scene = replace(INPUTS, states=ELSEWHERE).scene
    predict_scene(scene, None, snapshot.settings, [0.1], seed=3, sample_count=5, start=0.0)
    assert asked.snapshot is snapshot
    prepared = []
    monkeypatch.setattr(PreparedScene, "of", lambda *arguments: prepared.append(1))
    monkeypatch.setattr(PreparedScene, "sampled", lambda *arguments: prepared.append(1))
    assert_same(predicted(asked), predicted(alone))
    assert not prepared


def test_a_prediction_stays_what_it_was_when_settings_and_inputs_change():
    predictor = Predictor(SETTINGS, 1, INPUTS)
    made = predicted(predictor)
    before = made.repeat(SETTINGS.times, 3)
    predictor.set(settings=PredictionSettings(replace(OPTIONS, state_scale=3.0)), seed=9)
    predictor.take(states=ELSEWHERE, learned=None)
    predicted(predictor)
    np.testing.assert_array_equal(made.repeat(SETTINGS.times, 3).positions, before.positions)
    np.testing.assert_array_equal(before.positions, made.distribution.positions)


def test_new_settings_count_from_the_next_prediction_on():
    predictor = Predictor(SETTINGS, 1, INPUTS)
    predicted(predictor)
    predictor.draw_ahead()
    wider = PredictionSettings(replace(OPTIONS, state_scale=3.0, sample_count=5))
    predictor.set(settings=wider)
    assert_same(predicted(predictor), predicted(Predictor(wider, 2, INPUTS)))


def test_the_seed_grows_by_one_with_each_prediction_that_is_made():
    predictor = Predictor(SETTINGS, 4, INPUTS)
    assert [predicted(predictor).seed for _ in range(3)] == [4, 5, 6]
    with pytest.raises(NothingToPredictError):
        predicted(predictor, age=3.0)
    assert predictor.snapshot.newest is None
    assert predicted(predictor).seed == 7


def test_each_prediction_is_the_one_of_its_snapshot_whatever_threads_do():
    # A predictor that ticks; inputs, settings and seeds posted, and questions asked, all at once.
    made, errors = [], []
    predictor = Predictor(SETTINGS, 0, INPUTS)

    def tick(late, left_out):
        try:
            made.append((predicted(predictor), predictor.snapshot.inputs))
        except Exception as error:
            errors.append(error)

    pacer = Pacer(tick, 500.0, predictor.draw_ahead)
    wider = PredictionSettings(replace(OPTIONS, state_scale=3.0, sample_count=5))
    changes = [
        lambda: predictor.take(states=ELSEWHERE),
        lambda: predictor.take(states=SEEN, learned=None),
        lambda: predictor.take(learned=LEARNED),
        lambda: predictor.set(settings=wider),
        lambda: predictor.set(settings=SETTINGS),
        lambda: predictor.set(seed=1000),
    ]

    def post():
        for number in range(120):
            pacer.post(changes[number % len(changes)])
            time.sleep(2e-3)

    def ask():
        try:
            for _ in range(40):
                newest = predictor.snapshot.newest
                if newest is not None:
                    got = newest.repeat(newest.settings.times, len(newest.distribution.weights))
                    np.testing.assert_array_equal(got.positions, newest.distribution.positions)
        except Exception as error:
            errors.append(error)

    pacer.start()
    threads = [threading.Thread(target=work) for work in (post, post, ask, ask)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    pacer.stop()
    assert not errors
    assert len(made) > 10
    for one, inputs in made[:: max(1, len(made) // 40)]:
        assert_same(one, predicted(Predictor(one.settings, one.seed, inputs)))
