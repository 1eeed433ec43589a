"""Cube tosses: read, simulated again, fitted; their centre of mass; the baseline of free flight.

Tosses are made here by an engine; the recording is used where it is.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.scene import Environment, Plane
from intuitive_physics.simulation import make_simulator
from intuitive_physics.state import ObjectState
from intuitive_physics.trajectory import Trajectory
from intuitive_physics_experiments.recorded_sets.cube_tosses import (
    LENGTH_CORRECTION,
    CubeToss,
    cube_tosses,
)
from intuitive_physics_experiments.recorded_sets.recorded_data import load_cube_tosses
from intuitive_physics_experiments.recorded_sets.toss_evaluation import (
    FAILED_DISTANCE,
    FrictionAndRestitution,
    TossBatch,
    TossErrors,
    evaluate_tosses,
    rotation_angles,
    toss_cost,
    toss_parameters,
)
from intuitive_physics_experiments.recorded_sets.toss_mass_centre import (
    fit_mass_centre,
    with_mass_centre,
)
from intuitive_physics_experiments.recorded_sets.toss_tables import toss_table
from intuitive_physics_experiments.recorded_sets.tumbling_flight import tumbling_flight
from intuitive_physics_learner.learning_session import LearningOptions
from intuitive_physics_learner.search.convergence import ConvergenceCriteria

WIDTH = 0.1
TABLE = Environment([Plane("table", "table", (0.0, 0.0, 1.0), 0.0)])
CORNERS = 0.5 * WIDTH * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
vectors = st.tuples(*[st.floats(-8.0, 8.0)] * 3)


def learning(iterations: int) -> LearningOptions:
    criteria = ConvergenceCriteria(max_iterations=iterations)
    return LearningOptions(method="cma_es", criteria=criteria, seed=2)


@pytest.mark.parametrize("engine", ["stepped", "bullet"])
def test_tosses_are_simulated_again_as_they_were(toss_arrays, engine):
    batch = TossBatch(cube_tosses(toss_arrays(4, engine)))
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


@pytest.mark.needs("recordings")
def test_recorded_cubes_fall_and_come_to_rest_on_a_face(recording):
    tosses = load_cube_tosses(recording("cube_tosses.npz"), LENGTH_CORRECTION)
    assert len(tosses) == 400
    assert {toss.width for toss in tosses} == {0.1048}
    heights = [toss.observation.objects[0].trajectory.positions[-1, 2] for toss in tosses]
    # Half an edge is 52.4 mm; the correction is good to half a percent.
    assert np.median(heights) == pytest.approx(0.0524, abs=0.0005)
    # R(t) = R(0) exp(ω_body t) between the first two rows, at the spin of the first one.
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


def still_tosses(*steps: int) -> list[CubeToss]:
    """Cubes at rest in the air, each with its number of rows after the first one."""
    count = sum(steps) + len(steps)
    return cube_tosses(
        {
            "position": np.tile([0.0, 0.0, 1.0], (count, 1)),
            "quaternion_wxyz": np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)),
            "velocity_world": np.zeros((count, 3)),
            "angular_velocity_body": np.zeros((count, 3)),
            "offsets": np.cumsum([0, *(n + 1 for n in steps)]),
            "dt": 0.01,
            "cube_edge": WIDTH,
        }
    )


def test_errors_are_means_over_the_steps_after_the_first_row():
    batch = TossBatch(still_tosses(4, 2))
    positions = np.tile([0.0, 0.0, 1.0], (2, 4, 1))
    positions[0, :, 0] = [0.01, 0.02, 0.03, 0.04]
    positions[1, :2, 1] = [0.0, 0.1]
    # What is said of the time after a toss's end does not count.
    positions[1, 2:] = np.nan
    turns = np.array([[0.1, 0.2, 0.3, 0.4], [np.pi / 2, np.pi, np.nan, np.nan]])
    orientations = np.zeros((2, 4, 4))
    orientations[..., 0], orientations[..., 3] = np.sin(turns / 2), np.cos(turns / 2)
    errors = batch.errors(positions, orientations)
    assert errors.position == pytest.approx([0.25, 0.5])
    assert errors.rotation == pytest.approx([0.25, 0.75 * np.pi])


def test_a_step_that_was_not_simulated_counts_as_far_away():
    batch = TossBatch(still_tosses(2))
    positions = np.tile([0.0, 0.0, 1.0], (1, 2, 1))
    orientations = np.tile([0.0, 0.0, 0.0, 1.0], (1, 2, 1))
    positions[0, 1] = orientations[0, 1] = np.nan
    errors = batch.errors(positions, orientations)
    assert errors.position == pytest.approx([0.5 * FAILED_DISTANCE / WIDTH])
    assert errors.rotation == pytest.approx([0.5 * np.pi])


@given(
    vector=vectors,
    axis=vectors.filter(lambda v: np.linalg.norm(v) > 0.1),
    angle=st.floats(0.0, np.pi),
)
def test_the_angle_of_a_turn_is_found(vector, axis, angle):
    first = Rotation.from_rotvec(vector)
    turn = Rotation.from_rotvec(angle * np.array(axis) / np.linalg.norm(axis))
    a, b = first.as_quat(), (turn * first).as_quat()
    # Quaternions are rounded to about 1e-16, and an angle is twice theirs.
    assert rotation_angles(a, b) == pytest.approx(angle, abs=1e-14)
    assert rotation_angles(a, -b) == pytest.approx(angle, abs=1e-14)
    assert rotation_angles(b, a) == pytest.approx(angle, abs=1e-14)


@pytest.mark.parametrize("engine", ["stepped", "bullet"])
def test_the_coefficients_that_made_the_tosses_are_found(toss_arrays, engine):
    tosses = cube_tosses(toss_arrays(8, engine, friction=0.2, restitution=0.3))
    evaluation = evaluate_tosses(tosses, [engine], learning(80), train_fraction=0.5)
    assert (len(evaluation.training), len(evaluation.test)) == (4, 4)
    fit = evaluation.fits[engine]
    pair = fit.search.parameters.pair("cube", "table")
    assert pair["static_friction"] == pair["dynamic_friction"]
    assert pair["static_friction"] == pytest.approx(0.2, abs=0.02)
    assert pair["restitution"] == pytest.approx(0.3, abs=0.02)
    assert fit.search.cost == pytest.approx(toss_cost(fit.fitted[0], 0.1), rel=1e-9)
    for part in range(2):
        fitted, default = fit.fitted[part].position.mean(), fit.default[part].position.mean()
        assert fitted < 0.2 * default < default < evaluation.free_flight[part].position.mean()
    assert f"{engine}, fitted" in toss_table(evaluation)


def test_mujoco_is_fitted_in_its_softness_too(toss_arrays):
    tosses = cube_tosses(toss_arrays(2, "stepped"))
    fit = evaluate_tosses(tosses, ["mujoco"], learning(16), train_fraction=0.5).fits["mujoco"]
    assert fit.search.cost < toss_cost(fit.default[0], 0.1)
    assert fit.simulator.name == "mujoco"


def test_the_cost_is_distance_plus_turn_of_a_face():
    # Width 0.1 m: 0.2 widths are 20 mm, and 0.5 rad move a face's middle by 25 mm.
    errors = TossErrors(np.array([[0.1, 0.3]]), np.array([[0.0, 1.0]]))
    assert toss_cost(errors, 0.1) == pytest.approx([0.045])


@given(point=st.tuples(*[st.floats(-0.5, 1.5)] * 2))
def test_every_point_is_one_friction_and_one_restitution(point):
    pair = FrictionAndRestitution().to_parameters(point).pair("cube", "table")
    friction, restitution = np.clip(point, 0.0, 1.0)
    assert pair == {
        "static_friction": friction,
        "dynamic_friction": friction,
        "rolling_friction": 0.0,
        "restitution": restitution,
    }


def test_one_toss_is_too_few(toss_arrays):
    with pytest.raises(InvalidInputError, match="at least 2"):
        evaluate_tosses(cube_tosses(toss_arrays(1)), ["stepped"], learning(80))


@settings(max_examples=10)
@given(st.tuples(*[st.floats(-0.03, 0.03)] * 3))
def test_the_centre_that_made_the_flights_is_found(toss_arrays, mass_centre):
    # Free flight of `stepped` is exact to rounding; a fall of 0.1 m takes 14 rows of 10 ms.
    fit = fit_mass_centre(cube_tosses(toss_arrays(5, "stepped", mass_centre=mass_centre)))
    assert fit.mass_centre == pytest.approx(mass_centre, abs=1e-6)


def test_the_deviation_is_that_of_the_noise(toss_arrays):
    # (c - c_true) / σ has mean square 1, and σ of 30 flights is itself good to √(2/30) in its
    # square; of 120, √(2/120) more: within 4 of both together 0.4 to 2 (false alarm 1e-4).
    centre = (0.004, -0.002, 0.006)
    tosses = cube_tosses(toss_arrays(30, "stepped", mass_centre=centre))
    rng = np.random.default_rng(5)
    pulls = []
    for _ in range(40):
        fit = fit_mass_centre([noisy(toss, rng) for toss in tosses])
        pulls.append((fit.mass_centre - centre) / fit.deviation)
    assert 0.4 < np.mean(np.square(pulls)) < 2.0


def noisy(toss: CubeToss, rng: np.random.Generator) -> CubeToss:
    (observed,) = toss.observation.objects
    path = observed.trajectory
    moved = Trajectory(path.times, path.positions + rng.normal(0.0, 5e-4, path.positions.shape))
    objects = (replace(observed, trajectory=moved),)
    return replace(toss, observation=replace(toss.observation, objects=objects))


def test_tosses_that_tell_nothing_are_refused(toss_arrays):
    toss = cube_tosses(toss_arrays(1, "stepped"))[0]
    (observed,) = toss.observation.objects
    few = Trajectory(observed.trajectory.times[:5], observed.trajectory.positions[:5])
    objects = (replace(observed, trajectory=few),)
    short = replace(
        toss,
        observation=replace(toss.observation, objects=objects),
        orientations=toss.orientations[:5],
    )
    with pytest.raises(InvalidInputError, match="no toss flies for 6 rows"):
        fit_mass_centre([short])
    unturned = replace(toss, orientations=np.tile(toss.orientations[:1], (60, 1)))
    for tosses in ([unturned] * 4, [toss]):
        with pytest.raises(InvalidInputError, match="3 or more that turn"):
            fit_mass_centre(tosses)


def test_a_lopsided_cube_is_predicted_better_with_its_centre_of_mass(toss_arrays):
    tosses = cube_tosses(toss_arrays(8, "stepped", mass_centre=(0.0, 0.006, 0.0)))
    plain, better = (
        evaluate_tosses(tosses, ["stepped"], learning(150), 0.5, learn_mass_centre=learn)
        for learn in (False, True)
    )
    assert plain.mass_centre is None
    assert better.mass_centre is not None
    for part in range(2):
        errors = [e.fits["stepped"].fitted[part].position.mean() for e in (plain, better)]
        assert errors[1] < 0.5 * errors[0]


@pytest.mark.needs("recordings")
def test_the_recorded_cube_is_heavier_on_one_side(recording):
    # Two halves of the flights tell the same place, some 5 mm from the centre; and the cube comes
    # to rest on that side more often than on the other.
    tosses = load_cube_tosses(recording("cube_tosses.npz"))
    halves = [fit_mass_centre(tosses[start::2]) for start in (0, 1)]
    apart = halves[0].mass_centre - halves[1].mass_centre
    assert np.all(np.abs(apart) < 4.0 * np.hypot(halves[0].deviation, halves[1].deviation))
    centre = fit_mass_centre(tosses).mass_centre
    assert 0.004 < np.linalg.norm(centre) < 0.007
    heavy = int(np.argmax(np.abs(centre)))
    (cube,) = with_mass_centre(tosses[0], centre).observation.objects
    assert cube.object.mass_centre[heavy] == centre[heavy]
    last = np.array([toss.orientations[-1] for toss in tosses])
    x, y, z, w = last.T
    upwards = np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)])
    sides = np.sign(centre[heavy]) * upwards[heavy]
    assert np.sum(sides < -0.99) > 1.3 * np.sum(sides > 0.99)


def test_a_flat_cube_stops_on_its_face():
    # From height h of its face at rest: t = √(2 h / g).
    state = ObjectState((0.0, 0.0, 0.5 + WIDTH / 2), linear_velocity=(2.0, 0.0, 0.0))
    positions, orientations = tumbling_flight(TABLE, WIDTH, state, [0.1, 0.4, 0.9])
    assert positions[0] == pytest.approx([0.2, 0.0, 0.55 - 0.5 * 9.81 * 0.01])
    assert positions[2] == pytest.approx([2.0 * np.sqrt(1.0 / 9.81), 0.0, WIDTH / 2])
    assert orientations == pytest.approx(np.tile([0.0, 0.0, 0.0, 1.0], (3, 1)))


def test_it_turns_at_a_constant_rate_about_an_axis_of_the_world():
    state = ObjectState(
        (0.0, 0.0, 9.0), Rotation.from_rotvec([1, 0, 0]).as_quat(), (0, 0, 0), (0, 0, 2)
    )
    _, orientations = tumbling_flight(TABLE, WIDTH, state, [0.25, 0.5])
    expected = Rotation.from_rotvec([0, 0, 1]) * Rotation.from_rotvec([1, 0, 0])
    assert (Rotation.from_quat(orientations[1]) * expected.inv()).magnitude() < 1e-12


@given(vector=vectors, velocity=vectors, spin=vectors, height=st.floats(0.1, 1.0))
def test_no_corner_gets_into_the_table_and_the_cube_ends_on_one(vector, velocity, spin, height):
    state = ObjectState((0, 0, height), Rotation.from_rotvec(vector).as_quat(), velocity, spin)
    # Long enough to come down from anywhere; rows as near as those of the recordings.
    positions, orientations = tumbling_flight(TABLE, WIDTH, state, np.arange(1, 300) / 148.0)
    corners = Rotation.from_quat(np.repeat(orientations, 8, axis=0)).apply(
        np.tile(CORNERS, (len(positions), 1))
    )
    lowest = positions[:, 2] + corners[:, 2].reshape(-1, 8).min(axis=1)
    # brentq ends within 2e-12 s, at up to 20 m/s.
    assert lowest.min() > -1e-9
    assert lowest[-1] == pytest.approx(0.0, abs=1e-9)
