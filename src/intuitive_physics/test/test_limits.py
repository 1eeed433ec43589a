"""What exceeds an engine's room gets a status or an error, and nothing is left out in silence."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from intuitive_physics.errors import UnsupportedSceneError
from intuitive_physics.geometry.rotations import rotation_matrix
from intuitive_physics.materials import StaticParameters
from intuitive_physics.scene import Environment, Plane, Scene, SceneObject
from intuitive_physics.shapes import Box, Capsule, Sphere
from intuitive_physics.simulation import WorldStatus, pack_worlds
from intuitive_physics.simulation.rigid_bodies.overlaps import pushed_out
from intuitive_physics.simulation.rigid_bodies.scratch import CONTACTS_A_BODY
from intuitive_physics.simulation.rigid_bodies.world import MOST_PLANES, MOST_TOUCHED
from intuitive_physics.state import ObjectState

from .laws_scenes import (
    EVENT_DRIVEN,
    FLOOR,
    STEPPED,
    Body,
    coefficients,
    make_scene,
    quaternion,
)

TIMES = np.linspace(0.1, 1.0, 10)
RADIUS = 0.05


def outcome(engine, scene):
    return engine.simulator.rollout([scene, FALLING], coefficients(), TIMES)


FALLING = make_scene(Body(Sphere(RADIUS), (0, 0, 0.5)))


def resting_on(planes: int):
    return make_scene(Body(Sphere(RADIUS), (0, 0, RADIUS)), planes=[FLOOR] * planes)


@pytest.mark.parametrize(
    ("engine", "most"), [(EVENT_DRIVEN, MOST_TOUCHED), (STEPPED, CONTACTS_A_BODY)], ids=str
)
def test_one_contact_too_many_stops_a_world(engine, most):
    held = outcome(engine, resting_on(most))
    assert held.status.tolist() == [WorldStatus.OK, WorldStatus.OK]
    np.testing.assert_allclose(held.positions[0, 0, :, 2], RADIUS, atol=1e-5)
    dropped = outcome(engine, resting_on(most + 1))
    # The other world of the batch goes on.
    assert dropped.status.tolist() == [WorldStatus.TOO_MANY_CONTACTS, WorldStatus.OK]
    assert np.isnan(dropped.positions[0, 0, -1]).all()
    assert np.isfinite(dropped.positions[1]).all()


def sheet(k: int, half_width: float = 0.5) -> Plane:
    corners = half_width * np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)])
    return Plane(f"sheet_{k}", "ground", (0, 0, 1), -float(k), corners - (0, 0, k))


def test_a_bounded_plane_too_many_is_refused():
    body = Body(Box((0.1, 0.1, 0.1)), (0, 0, 0.3))
    most = make_scene(body, planes=[sheet(k) for k in range(MOST_PLANES)])
    assert outcome(STEPPED, most).status[0] == WorldStatus.OK
    with pytest.raises(UnsupportedSceneError, match=r"65 planes.*first 64"):
        outcome(STEPPED, make_scene(body, planes=[sheet(k) for k in range(MOST_PLANES + 1)]))
    # Planes without an edge have no such limit, nor have the spheres of event_driven.
    many = make_scene(body, planes=[(0, 0, 1, -0.1 * k) for k in range(MOST_PLANES + 1)])
    assert outcome(STEPPED, many).status[0] == WorldStatus.OK
    sphere = Body(Sphere(RADIUS), (0, 0, 0.3))
    planes = [sheet(k) for k in range(MOST_PLANES + 1)]
    assert outcome(EVENT_DRIVEN, make_scene(sphere, planes=planes)).status[0] == WorldStatus.OK


@pytest.mark.parametrize(("spin", "status"), [(100.0, "OK"), (2e5, "TOO_FAST")])
def test_a_body_too_fast_to_be_followed_stops_its_world(spin, status):
    # A rod that spins close over the floor, about an axis along it: its corners bend by ω² r, so
    # that the time of an advance is √(2 gap / ω² r) at most, some 10 µs / ω of a step of 10 ms.
    rod = Body(Box((0.3, 0.01, 0.01)), (0, 0, 0.0075), spin=(spin, 0, 0))
    scene = make_scene(rod, gravity=(0, 0, 0))
    assert outcome(STEPPED, scene).status[0] == WorldStatus[status]


def test_too_many_impacts_in_a_step_stop_a_world():
    # A ball between two walls that leave it 3 mm, at 250 m/s: an impact each 12 µs, 800 a step.
    walls = [(1, 0, 0, -RADIUS), (-1, 0, 0, -RADIUS - 3e-3)]
    for speed, status in ((250.0, WorldStatus.TOO_MANY_EVENTS), (10.0, WorldStatus.OK)):
        ball = Body(Sphere(RADIUS), (1e-3, 0, 0), velocity=(speed, 0, 0))
        scene = make_scene(ball, planes=walls, gravity=(0, 0, 0))
        rollout = STEPPED.simulator.rollout([scene], coefficients(0.0, e=1.0), TIMES)
        assert rollout.status[0] == status


@pytest.mark.parametrize(
    ("count", "status"), [(4, "OK"), (12, "NOT_CONVERGED"), (36, "NOT_CONVERGED")]
)
def test_a_tower_whose_forces_are_not_found_says_so(count, status):
    # Each cube a thousand times heavier than the one below, in turns. Newton's method does not end
    # for twelve of them, and is not tried for more than 128 contacts, of which each cube has four;
    # sweeps take tens of thousands of rounds.
    edge = 0.1
    materials = ["light", "heavy"]
    cubes = [SceneObject(f"cube_{k}", materials[k % 2], Box((edge,) * 3)) for k in range(count)]
    states = [ObjectState((0, 0, edge * (k + 0.5))) for k in range(count)]
    environment = Environment([Plane("floor", "ground", (0, 0, 1), 0.0)])
    table = np.stack([np.full((3, 3), value) for value in (0.5, 0.4, 0.0, 0.0)])
    theta = StaticParameters([*materials, "ground"], np.array([1.0, 1e3, 1e3]), table)
    scene = Scene(environment, tuple(cubes), tuple(states))
    rollout = STEPPED.simulator.rollout([scene], theta, TIMES)
    assert rollout.status[0] == WorldStatus[status]
    if status == "OK":
        np.testing.assert_allclose(rollout.positions[0, -1, -1], states[-1].position, atol=1e-3)


def test_a_table_may_have_many_corners():
    # All corners of the table lie under the box: each is a contact, and none is left out.
    angles = np.linspace(0.0, 2.0 * np.pi, 30, endpoint=False)
    rim = 0.1 * np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=1)
    table = Plane("table", "ground", (0, 0, 1), 0.0, rim)
    scene = make_scene(Body(Box((0.3, 0.3, 0.1)), (0, 0, 0.05)), planes=[table])
    positions, orientations = STEPPED.poses(scene, coefficients(), TIMES)
    np.testing.assert_allclose(positions[0] - (0, 0, 0.05), 0.0, atol=1e-4)
    np.testing.assert_allclose(np.abs(orientations[0, :, 3]), 1.0, atol=1e-6)


BEHIND = {
    "sphere": Body(Sphere(RADIUS), (0, 0, -0.02)),
    "box": Body(Box((0.2, 0.1, 0.1)), (0, 0, -0.01), quaternion((0.3, 0.2, 0.1))),
    "capsule": Body(Capsule(0.03, 0.1), (0.1, 0, -0.02), quaternion((0.0, 0.4, 0.0))),
    "over the edge": Body(Box((0.2, 0.1, 0.1)), (0.55, 0, -0.03)),
}


@pytest.mark.parametrize(
    ("engine", "name"), [(EVENT_DRIVEN, "sphere"), *((STEPPED, name) for name in BEHIND)], ids=str
)
def test_what_begins_behind_a_bounded_plane_is_a_status_or_is_pushed_out(engine, name):
    body = BEHIND[name]
    worlds = pack_worlds([make_scene(body, planes=[sheet(0)]), FALLING], coefficients(e=0.0))
    fallen = engine.simulator.rollout_batch(worlds, TIMES)
    assert fallen.status.tolist() == [WorldStatus.BEHIND_PLANE, WorldStatus.OK]
    assert np.isnan(fallen.positions[0]).all()
    assert np.isfinite(fallen.positions[1]).all()
    held = engine.simulator.rollout_batch(worlds, TIMES, push_out=True)
    assert held.status.tolist() == [WorldStatus.OK, WorldStatus.OK]
    # The one over the edge may tilt, and falls off the table then.
    if abs(body.position[0]) < 0.5:
        assert (held.positions[0, 0, :, 2] > 0.0).all()


@given(height=st.floats(-0.3, 0.3), turn=st.tuples(*[st.floats(-3.0, 3.0)] * 3))
def test_what_is_pushed_out_touches_the_plane_from_its_front_or_is_behind_it(height, turn):
    shape = Box((0.3, 0.2, 0.1))
    scene = make_scene(Body(shape, (0, 0, height), quaternion(turn)), planes=[sheet(0)])
    worlds = pack_worlds([scene], coefficients())
    out = pushed_out(worlds)
    axes = rotation_matrix(np.array(quaternion(turn)))
    reach = 0.5 * np.abs(axes[2]) @ np.array(shape.edge_lengths)
    expected = height
    if -reach < height <= 0.0:
        expected = reach if height > -0.5 * reach else -reach
    assert out.states[0, 0, 2] == pytest.approx(expected, abs=1e-8)
