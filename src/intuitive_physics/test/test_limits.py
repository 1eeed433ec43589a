"""What exceeds an engine's room gets a status or an error, and nothing is left out in silence."""

from __future__ import annotations

import numpy as np
import pytest

from intuitive_physics.errors import UnsupportedSceneError
from intuitive_physics.scene import Plane
from intuitive_physics.shapes import Box, Sphere
from intuitive_physics.simulation import WorldStatus
from intuitive_physics.simulation.event_driven.world import MOST_TOUCHED
from intuitive_physics.simulation.rigid_bodies.world import CONTACTS_A_BODY, MOST_PLANES
from intuitive_physics.simulation.stepped.impact_times import SAMPLES

from .laws_scenes import EVENT_DRIVEN, FLOOR, STEPPED, Body, coefficients, make_scene

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


@pytest.mark.parametrize(("share", "status"), [(0.9, "OK"), (1.1, "TOO_FAST")])
def test_a_body_too_fast_to_be_followed_stops_its_world(share, status):
    # A sample for each half radius of a step's way: v Δt = SAMPLES r / 2.
    radius = 0.01
    speed = share * SAMPLES * 0.5 * radius / STEPPED.step
    body = Body(Sphere(radius), (0, 0, 1.0), velocity=(0, 0, -speed))
    assert outcome(STEPPED, make_scene(body, planes=[sheet(0)])).status[0] == WorldStatus[status]


def test_a_table_may_have_many_corners():
    # All corners of the table lie under the box: each is a contact, and none is left out.
    angles = np.linspace(0.0, 2.0 * np.pi, 30, endpoint=False)
    rim = 0.1 * np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=1)
    table = Plane("table", "ground", (0, 0, 1), 0.0, rim)
    scene = make_scene(Body(Box((0.3, 0.3, 0.1)), (0, 0, 0.05)), planes=[table])
    positions, orientations = STEPPED.poses(scene, coefficients(), TIMES)
    np.testing.assert_allclose(positions[0] - (0, 0, 0.05), 0.0, atol=1e-4)
    np.testing.assert_allclose(np.abs(orientations[0, :, 3]), 1.0, atol=1e-6)
