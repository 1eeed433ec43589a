"""The renderer against depth worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.scene import Environment, StaticBox
from intuitive_physics_experiments.rendering.corner_room import corner_environment
from intuitive_physics_experiments.rendering.depth_renderer import DepthRenderer


def test_background_is_the_nearest_plane_of_each_ray(renderer):
    # Depth t of a ray with z = 1 from p along d: n · (p + t d) = offset.
    camera = renderer.camera
    directions = camera.rays() @ camera.rotation.T
    expected = np.full(directions.shape[:2], np.inf)
    cosine = np.ones_like(expected)
    for plane in corner_environment().planes:
        facing = directions @ plane.normal
        depth = (plane.offset - camera.position @ plane.normal) / facing
        nearer = (facing < 0.0) & (depth < expected)
        expected[nearer] = depth[nearer]
        cosine[nearer] = (-facing / np.linalg.norm(directions, axis=-1))[nearer]
    assert np.abs(renderer.background.depth - expected).max() < 1e-5
    differs = np.abs(renderer.background.incidence_cosine - cosine) > 1e-5
    assert differs.mean() < 0.005  # pixels on the seam of two planes


def test_the_floor_fills_most_of_the_image(renderer):
    # Sec. VI-B takes the plane with the most points for the floor.
    camera, depth = renderer.camera, renderer.background.depth
    points = camera.rays() * depth[..., None] @ camera.rotation.T + camera.position
    floor, *walls = [
        (np.abs(plane.signed_distances(points)) < 1e-3).mean()
        for plane in corner_environment().planes
    ]
    assert floor > 1.3 * max(walls)


@settings(max_examples=30, deadline=None)
@given(
    x=st.floats(-0.2, 0.9), y=st.floats(-0.2, 0.9), z=st.floats(0.1, 0.9), r=st.floats(0.02, 0.1)
)
def test_every_ball_pixel_lies_on_the_sphere(renderer, full_image, x, y, z, r):
    image = full_image((x, y, z), r)
    camera = renderer.camera
    ball = image.depth != renderer.background.depth
    points = camera.rays()[ball] * image.depth[ball][:, None] @ camera.rotation.T + camera.position
    assert np.abs(np.linalg.norm(points - [x, y, z], axis=1) - r).max() < 2e-5
    # Seen are about as many pixels as the silhouette's solid angle says.
    distance = np.linalg.norm(camera.position - [x, y, z])
    rays = camera.rays()
    to_center = camera.to_optical([x, y, z]) / distance
    angle = np.arccos(np.clip(rays @ to_center / np.linalg.norm(rays, axis=-1), -1, 1))
    inside = angle < np.arcsin(r / distance)
    walls_off = (np.array([x, y]) + r < 1.0).all() and z > r
    if walls_off:
        assert np.array_equal(ball, inside) or (ball != inside).sum() <= 4


def test_the_nearest_point_has_depth_center_minus_radius(renderer, full_image):
    camera = renderer.camera
    center = camera.position + camera.rotation[:, 2] * 1.5
    image = full_image(center, 0.07)
    middle = image.depth[camera.height // 2, camera.width // 2]
    assert middle == pytest.approx(1.43, abs=1e-4)


def test_a_ball_outside_the_view_leaves_the_background(renderer, full_image):
    image = full_image((-0.5, 5.0, 0.5), 0.07)
    assert np.array_equal(image.depth, renderer.background.depth)


def test_a_ball_behind_the_camera_is_refused(renderer):
    with pytest.raises(InvalidInputError, match="before the camera"):
        renderer.render_balls([(-2.0, -2.0, 2.0)], [0.07])


def test_a_ball_before_another_hides_it(renderer):
    camera = renderer.camera
    ahead, sideways = camera.rotation[:, 2], camera.rotation[:, 0]
    near, far = camera.position + 1.0 * ahead, camera.position + 1.4 * ahead
    aside = camera.position + 1.2 * ahead + 0.4 * sideways
    radii = [0.05, 0.07, 0.03]
    rendered = renderer.render_balls([near, far, aside], radii)
    counts = [int((rendered.owner == k).sum()) for k in range(3)]
    alone = [
        int((renderer.render_balls([center], [radius]).owner == 0).sum())
        for center, radius in zip([near, far, aside], radii, strict=True)
    ]
    # The disc of radius f r / z: 5 cm at 1 m and 7 cm at 1.4 m look alike.
    assert counts[0] == alone[0]
    assert counts[1] < 0.1 * alone[1]
    assert counts[2] == alone[2] > 0
    nothing = renderer.render_balls([], [])
    assert nothing.region.empty


def test_a_swept_ball_covers_what_it_covers_for_half_of_the_exposure(renderer):
    """On the middle line of its way a pixel sees a ball of radius r while |x - s t| < r: for half
    of the exposure where |x| < r, as long as s < 4 r; so it is as long as at rest, and narrower."""
    camera = renderer.camera
    center = camera.position + 1.2 * camera.rotation[:, 2]
    radius, sweep = 0.05, 0.1 * camera.rotation[:, 0]
    at_rest = renderer.render_balls([center], [radius]).owner == 0
    swept = renderer.render_balls([center], [radius], [sweep]).owner == 0
    still = renderer.render_balls([center], [radius], [np.zeros(3)])
    assert np.array_equal(still.owner == 0, at_rest)
    length, width = np.ptp(np.argwhere(swept), axis=0)[::-1]
    pixels = 2.0 * camera.focal_length * radius / 1.2
    assert length == pytest.approx(pixels, abs=3.0)
    # |x - s t| < w at the height h, w² = r² - h²: for less than half where 2 w < s / 2.
    assert width == pytest.approx(pixels * np.sqrt(1.0 - (0.1 / 4 / radius) ** 2), abs=3.0)


def test_a_static_box_is_part_of_the_background(renderer):
    camera = renderer.camera
    planes = corner_environment().planes
    # Its front face is square to the optical axis, 1 m ahead.
    orientation = Rotation.from_matrix(camera.rotation).as_quat()
    center = camera.position + 1.1 * camera.rotation[:, 2]
    box = StaticBox("box", "wood", center, orientation, (0.3, 0.4, 0.2))
    depth = DepthRenderer(camera, Environment(planes, [box])).background.depth
    front = np.abs(depth - 1.0) < 1e-5
    # f times 0.3 m and 0.4 m, at 1 m.
    rows, columns = np.flatnonzero(front.any(axis=1)), np.flatnonzero(front.any(axis=0))
    assert np.ptp(columns) + 1 == pytest.approx(0.3 * camera.focal_length, abs=1.1)
    assert np.ptp(rows) + 1 == pytest.approx(0.4 * camera.focal_length, abs=1.1)
    assert front.sum() == pytest.approx((np.ptp(rows) + 1) * (np.ptp(columns) + 1), rel=0.01)
