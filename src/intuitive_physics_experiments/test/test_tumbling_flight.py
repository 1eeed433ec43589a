from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from intuitive_physics.scene import Environment, Plane
from intuitive_physics.state import ObjectState
from intuitive_physics_experiments.recorded_sets.tumbling_flight import tumbling_flight

WIDTH = 0.1
TABLE = Environment([Plane("table", "table", (0.0, 0.0, 1.0), 0.0)])
CORNERS = 0.5 * WIDTH * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
components = st.floats(-6.0, 6.0)
vectors = st.tuples(components, components, components)


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
