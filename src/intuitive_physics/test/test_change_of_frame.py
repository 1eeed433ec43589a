"""Scenes are the same in every frame: a simulation and a change of frame can be exchanged."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.frames.change_of_frame import (
    RigidTransform,
    environment_in,
    observation_in,
    state_in,
)
from intuitive_physics.geometry.rotations import rotation_matrix
from intuitive_physics.materials import StaticParameters
from intuitive_physics.observation import Detections, Observation, ObservedObject, SeenSpin
from intuitive_physics.scene import Environment, Plane, Scene, SceneObject, StaticBox
from intuitive_physics.shapes import Box, Sphere
from intuitive_physics.simulation import make_simulator
from intuitive_physics.state import ObjectState
from intuitive_physics.trajectory import Trajectory

numbers = st.floats(-5.0, 5.0)
vectors = st.tuples(numbers, numbers, numbers)


@st.composite
def transforms(draw) -> RigidTransform:
    quaternion = np.array(draw(st.tuples(*[st.floats(-1.0, 1.0)] * 4)))
    if np.linalg.norm(quaternion) < 0.1:
        quaternion = np.array([0.0, 0.0, 0.0, 1.0])
    return RigidTransform(draw(vectors), quaternion / np.linalg.norm(quaternion))


@given(transforms(), transforms(), vectors)
def test_transforms_are_a_group(first, second, point) -> None:
    assert first.inverse.points(first.points(point)) == pytest.approx(point, abs=1e-12)
    both = second.after(first)
    assert both.points(point) == pytest.approx(second.points(first.points(point)), abs=1e-12)
    assert both.matrix == pytest.approx(second.matrix @ first.matrix, abs=1e-12)
    shift, angle = both.inverse.difference(first.inverse.after(second.inverse))
    assert shift == pytest.approx(0.0, abs=1e-12)
    assert angle == pytest.approx(0.0, abs=1e-7)


@given(transforms(), st.floats(0.0, np.pi))
def test_the_difference_is_a_shift_and_an_angle(transform, angle) -> None:
    turned = transform.after(
        RigidTransform((0, 0, 0), (0, 0, np.sin(angle / 2), np.cos(angle / 2)))
    )
    moved = RigidTransform(turned.translation + [3.0, 4.0, 0.0], turned.orientation)
    assert transform.difference(moved) == pytest.approx((5.0, angle), abs=1e-6)


@given(transforms(), st.integers(0, 2**32 - 1))
def test_covariances_turn_with_what_they_are_of(transform, seed) -> None:
    # Cov(R x) = R Cov(x) Rᵀ, for each of the stacked vectors and between them.
    root = np.random.default_rng(seed).normal(size=(12, 12))
    samples = np.random.default_rng(seed).normal(size=(50, 12)) @ root.T
    turned = transform.directions(samples.reshape(50, 4, 3)).reshape(50, 12)
    expected = np.cov(turned.T)
    assert transform.covariances(np.cov(samples.T)) == pytest.approx(expected, rel=1e-9, abs=1e-9)


def room() -> Environment:
    edge = [[-2, -2, 0], [2, -2, 0], [2, 2, 0], [-2, 2, 0]]
    return Environment(
        [Plane("floor", "wood", (0, 0, 1), 0.0, edge), Plane("wall", "stone", (-1, 0, 0), -1.5)],
        [StaticBox("crate", "wood", (0.8, 0.3, 0.1), (0, 0, 0.6, 0.8), (0.3, 0.4, 0.2))],
        frame_id="camera_room",
    )


OBJECTS = (
    SceneObject("ball", "rubber", Sphere(0.05)),
    SceneObject("box", "rubber", Box((0.1, 0.2, 0.3))),
)


@settings(max_examples=25)
@given(transforms(), st.integers(0, 2**32 - 1))
def test_what_lies_in_an_environment_lies_there_in_every_frame(transform, seed) -> None:
    places = np.random.default_rng(seed).uniform(-2.0, 2.0, (20, 3))
    here, there = room(), environment_in(room(), "map", transform)
    assert there.frame_id == "map"
    for plane, moved in zip(here.planes, there.planes, strict=True):
        distances = moved.signed_distances(transform.points(places))
        assert distances == pytest.approx(plane.signed_distances(places), abs=1e-12)
        assert (moved.covers(transform.points(places)) == plane.covers(places)).all()
    (box,), (turned,) = here.boxes, there.boxes
    own = (places - box.center) @ rotation_matrix(box.orientation)
    again = (transform.points(places) - turned.center) @ rotation_matrix(turned.orientation)
    assert again == pytest.approx(own, abs=1e-12)


@settings(max_examples=15)
@given(transforms(), vectors, vectors)
@pytest.mark.parametrize("engine", ["event_driven", "stepped"])
def test_a_simulation_is_the_same_in_every_frame(engine, transform, velocity, spin) -> None:
    # Newton's laws have no preferred axes. Up to the first contact both engines are exact, so only
    # rounding is left: 1e-9 m.
    floor = Environment([Plane("floor", "wood", (0, 0, 1), -50.0)], frame_id="here")
    state = ObjectState((0.0, 0.0, 1.0), (0, 0, 0, 1), velocity, spin)
    body = OBJECTS[:1] if engine == "event_driven" else OBJECTS[1:]
    times = np.linspace(0.0, 0.5, 6)
    coefficients = StaticParameters.uniform(["rubber", "wood"])
    here = Scene(floor, body, (state,))
    there = Scene(environment_in(floor, "there", transform), body, (state_in(state, transform),))
    simulator = make_simulator(engine)
    positions, moved = (
        simulator.rollout([scene], coefficients, times).positions[0, 0] for scene in (here, there)
    )
    assert moved == pytest.approx(transform.points(positions), abs=1e-9)


def test_an_observation_is_moved_with_all_that_belongs_to_it() -> None:
    times = np.linspace(0.0, 0.5, 8)
    positions = np.outer(times, [1.0, 2.0, 3.0])
    spread = np.diag([1e-6, 4e-6, 9e-6])
    seen = ObservedObject(
        OBJECTS[0],
        Trajectory(times, positions),
        ObjectState((0, 0, 0), (0, 0, 0, 1), (1, 2, 3), (0, 0, 1), np.diag(np.arange(1.0, 13.0))),
        Detections(
            times,
            positions,
            np.tile(spread, (8, 1, 1)),
            2.0 * spread,
            SeenSpin((1, 2, 3), spread, 0.1),
        ),
    )
    observation = Observation(room(), (seen,), 0.0)
    # A quarter turn about x: y becomes z, and z becomes -y.
    quarter = RigidTransform((10.0, 0.0, 0.0), (np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)))
    moved = observation_in(observation, "map", quarter)
    (there,) = moved.objects
    assert moved.environment.frame_id == "map"
    assert moved.id != observation.id
    assert there.trajectory.positions[-1] == pytest.approx([10.5, -1.5, 1.0])
    assert there.initial_state.linear_velocity == pytest.approx([1.0, -3.0, 2.0])
    assert np.diag(there.initial_state.covariance)[:6] == pytest.approx([1, 3, 2, 4, 6, 5])
    assert there.detections is not None
    assert np.diag(there.detections.bias) == pytest.approx([2e-6, 18e-6, 8e-6])
    spin = there.detections.spin
    assert spin is not None
    assert spin.mean == pytest.approx([1, -3, 2])
    assert np.diag(spin.covariance) == pytest.approx([1e-6, 9e-6, 4e-6])
    back = observation_in(moved, "camera_room", quarter.inverse)
    assert back.same_motion(observation)
    assert observation_in(observation, "map", quarter).id == moved.id


def test_frames_that_cannot_be_are_refused() -> None:
    with pytest.raises(InvalidInputError, match="orientation of a frame"):
        RigidTransform((0, 0, 0), (0, 0, 0, 0))
    with pytest.raises(InvalidInputError, match="translation of a frame"):
        RigidTransform((0, 0, np.nan))
