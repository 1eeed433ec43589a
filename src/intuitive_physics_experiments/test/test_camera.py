from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from intuitive_physics.errors import InvalidInputError
from intuitive_physics_experiments.rendering.camera import Camera

coordinate = st.floats(-3.0, 3.0)
points = st.tuples(coordinate, coordinate, coordinate)


@given(position=points, target=points)
def test_the_target_is_seen_in_the_middle_of_an_upright_image(position, target):
    direction = np.subtract(target, position)
    if np.linalg.norm(direction[:2]) < 0.05:
        return
    camera = Camera.looking_at(position, target)
    assert camera.project(target) == pytest.approx(camera.principal_point, abs=1e-6)
    # Up in the world is up in the image (smaller rows), right is level.
    assert (camera.rotation.T @ [0.0, 0.0, 1.0])[1] < 0.0
    assert abs(camera.rotation[2, 0]) < 1e-9
    assert np.linalg.det(camera.rotation) == pytest.approx(1.0)


def test_rays_and_projection_are_inverse():
    camera = Camera.looking_at((0, 0, 1), (1, 1, 0))
    depth = 1.7
    world = camera.rays()[[10, 400], [20, 600]] * depth @ camera.rotation.T + camera.position
    assert camera.project(world) == pytest.approx(np.array([[20.0, 10.0], [600.0, 400.0]]))
    assert camera.to_optical(world)[:, 2] == pytest.approx(depth)


def test_points_behind_have_no_pixel():
    camera = Camera.looking_at((0, 0, 1), (1, 0, 1))
    assert np.isnan(camera.project([-1.0, 0.0, 1.0])).all()


def test_dict_round_trip():
    camera = Camera.looking_at((0, 0, 1), (1, 1, 0))
    again = Camera.from_dict(camera.to_dict())
    assert np.array_equal(again.rotation, camera.rotation)
    assert again.focal_length == camera.focal_length


@pytest.mark.parametrize(
    "change", [{"width": 0}, {"focal_length": -1.0}, {"rotation": np.ones((3, 3)).tolist()}]
)
def test_bad_cameras_are_refused(change):
    data = Camera.looking_at((0, 0, 1), (1, 1, 0)).to_dict()
    with pytest.raises(InvalidInputError):
        Camera.from_dict({**data, **change})


def test_a_vertical_view_has_no_upright():
    with pytest.raises(InvalidInputError, match="vertical"):
        Camera.looking_at((0, 0, 1), (0, 0, 0))
