"""The loader of cube tosses, on tosses made here and on the recording where it is."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.spatial.transform import Rotation

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.simulation import make_simulator
from intuitive_physics_experiments.recorded_sets.cube_tosses import LENGTH_CORRECTION, cube_tosses
from intuitive_physics_experiments.recorded_sets.recorded_data import (
    CUBE_TOSSES,
    kind_of_set,
    load_cube_tosses,
    load_recorded_set,
)
from intuitive_physics_experiments.recorded_sets.toss_evaluation import TossBatch, toss_parameters

TossArrays = Callable[..., dict[str, Any]]
components = st.floats(-8.0, 8.0)
vectors = st.tuples(components, components, components)


@pytest.mark.parametrize("engine", ["stepped", "bullet"])
def test_tosses_are_simulated_again_as_they_were(tmp_path, toss_arrays, engine):
    path = tmp_path / "set.npz"
    np.savez(path, **toss_arrays(4, engine))
    assert kind_of_set(path) is CUBE_TOSSES
    batch = TossBatch(load_cube_tosses(path))
    errors = batch.simulated(make_simulator(engine), [toss_parameters(0.2, 0.3)])
    # The same engine from the same state: what rounding of the rotated spin leaves, grown by some
    # impacts, is far below a thousandth of the width and a thousandth of a radian.
    assert errors.position.shape == (1, 4)
    assert errors.position.max() < 1e-3
    assert errors.rotation.max() < 1e-3


@settings(max_examples=30)
@given(body_spin=vectors, rotation_vector=vectors)
def test_spin_is_turned_from_the_cube_into_the_world(body_spin, rotation_vector):
    # A freely turning cube has R(t) = R(0) exp(ω_body t) = exp(ω_world t) R(0).
    start = Rotation.from_rotvec(rotation_vector)
    turned = start * Rotation.from_rotvec(0.01 * np.array(body_spin))
    quaternions = np.array([start.as_quat(), turned.as_quat()])
    (toss,) = cube_tosses(one_toss(quaternion_wxyz=quaternions[:, [3, 0, 1, 2]], spin=body_spin))
    (cube,) = toss.observation.objects
    state = cube.initial_state
    again = Rotation.from_rotvec(0.01 * state.angular_velocity) * Rotation.from_quat(
        state.orientation
    )
    assert (again * Rotation.from_quat(toss.orientations[1]).inv()).magnitude() < 1e-7


def one_toss(
    quaternion_wxyz: np.ndarray, spin: tuple[float, ...] = (0.0, 0.0, 0.0)
) -> dict[str, Any]:
    return {
        "position": np.array([[0.0, 0.0, 1.0], [0.1, 0.0, 1.0]]),
        "quaternion_wxyz": quaternion_wxyz,
        "velocity_world": np.array([[1.0, 0.0, 0.0]] * 2),
        "angular_velocity_body": np.array([spin] * 2),
        "offsets": np.array([0, 2]),
        "dt": 0.01,
        "cube_edge": 0.1,
    }


def test_lengths_are_corrected_but_for_the_cube(toss_arrays):
    arrays = toss_arrays(2)
    (toss, _), (longer, _) = cube_tosses(arrays), cube_tosses(arrays, 1.5)
    (cube,), (longer_cube,) = toss.observation.objects, longer.observation.objects
    assert longer_cube.trajectory.positions == pytest.approx(1.5 * cube.trajectory.positions)
    state, longer_state = cube.initial_state, longer_cube.initial_state
    assert longer_state.position == pytest.approx(1.5 * state.position)
    assert longer_state.linear_velocity == pytest.approx(1.5 * state.linear_velocity)
    assert longer_state.angular_velocity == pytest.approx(state.angular_velocity)
    assert longer.width == toss.width == 0.1


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"quaternion_wxyz": np.full((120, 4), 0.6)}, "norm 1.2"),
        ({"quaternion_wxyz": np.zeros((120, 3))}, "shape"),
        ({"position": np.full((120, 3), np.nan)}, "not finite"),
        ({"velocity_world": np.zeros((119, 3))}, "offsets go from"),
        ({"offsets": np.array([0, 1, 120])}, "expected points after the start"),
        ({"dt": np.array(0.0)}, "above zero"),
        ({"cube_edge": np.array(-0.1)}, "above zero"),
        ({"cube_edge": np.ones(2)}, "expected a number"),
    ],
)
def test_what_a_toss_cannot_have_is_named(tmp_path, toss_arrays, change, message):
    np.savez(tmp_path / "set.npz", **{**toss_arrays(2), **change})
    for load in (load_recorded_set, load_cube_tosses):
        with pytest.raises(InvalidInputError, match=message):
            load(tmp_path / "set.npz")


def test_other_sets_are_no_tosses(tmp_path, launch_arrays):
    np.savez(tmp_path / "set.npz", **launch_arrays(2))
    assert kind_of_set(tmp_path / "set.npz") is not CUBE_TOSSES
    with pytest.raises(InvalidInputError, match="expected cube tosses"):
        load_cube_tosses(tmp_path / "set.npz")


@settings(max_examples=60)
@given(
    quaternions=hnp.arrays(np.float64, (2, 4), elements=st.floats(width=32)),
    spin=st.tuples(*[st.floats(width=32)] * 3),
)
def test_any_numbers_are_loaded_or_refused(quaternions, spin):
    try:
        (toss,) = cube_tosses(one_toss(quaternions, spin))
    except InvalidInputError:
        return
    assert np.linalg.norm(toss.orientations, axis=1) == pytest.approx(1.0)


@pytest.mark.needs("recordings")
def test_recorded_cubes_fall_and_come_to_rest_on_a_face(recording):
    tosses = load_cube_tosses(recording("cube_tosses.npz"), LENGTH_CORRECTION)
    assert len(tosses) == 400
    assert {toss.width for toss in tosses} == {0.1048}
    heights = [toss.observation.objects[0].trajectory.positions[-1, 2] for toss in tosses]
    # Half an edge is 52.4 mm; the correction is good to half a percent.
    assert np.median(heights) == pytest.approx(0.0524, abs=0.0005)
    # R(t) = R(0) exp(ω_body t) between the first two rows, at the spin the first one tells.
    turns = []
    for toss in tosses:
        spin = toss.observation.objects[0].initial_state.angular_velocity
        expected = Rotation.from_rotvec(spin / 148.0) * Rotation.from_quat(toss.orientations[0])
        turns.append((Rotation.from_quat(toss.orientations[1]) * expected.inv()).magnitude())
    assert np.median(turns) < 0.005


def test_the_cube_turns_as_it_was_measured(toss_arrays):
    arrays = toss_arrays(1)
    # m a² / 6 of 0.4 kg and 0.1 m is 6.67e-4 kg m².
    measured = {**arrays, "mass": np.array(0.4), "inertia": np.array(8e-4)}
    (toss,) = cube_tosses(measured, measured_inertia=True)
    assert toss.observation.objects[0].object.inertia_factor == pytest.approx(1.2)
    with pytest.raises(InvalidInputError, match="no array mass"):
        cube_tosses(arrays, measured_inertia=True)
