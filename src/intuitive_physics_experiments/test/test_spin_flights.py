"""Flights with measured spin: read, estimated and predicted, on flights of the simulator itself."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from intuitive_physics.errors import InvalidInputError
from intuitive_physics_experiments.recorded_sets.flight_estimation import (
    BallEstimate,
    BallModel,
    estimate_ball,
    flight_axes,
)
from intuitive_physics_experiments.recorded_sets.flight_evaluation import (
    SMOOTHED,
    SPINLESS,
    START,
    evaluate_flights,
)
from intuitive_physics_experiments.recorded_sets.flight_tables import flight_tables
from intuitive_physics_experiments.recorded_sets.recorded_data import (
    load_recorded_set,
    load_spin_flights,
)
from intuitive_physics_experiments.recorded_sets.spin_flights import frame_numbers, spin_flights

MODEL = BallModel()
FRAME = 1.0 / 144.0  # s between images


def thrown(rng: np.random.Generator) -> np.ndarray:
    """Unknowns of a ball that bounces once, as the prior expects them."""
    velocity = np.array([rng.normal(0.0, 0.4), rng.uniform(-9.0, -5.0), rng.uniform(-1.5, 0.0)])
    level, upward, along = rng.uniform(-300.0, 300.0), rng.normal(0.0, 80.0), rng.normal(0.0, 60.0)
    spin = np.array([level, upward, along]) @ flight_axes(velocity)
    deviations = np.sqrt(np.diag(START.coefficient_covariance))
    coefficients = START.coefficients + np.clip(rng.normal(size=7), -1.0, 1.0) * deviations
    return np.concatenate([[0.0, 0.9, 0.25], velocity, spin, coefficients])


def flown(unknowns: np.ndarray, times: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Positions (n, 3) m as they are detected."""
    true = MODEL.positions(unknowns[None], times)[0]
    return true + START.noise * rng.normal(size=true.shape)


@pytest.fixture(scope="module")
def spin_arrays():
    """Makes arrays of a set of so many flights, with stamps that jitter and a few lost frames."""

    def make(count: int) -> dict[str, Any]:
        rng = np.random.default_rng(11)
        stamps, positions, spins = [], [], []
        for _ in range(count):
            ball = thrown(rng)
            frames = np.delete(np.arange(60.0), rng.choice(np.arange(8, 50), 3, replace=False))
            stamps.append(frames * FRAME + rng.uniform(0.0, 0.002, frames.size))
            positions.append(flown(ball, frames * FRAME, rng))
            spins.append(ball[6:9])
        return {
            "time": np.concatenate(stamps),
            "position": np.concatenate(positions),
            "offsets": np.arange(count + 1) * 57,
            "spin": np.array(spins),
            "radius": np.array(0.02),
            "mass": np.array(0.0027),
        }

    return make


def test_frames_are_counted_though_stamps_jitter(spin_arrays):
    flights = spin_flights(spin_arrays(12))
    assert len(flights) == 12
    for flight in flights:
        frames = np.rint(flight.times / FRAME)
        np.testing.assert_allclose(flight.times, frames * FRAME, atol=5e-4)
        assert frames[-1] == 59
        assert flight.bounce is not None


def test_a_lost_frame_at_the_bounce_is_counted():
    # The ball is slower after the bounce: two frames are 1.6 times the way of one before it.
    y = np.concatenate([np.arange(10) * 0.05, 0.45 + 0.08 + np.arange(8) * 0.035])
    positions = np.column_stack([np.zeros_like(y), y, np.zeros_like(y)])
    stamps = np.concatenate([np.arange(10.0), np.arange(11.0, 19.0)]) * FRAME
    expected = np.concatenate([np.arange(10.0), np.arange(11.0, 19.0)])
    np.testing.assert_array_equal(frame_numbers(stamps, positions), expected)


def test_nothing_is_read_beyond_a_long_gap(spin_arrays):
    arrays = spin_arrays(1)
    arrays["time"][40:] += 0.1
    (flight,) = spin_flights(arrays)
    assert len(flight.times) == 40


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"spin": np.zeros((3, 3))}, r"spin has shape \(3, 3\); expected \(2, 3\)"),
        ({"spin": np.full((2, 3), np.nan)}, "spin has 6 values that are not finite"),
        ({"time": np.linspace(1.0, 0.0, 114)}, "times that never go back"),
        ({"mass": np.array(0.0)}, "mass"),
        ({"position": np.zeros((100, 3))}, "offsets go from"),
    ],
)
def test_what_a_set_cannot_have_is_named(tmp_path, spin_arrays, change, message):
    np.savez(tmp_path / "set.npz", **{**spin_arrays(2), **change})
    for load in (load_spin_flights, load_recorded_set):
        with pytest.raises(InvalidInputError, match=message):
            load(tmp_path / "set.npz")


@settings(max_examples=60, deadline=None)
@given(
    position=hnp.arrays(np.float64, (24, 3), elements=st.floats(width=32)),
    time=hnp.arrays(np.float64, 24, elements=st.floats(0.0, 1.0)),
    spin=hnp.arrays(np.float64, (1, 3), elements=st.floats(width=32)),
)
def test_any_numbers_are_loaded_or_refused(tmp_path_factory, position, time, spin):
    path = tmp_path_factory.mktemp("npz") / "set.npz"
    known = {"offsets": [0, 24], "radius": 0.02, "mass": 0.0027}
    np.savez(path, position=position, time=np.sort(time), spin=spin, **known)
    try:
        flights = load_spin_flights(path)
    except InvalidInputError:
        return
    for flight in flights:
        assert (np.diff(flight.times) > 0.0).all()
        assert flight.times.shape == flight.stamps.shape == flight.positions[:, 0].shape


def estimates(rng: np.random.Generator, count: int) -> list[tuple[np.ndarray, BallEstimate]]:
    times = np.arange(50) * FRAME
    balls = [thrown(rng) for _ in range(count)]
    return [(ball, estimate_ball(MODEL, START, times, flown(ball, times, rng))) for ball in balls]


def test_a_known_spin_is_recovered_within_its_covariance():
    estimated = estimates(np.random.default_rng(2), 12)
    squares, errors = [], []
    for ball, estimate in estimated:
        apart = estimate.spin - ball[6:9]
        squares.append(apart @ np.linalg.solve(estimate.spin_covariance, apart))
        errors.append(np.linalg.norm(apart) / np.linalg.norm(ball[6:9]))
    # χ² of three degrees each: the median is 2.4, and 95 % lie below 7.8.
    assert np.median(squares) < 6.0
    assert np.mean(np.array(squares) < 12.0) > 0.7
    assert np.median(errors) < 0.15


def test_rows_that_are_no_ball_do_no_harm():
    rng = np.random.default_rng(4)
    times = np.arange(50) * FRAME
    ball = thrown(rng)
    detected = flown(ball, times, rng)
    detected[[12, 25, 44]] += [0.05, -0.03, 0.08]
    estimate = estimate_ball(MODEL, START, times, detected)
    ahead = times[-1] + np.array([0.05, 0.1])
    error = estimate.predict(MODEL, ahead) - MODEL.positions(ball[None], ahead)[0]
    assert np.linalg.norm(error, axis=1).max() < 0.02


def test_a_spin_that_the_air_does_not_tell_stays_wide():
    # The lift of a fast spin is near its limit: before the bounce any fast one explains the flight.
    rng = np.random.default_rng(6)
    ball = thrown(rng)
    ball[3:6] = 0.0, -7.0, 0.0
    ball[6:9] = 320.0 * flight_axes(ball[3:6])[0]
    before = estimate_ball(MODEL, START, *rows(ball, 25, rng))
    through = estimate_ball(MODEL, START, *rows(ball, 60, rng))
    level = flight_axes(ball[3:6])[0]
    spread = [np.sqrt(level @ estimate.spin_covariance @ level) for estimate in (before, through)]
    assert spread[0] > 40.0
    assert spread[1] < 0.5 * spread[0]


def rows(ball: np.ndarray, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    times = np.arange(count) * FRAME
    return times, flown(ball, times, rng)


def test_both_halves_of_a_set_are_scored(spin_arrays):
    flights = spin_flights(spin_arrays(16))
    steps: list[tuple[int, int]] = []
    evaluation = evaluate_flights(flights, lambda done, total: steps.append((done, total)))
    assert steps[-1][0] == steps[-1][1] == len(steps)
    for half in (evaluation.training, evaluation.test):
        assert np.median([score.relative_error for score in half]) < 0.3
        ours, none = (
            np.nanmedian([score.beyond_seen[way] for score in half]) for way in (SMOOTHED, SPINLESS)
        )
        assert ours < 0.5 * none
    text = flight_tables(evaluation)
    assert "restitution" in text
    assert "test, not contradicted" in text


def test_too_few_bounces_are_refused(spin_arrays):
    flights = [replace(flight, bounce=None) for flight in spin_flights(spin_arrays(6))]
    with pytest.raises(InvalidInputError, match="0 flights to learn from have a bounce"):
        evaluate_flights(flights, lambda done, total: None)


@pytest.mark.needs("recordings")
def test_recorded_flights_lie_in_time_to_a_tenth_of_a_frame(recording):
    # A cubic through the first rows leaves centimetres at the times as stamped, and the noise of
    # the detections at those of the frames.
    flights = load_spin_flights(recording("table_tennis_spin.npz"))
    assert len(flights) == 116
    left = {"stamps": [], "times": []}
    for flight in flights:
        first = slice(0, 30 if flight.bounce is None else min(30, flight.bounce))
        if first.stop < 12:
            continue
        for name, residuals in left.items():
            times = getattr(flight, name)[first]
            y = flight.positions[first, 1]
            residuals.append(np.std(y - np.polyval(np.polyfit(times, y, 3), times)))
    assert np.median(left["times"]) < 0.0015
    assert np.median(left["times"]) < 0.4 * np.median(left["stamps"])


@pytest.mark.long
@pytest.mark.needs("recordings")
def test_recorded_flights_go_where_their_spin_takes_them(recording):
    flights = load_spin_flights(recording("table_tennis_spin.npz"))[42:84]
    evaluation = evaluate_flights(flights, lambda done, total: None)
    for errors in ("beyond_bounce", "beyond_seen"):
        ours, none = (
            np.nanmedian([getattr(score, errors)[way] for score in evaluation.test])
            for way in (SMOOTHED, SPINLESS)
        )
        assert ours < 0.8 * none
    # Of these recordings the measured spins are those of the flights.
    level = [abs(score.after[0] / score.measured[0] - 1.0) for score in evaluation.test]
    assert np.median(level) < 0.6
