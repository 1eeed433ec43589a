from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from intuitive_physics.scene import Environment, Plane
from intuitive_physics.state import ObjectState
from intuitive_physics_cli.evaluation.evaluation import free_flight

from .bouncing_balls import CORNER

R = 0.05
inside = st.floats(-1.0, 1.0 - R)
speed = st.floats(-4.0, 4.0)


def test_without_planes_it_is_a_parabola() -> None:
    state = ObjectState((0.0, 1.0, 2.0), linear_velocity=(1.0, 0.0, 3.0))
    times = np.linspace(0.0, 2.0, 9)
    expected = state.position + times[:, None] * state.linear_velocity
    expected[:, 2] -= 0.5 * 9.81 * times**2
    assert free_flight(Environment(), R, state, times) == pytest.approx(expected)


def test_it_stops_at_the_floor_when_it_gets_there() -> None:
    # From height h at rest: t = √(2 h / g).
    state = ObjectState((0.0, 0.0, 1.0 + R), linear_velocity=(1.0, 0.0, 0.0))
    path = free_flight(CORNER, R, state, [0.0, 0.3, 0.6])
    assert path[2] == pytest.approx([np.sqrt(2.0 / 9.81), 0.0, R])


# On the floor but for rounding, on its way down.
@example(x=0.0, y=0.0, z=0.05000000000000001, vx=0.0, vy=0.0, vz=-1.0)
@given(x=inside, y=inside, z=st.floats(R, 2.0), vx=speed, vy=speed, vz=speed)
def test_it_never_leaves_the_room_and_only_stops_at_a_plane(
    x: float, y: float, z: float, vx: float, vy: float, vz: float
) -> None:
    environment = CORNER
    state = ObjectState((x, y, z), linear_velocity=(vx, vy, vz))
    path = free_flight(environment, R, state, np.linspace(0.0, 3.0, 60))
    gaps = np.array([plane.signed_distances(path) - R for plane in environment.planes])
    assert gaps.min() > -1e-9
    assert gaps[:, -1].min() == pytest.approx(0.0, abs=1e-9)


def test_a_weightless_ball_reaches_the_wall_it_flies_to() -> None:
    environment = Environment([Plane("wall", "room", (-1, 0, 0), -1.0)], gravity=(0, 0, 0))
    towards = ObjectState((0, 0, 0), linear_velocity=(1.0, 0.0, 0.0))
    away = ObjectState((0, 0, 0), linear_velocity=(-1.0, 0.0, 0.0))
    assert free_flight(environment, R, towards, [2.0])[0] == pytest.approx([1.0 - R, 0.0, 0.0])
    assert free_flight(environment, R, away, [2.0])[0] == pytest.approx([-2.0, 0.0, 0.0])
