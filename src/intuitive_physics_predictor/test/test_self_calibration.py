"""Factors on uncertainties follow what came of earlier predictions."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from intuitive_physics.errors import InvalidInputError
from intuitive_physics_predictor.distribution import TrajectoryDistribution
from intuitive_physics_predictor.live.self_calibration import (
    GRID,
    HORIZONS,
    PRIOR_DEVIATION,
    SelfCalibration,
    load_calibration,
    save_calibration,
)
from intuitive_physics_predictor.noise import StateNoise

GRAVITY = np.array([0.0, 0.0, -9.81])
TIMES = np.arange(0.0, 1.2, 0.01)
NOISE = 1e-6 * np.eye(3)


def prediction(rng, deviation, contact=False, count=200):
    """A flight whose samples are `deviation` (m) apart, at all times; or one that lies still."""
    path = np.zeros((TIMES.size, 3))
    if not contact:
        path += 0.5 * GRAVITY * TIMES[:, None] ** 2
    samples = path + deviation * rng.standard_normal((count, 1, 1, 3))
    return TrajectoryDistribution(("ball",), TIMES, samples, np.full(count, 1.0 / count)), path


def outcomes(calibration, rng, claimed, true, throws, contact=False):
    """Predict `throws` balls that are where they are with the error `true` (m)."""
    for throw in range(throws):
        begin = 10.0 * throw
        error = true * rng.standard_normal(3)
        factor = calibration.factor("spin" if contact else "state").value
        made, path = prediction(rng, factor * claimed, contact)
        calibration.take_prediction(made, begin, GRAVITY, {"ball"})
        for horizon in HORIZONS:
            place = path[np.searchsorted(TIMES, horizon)] + error
            calibration.take_detection("ball", begin + horizon, place, NOISE)


@pytest.mark.parametrize("ratio", [0.5, 1.0, 2.0])
@pytest.mark.parametrize("contact", [False, True])
def test_the_factor_becomes_the_ratio_of_what_was_to_what_was_claimed(ratio, contact):
    # The posterior of a scale from n errors of three coordinates has a relative error of about
    # 1 / sqrt(6 n); comparisons of one throw share theirs and count as fewer.
    calibration = SelfCalibration()
    outcomes(calibration, np.random.default_rng(1), 0.01, 0.01 * ratio, 150, contact)
    factor = calibration.factor("spin" if contact else "state")
    assert np.log(factor.value) == pytest.approx(np.log(ratio), abs=4.0 * factor.error)
    assert factor.error < 0.1
    # What was not compared is not known.
    other = calibration.factor("state" if contact else "spin")
    assert (other.value, other.comparisons) == (pytest.approx(1.0), 0.0)


def test_beyond_a_contact_a_spin_that_is_no_guess_counts_for_the_state():
    calibration = SelfCalibration()
    made, path = prediction(np.random.default_rng(7), 0.01, contact=True)
    calibration.take_prediction(made, 0.0, GRAVITY, guessed={"another ball"})
    calibration.take_detection("ball", 1.0, path[100], NOISE)
    assert calibration.factor("state").comparisons > 0.0
    assert calibration.factor("spin").comparisons == 0.0


def test_factors_are_on_what_they_were_learned_of():
    calibration = SelfCalibration()
    outcomes(calibration, np.random.default_rng(8), 0.01, 0.02, 100, contact=True)
    noise = calibration.applied_to(StateNoise(scale=0.5, spin_scale=3.0))
    assert (noise.scale, noise.spin_scale) == (pytest.approx(0.5), 3.0)
    assert noise.guess_scale == pytest.approx(2.0, rel=0.3)


def test_nothing_known_is_one_with_the_error_of_the_prior():
    factor = SelfCalibration().factor("state")
    assert factor.value == pytest.approx(1.0)
    assert factor.error == pytest.approx(PRIOR_DEVIATION, rel=0.01)


def test_few_throws_move_it_little():
    calibration = SelfCalibration()
    outcomes(calibration, np.random.default_rng(2), 0.01, 0.03, 1)
    assert 1.0 < calibration.factor("state").value < 2.5


def test_a_ball_that_is_caught_moves_it_little():
    # 1 m beside what was predicted: of Student's t, another standard deviation of 1 m would be
    # as unlikely for the others.
    calibration = SelfCalibration()
    rng = np.random.default_rng(3)
    outcomes(calibration, rng, 0.01, 0.01, 60)
    before = calibration.factor("state").value
    outcomes(calibration, rng, 0.01, 1.0, 2)
    assert calibration.factor("state").value < 1.25 * before


def test_factor_follows_a_change():
    calibration = SelfCalibration()
    rng = np.random.default_rng(4)
    outcomes(calibration, rng, 0.01, 0.01, 100)
    outcomes(calibration, rng, 0.01, 0.02, 600)
    assert calibration.factor("state").value == pytest.approx(2.0, rel=0.2)


@settings(max_examples=20)
@given(st.floats(1e-4, 1.0), st.floats(1e-4, 1.0), st.integers(0, 2**32 - 1))
def test_factor_stays_within_its_bounds(claimed, true, seed):
    calibration = SelfCalibration()
    outcomes(calibration, np.random.default_rng(seed), claimed, true, 3)
    for kind in ("state", "spin"):
        factor = calibration.factor(kind)
        assert np.exp(GRID[0]) <= factor.value <= np.exp(GRID[-1])
        assert np.isfinite(factor.error)


def test_calibration_survives_json():
    calibration = SelfCalibration()
    outcomes(calibration, np.random.default_rng(5), 0.01, 0.02, 20)
    text = json.dumps(calibration.to_dict())
    again = SelfCalibration.from_dict(json.loads(text))
    assert again.factor("state") == calibration.factor("state")


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ({}, "the format None; expected 'intuitive_physics/self_calibration/2'"),
        ([], "the format 'list'"),
        ({"format": "intuitive_physics/self_calibration/2"}, "expected sums and comparisons"),
    ],
)
def test_other_files_are_refused(data, message):
    with pytest.raises(InvalidInputError, match=message):
        SelfCalibration.from_dict(data)


def test_calibration_is_kept_in_a_file(tmp_path):
    calibration = SelfCalibration()
    outcomes(calibration, np.random.default_rng(5), 0.01, 0.02, 20)
    path = tmp_path / "folder" / "calibration.json"
    assert load_calibration(path).factors() == SelfCalibration().factors()
    save_calibration(calibration.to_dict(), path)
    assert load_calibration(path).factors() == calibration.factors()
    assert [file.name for file in path.parent.iterdir()] == ["calibration.json"]
    path.write_text("{")
    with pytest.raises(InvalidInputError, match="is not JSON"):
        load_calibration(path)
    with pytest.raises(InvalidInputError, match="cannot be written to"):
        save_calibration(calibration.to_dict(), path / "below")


def test_time_that_goes_back_drops_what_was_kept():
    calibration = SelfCalibration()
    rng = np.random.default_rng(6)
    made, _ = prediction(rng, 0.01)
    calibration.take_prediction(made, 100.0, GRAVITY)
    calibration.take_prediction(made, 5.0, GRAVITY)
    calibration.take_detection("ball", 100.1, np.zeros(3), NOISE)
    assert calibration.factor("state").comparisons == 0.0
