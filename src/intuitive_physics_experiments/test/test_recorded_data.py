"""Loaders of recorded data, on flights made here and on the recordings where they are."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from intuitive_physics.errors import InvalidInputError
from intuitive_physics_experiments.recorded_sets.recorded_data import (
    LAUNCHES,
    kind_of_set,
    load_cube_tosses,
    load_recorded_set,
    load_spin_flights,
    load_table_tennis,
)
from intuitive_physics_experiments.recorded_sets.table_tennis import (
    BALL_MASS,
    GUN_BOUNCE_HEIGHT,
    LAUNCH_BOUNCE_HEIGHT,
    AirCoefficients,
    ball_parameters,
    gun_observations,
    launch_observations,
    recovered_times,
)
from intuitive_physics_recordings.npz_file import load_arrays, load_cloud


def test_launches_become_observations(tmp_path, launch_arrays):
    np.savez(tmp_path / "set.npz", **launch_arrays(3))
    title, observations = load_recorded_set(tmp_path / "set.npz")
    assert title == "table-tennis launches"
    assert len(observations) == 3
    (ball,) = observations[0].objects
    assert observations[0].materials == ("ball", "table")
    assert ball.object.shape.radius == 0.02
    assert observations[0].environment.planes[0].offset == pytest.approx(
        LAUNCH_BOUNCE_HEIGHT - 0.02
    )
    assert ball.initial_state.linear_velocity == pytest.approx([-3.8, 0.1, 3.1], abs=1e-3)
    assert len(ball.trajectory) == 160


def test_balls_in_air_say_so(tmp_path, launch_arrays):
    np.savez(tmp_path / "set.npz", **launch_arrays(1))
    _, (observation,) = load_table_tennis(
        tmp_path / "set.npz", AirCoefficients(drag=0.4, magnus=1.0)
    )
    ball = observation.objects[0].object
    assert (ball.drag_coefficient, ball.magnus_coefficient) == (0.4, 1.0)
    assert ball.shape.mass(ball_parameters().density[0]) == pytest.approx(BALL_MASS)
    with pytest.raises(InvalidInputError, match="drag coefficient"):
        AirCoefficients(drag=-0.1)
    with pytest.raises(InvalidInputError, match="Magnus coefficient"):
        AirCoefficients(magnus=np.nan)


def test_uneven_time_steps_are_recovered_from_the_motion(bouncing_flight):
    rng = np.random.default_rng(0)
    halves = rng.choice([0, 1, 2, 2, 2, 2, 2, 3, 4], size=120)
    true = np.concatenate([[0.0], np.cumsum(halves)]) * 0.0055
    positions, velocities = bouncing_flight(true, GUN_BOUNCE_HEIGHT)
    velocities += rng.normal(0.0, 0.05, velocities.shape)
    times, kept = recovered_times(positions, velocities, 0.011)
    assert times == pytest.approx(np.unique(true))
    assert np.array_equal(positions[kept], positions[np.unique(true, return_index=True)[1]])


def test_a_flight_over_the_edge_of_the_table_ends_there(tmp_path, bouncing_flight):
    times = np.arange(145) * 0.011
    positions, velocities = bouncing_flight(times, GUN_BOUNCE_HEIGHT)
    assert positions[-1, 2] < GUN_BOUNCE_HEIGHT - 0.2
    np.savez(
        tmp_path / "set.npz",
        position=positions,
        velocity=velocities,
        offsets=[0, 145],
        dt_implied=0.011,
    )
    _, (observation,) = load_recorded_set(tmp_path / "set.npz")
    heights = observation.objects[0].trajectory.positions[:, 2]
    assert heights.min() > GUN_BOUNCE_HEIGHT - 0.03


@pytest.mark.parametrize(
    ("kind", "change", "message"),
    [
        ("launch", {"offsets": np.array([0, 160, 300])}, "offsets go from"),
        ("launch", {"offsets": np.array([0.0, 320.0])}, "whole numbers"),
        ("launch", {"position": np.zeros((320, 2))}, "shape"),
        ("launch", {"time": np.zeros(320)}, "strictly increase"),
        ("launch", {"radius": np.array(-1.0)}, "above zero"),
        ("toss", {"quaternion_wxyz": np.full((120, 4), 0.6)}, "norm 1.2"),
        ("toss", {"quaternion_wxyz": np.zeros((120, 3))}, "shape"),
        ("toss", {"position": np.full((120, 3), np.nan)}, "not finite"),
        ("toss", {"velocity_world": np.zeros((119, 3))}, "offsets go from"),
        ("toss", {"offsets": np.array([0, 1, 120])}, "expected points after the start"),
        ("toss", {"dt": np.array(0.0)}, "above zero"),
        ("toss", {"cube_edge": np.ones(2)}, "expected a number"),
    ],
)
def test_arrays_that_a_set_cannot_have_are_named(tmp_path, request, kind, change, message):
    arrays = request.getfixturevalue(f"{kind}_arrays")(2)
    np.savez(tmp_path / "set.npz", **{**arrays, **change})
    with pytest.raises(InvalidInputError, match=message):
        load_recorded_set(tmp_path / "set.npz")


def test_other_kinds_of_sets_are_refused(tmp_path, launch_arrays):
    np.savez(tmp_path / "set.npz", **launch_arrays(1))
    assert kind_of_set(tmp_path / "set.npz") is LAUNCHES
    with pytest.raises(InvalidInputError, match="launches; expected cube tosses"):
        load_cube_tosses(tmp_path / "set.npz")
    with pytest.raises(InvalidInputError, match="expected table-tennis flights with measured spin"):
        load_spin_flights(tmp_path / "set.npz")


def test_other_files_are_refused(tmp_path):
    np.savez(tmp_path / "other.npz", a=np.zeros(3))
    with pytest.raises(InvalidInputError, match="expected"):
        load_recorded_set(tmp_path / "other.npz")
    with pytest.raises(InvalidInputError, match="xyz"):
        load_cloud(tmp_path / "other.npz")
    np.savez(tmp_path / "flat.npz", xyz=np.zeros(9))
    with pytest.raises(InvalidInputError, match=r"expected \(n, 3\)"):
        load_cloud(tmp_path / "flat.npz")
    np.savez(tmp_path / "pickle.npz", xyz=np.array([{}], dtype=object))
    with pytest.raises(InvalidInputError, match="cannot read"):
        load_cloud(tmp_path / "pickle.npz")
    np.save(tmp_path / "bare.npy", np.zeros(3))
    with pytest.raises(InvalidInputError, match="one bare array"):
        load_cloud(tmp_path / "bare.npy")
    with pytest.raises(InvalidInputError, match="No such file"):
        load_cloud(tmp_path / "missing.npz")


@settings(max_examples=40, deadline=None)
@given(share=st.floats(0.0, 0.99))
def test_truncated_files_are_refused(tmp_path_factory, launch_arrays, share):
    path = tmp_path_factory.mktemp("npz") / "set.npz"
    np.savez(path, **launch_arrays(1))
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(InvalidInputError):
        load_recorded_set(path)


def any_rows(count: int, columns: int):
    return hnp.arrays(np.float64, (count, columns), elements=st.floats(width=32))


@settings(max_examples=60, deadline=None)
@given(
    arrays=st.one_of(
        st.fixed_dictionaries({"position": any_rows(24, 3), "velocity": any_rows(24, 3)}).map(
            lambda rows: {**rows, "offsets": [0, 24], "dt_implied": 0.011}
        ),
        st.fixed_dictionaries(
            {
                "position": any_rows(2, 3),
                "quaternion_wxyz": any_rows(2, 4),
                "velocity_world": any_rows(2, 3),
                "angular_velocity_body": any_rows(2, 3),
            }
        ).map(lambda rows: {**rows, "offsets": [0, 2], "dt": 0.01, "cube_edge": 0.1}),
    )
)
def test_any_numbers_are_loaded_or_refused(tmp_path_factory, arrays):
    path = tmp_path_factory.mktemp("npz") / "set.npz"
    np.savez(path, **arrays)
    try:
        _, observations = load_recorded_set(path)
    except InvalidInputError:
        return
    assert len(observations) <= 1


@pytest.mark.needs("recordings")
@pytest.mark.parametrize(
    ("name", "load", "share"),
    [
        ("table_tennis_launches", launch_observations, 0.4),
        ("table_tennis_gun", gun_observations, 0.5),
    ],
)
def test_air_explains_the_recorded_flights(recording, name, load, share):
    # What a model of the flight lacks widens the covariance of the velocity it finds.
    arrays = load_arrays(recording(f"{name}.npz"))
    spreads = []
    for air in (AirCoefficients(), AirCoefficients(drag=0.4, magnus=1.0)):
        states = [observation.objects[0].initial_state for observation in load(arrays, air)]
        along = slice(6, 9)
        spreads.append(
            np.median([np.sqrt(np.trace(state.covariance[along, along])) for state in states])
        )
    assert spreads[1] < share * spreads[0]


@pytest.mark.needs("recordings")
def test_the_gun_gives_its_balls_topspin(recording):
    arrays = load_arrays(recording("table_tennis_gun.npz"))
    observations = gun_observations(arrays, AirCoefficients(drag=0.4, magnus=1.0))
    states = [observation.objects[0].initial_state for observation in observations]
    # Topspin: ω along up × v, which pushes the ball down.
    directions = np.cross([0.0, 0.0, 1.0], [state.linear_velocity for state in states])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    spins = np.array([state.angular_velocity for state in states])
    top = (spins * directions).sum(axis=1)
    assert (top > 0.0).mean() > 0.95
    # One gun at one setting: what stands across the topspin is little.
    assert np.median(np.linalg.norm(spins - top[:, None] * directions, axis=1)) < 0.3 * np.median(
        top
    )


@pytest.mark.needs("recordings")
def test_recorded_launches_fly_as_balls_do(recording):
    _, observations = load_recorded_set(recording("table_tennis_launches.npz"))
    assert len(observations) == 32
    speeds = [
        np.linalg.norm(observation.objects[0].initial_state.linear_velocity)
        for observation in observations
    ]
    # One launcher at one setting.
    assert np.std(speeds) < 0.05 * np.mean(speeds)
    for observation in observations:
        heights = observation.objects[0].trajectory.positions[:, 2]
        gap = heights.min() - observation.environment.planes[0].offset
        assert 0.015 < gap < 0.045  # lowest sample near the bounce


@pytest.mark.needs("recordings")
def test_recovered_times_of_the_gun_make_balls_fall_as_they_do(recording):
    # At the top of the flight drag has no vertical part: the second derivative of the height is
    # gravity, and what topspin adds (about a tenth). Even steps of dt_implied give only 8.9 m/s².
    _, observations = load_recorded_set(recording("table_tennis_gun.npz"))
    assert len(observations) == 106
    falls = []
    for observation in observations:
        trajectory = observation.objects[0].trajectory
        times, heights = trajectory.times, trajectory.positions[:, 2]
        top = np.argmax(heights)
        near = np.abs(times - times[top]) < 0.2
        falls.append(-2.0 * np.polyfit(times[near] - times[top], heights[near], 3)[1])
    assert np.median(falls) == pytest.approx(10.6, abs=0.5)


@pytest.mark.needs("recordings")
@pytest.mark.parametrize("number", [1, 2, 4, 5, 7])
def test_lidar_scans_are_clouds(recording, number):
    points = load_cloud(recording(f"lidar_ball_{number}.npz"))
    assert points.dtype == np.float32
    assert points.shape[1] == 3
