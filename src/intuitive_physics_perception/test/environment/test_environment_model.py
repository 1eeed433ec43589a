"""Planes, gravity, frame and noise of analytic scenes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.ndimage import uniform_filter

from intuitive_physics_perception.environment.environment_model import (
    NoEnvironmentError,
    model_environment,
)
from intuitive_physics_perception.environment.fusion import fuse
from intuitive_physics_perception.environment.gravity import degrees_between
from intuitive_physics_perception.environment.noise import RangeNoise
from intuitive_physics_perception.environment.planes import detect_planes
from intuitive_physics_perception.input.camera import Intrinsics
from intuitive_physics_perception.input.depth import points_from_depth
from intuitive_physics_perception.settings import PerceptionSettings

SETTINGS = PerceptionSettings()


def patch(rng, normal, offset, size, count, noise=0.0):
    """Points scattered over a square of a plane."""
    normal = np.asarray(normal, float) / np.linalg.norm(normal)
    first = np.cross(normal, [1.0, 0.2, 0.1])
    first /= np.linalg.norm(first)
    second = np.cross(normal, first)
    a, b = rng.uniform(-size / 2, size / 2, (2, count))
    off = offset + noise * rng.normal(size=count)
    return off[:, None] * normal + a[:, None] * first + b[:, None] * second


def planes_in(points, rng, assumed=SETTINGS):
    return detect_planes(points, RangeNoise.from_settings(assumed), assumed, rng)


def test_the_corner_is_found_as_it_is(corner_model) -> None:
    room, model = corner_model
    planes = model.environment.planes
    assert [plane.id for plane in planes] == ["plane_0", "plane_1", "plane_2"]
    truth = [((0, 0, 1), 0.0), *room.walls]
    for plane in planes:
        errors = [degrees_between(plane.normal, normal) for normal, _ in truth]
        nearest = int(np.argmin(errors))
        assert errors[nearest] < 0.1
        assert plane.offset == pytest.approx(truth[nearest][1], abs=0.004)


def test_gravity_is_within_a_tenth_of_a_degree(corner_model) -> None:
    room, model = corner_model
    down = model.rotation.T @ model.environment.gravity
    assert np.linalg.norm(down) == pytest.approx(9.81)
    assert degrees_between(down / 9.81, room.rotation.T @ [0, 0, -1]) < 0.1


def test_the_frame_stands_below_the_camera_and_looks_ahead(corner_model) -> None:
    room, model = corner_model
    assert model.rotation @ model.rotation.T == pytest.approx(np.eye(3))
    assert np.linalg.det(model.rotation) == pytest.approx(1.0)
    # The camera stands at (0, 0, height), its optical axis has no part along y.
    assert model.to_environment(np.zeros(3)) == pytest.approx([0, 0, room.height], abs=0.002)
    ahead = model.rotation @ [0, 0, 1]
    assert ahead[1] == pytest.approx(0.0, abs=1e-9)
    assert ahead[0] > 0.0
    points = np.random.default_rng(0).normal(size=(20, 3))
    assert model.to_sensor(model.to_environment(points)) == pytest.approx(points)
    x, y, z, w = model.sensor_pose.orientation
    turned = np.array([1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)])
    assert turned == pytest.approx(model.rotation[:, 0])


def test_normals_point_to_the_camera(corner_model) -> None:
    _, model = corner_model
    camera = model.to_environment(np.zeros(3))
    assert all(plane.signed_distances(camera) > 0.0 for plane in model.environment.planes)
    assert all(plane.offset < 0.0 for plane in model.detected)


def test_hulls_lie_on_their_planes_and_turn_left(corner_model) -> None:
    _, model = corner_model
    for plane, hull in zip(model.environment.planes, model.hulls(), strict=True):
        assert np.abs(plane.signed_distances(hull)).max() < 1e-9
        sides = np.roll(hull, -1, axis=0) - hull
        turns = np.cross(sides, np.roll(sides, -1, axis=0)) @ plane.normal
        assert (turns > -1e-9).all()


def test_the_noise_is_measured(corner_model) -> None:
    room, model = corner_model
    for distance in (1.5, 2.5, 3.5):
        true = np.hypot(room.noise_constant, room.noise_quadratic * distance**2)
        assert model.noise.deviation(distance) == pytest.approx(true, rel=0.2)


def test_too_few_readings_leave_the_noise_as_it_was() -> None:
    assumed = RangeNoise.from_settings(SETTINGS)
    assert assumed.measured(np.zeros(0), np.zeros(0)) == assumed
    assert assumed.measured(np.ones(20), np.ones(20)) == assumed


@pytest.mark.parametrize("window", [1, 2, 3, 5])
@pytest.mark.parametrize("lost", [0.0, 0.3])
def test_the_correlation_of_neighbours_is_measured(rng, window, lost) -> None:
    """A mean over a window of w² readings makes each share its error with w² of them."""
    noise = RangeNoise(0.002, 0.001, 0.05, 0.0008)
    ranges = np.linspace(1.0, 4.0, 240)[:, None] + np.zeros((240, 320))

    def frame():
        white = rng.normal(size=ranges.shape)
        errors = window * uniform_filter(white, window, mode="wrap") * noise.deviation(ranges)
        seen = rng.random(ranges.shape) >= lost
        return np.where(seen, ranges + errors, np.nan)

    before, after = frame(), frame()
    after[50:80, 60:90] = 0.5
    assert noise.with_correlation(before, after).correlated == pytest.approx(window**2, rel=0.15)


def test_frames_that_cannot_be_compared_leave_the_correlation_as_it_was(rng) -> None:
    noise = RangeNoise(0.002, 0.001, 0.05, 0.0008, 2.0)
    still = np.full((240, 320), 2.0)
    cloud = np.full((1, 80000), 2.0)
    for before, after in [
        (still, still),
        (still, still[:120]),
        (cloud, cloud + 0.001 * rng.normal(size=cloud.shape)),
        (still, np.full_like(still, np.nan)),
        (still, still + 1.0),
    ]:
        assert noise.with_correlation(before, after) == noise


@pytest.mark.parametrize("window", [1, 3, 5])
def test_one_frame_of_a_moving_camera_shows_the_correlation_on_its_planes(
    make_room, window
) -> None:
    """Errors that w² readings share have a factor of w², less what the border of a cell of 8 × 8
    readings cuts off."""
    room = make_room()
    depth, _ = room.true_depth()
    lengths = np.linalg.norm(room.rays, axis=-1)
    white = uniform_filter(room.rng.normal(size=depth.shape), window, mode="wrap")
    deviation = np.hypot(room.noise_constant, room.noise_quadratic * (depth * lengths) ** 2)
    read = depth + window * white * deviation / lengths
    rays = Intrinsics(room.width, room.height_pixels, room.matrix).rays()
    frame = (rays * read[..., None]).astype(np.float32)
    noise = model_environment([frame], SETTINGS, np.random.default_rng(0)).noise
    assert 0.5 * window**2 < noise.correlated < 1.5 * window**2


def test_a_camera_looking_straight_down_takes_its_own_x_axis(make_room) -> None:
    room = make_room(tilt=90.0, walls=())
    model = model_environment([room.points()], SETTINGS, np.random.default_rng(0))
    assert model.rotation @ [1, 0, 0] == pytest.approx([1, 0, 0], abs=1e-3)


def test_what_moves_is_not_in_the_fused_frame(make_room, rng) -> None:
    room = make_room(tilt=30.0)
    frames = [room.points([((1.5, -0.8 + 0.2 * k, 0.3), 0.07)]) for k in range(8)]
    points = fuse(frames, SETTINGS, rng).astype(float)
    world = points @ room.rotation.T + room.origin
    truth = [((0, 0, 1), 0.0), *room.walls]
    distances = [np.abs(world @ np.array(normal) - offset) for normal, offset in truth]
    assert np.quantile(np.min(distances, axis=0), 0.999) < 0.03


@pytest.mark.parametrize("count", [2, 3, 8, 9])
def test_fused_readings_are_too_near_as_often_as_too_far(count, rng) -> None:
    # The mean error of n pixels, each the median of symmetric errors, has the standard deviation
    # σ / √n at most. Some pixels are not read in one frame, which makes their number odd or even.
    rays = Intrinsics(80, 60, np.array([[70.0, 0, 39.5], [0, 70.0, 29.5], [0, 0, 1]])).rays()
    depth, sigma = 2.0, 0.006
    depths = depth + sigma * rng.normal(size=(count, 60, 80))
    depths[0, ::3] = np.nan
    frames = [points_from_depth(each.astype(np.float32), rays) for each in depths]
    fused = fuse(frames, SETTINGS, rng)
    assert len(fused) == 60 * 80
    assert abs(fused[:, 2].mean() - depth) < 4.0 * sigma / np.sqrt(len(fused))


def test_a_wall_does_not_lift_the_floor_it_stands_on(rng) -> None:
    # n readings of noise σ, evenly over a square of edge a, tell a plane's distance from its centre
    # to σ / √n and each slope to σ √12 / (a √n). A strip of the wall's foot, as high as the
    # tolerance, would lift the end of the floor, and the floor's end push the wall.
    noise, edge, count = 0.015, 1.6, 12000
    across, along, up = rng.uniform(-0.5 * edge, 0.5 * edge, (3, count))
    floor = np.column_stack([across, np.full(count, 1.0), 2.0 + along])
    wall = np.column_stack([across, 0.2 + up, np.full(count, 2.8)])
    points = np.concatenate([floor, wall])
    points *= (
        1.0 + noise * rng.normal(size=(2 * count, 1)) / np.linalg.norm(points, axis=1)[:, None]
    )
    exact = replace(SETTINGS, range_noise_constant=noise, range_noise_quadratic=0.0)
    planes = planes_in(points, rng, exact)
    assert len(planes) == 2
    for normal, centre in (
        ((0.0, -1.0, 0.0), (0.0, 1.0, 2.0)),
        ((0.0, 0.0, -1.0), (0.0, 0.2, 2.8)),
    ):
        plane = planes[int(np.argmax([found.normal @ normal for found in planes]))]
        deviation = noise / np.sqrt(count)
        assert abs(plane.normal @ centre - plane.offset) < 5.0 * deviation
        slope = np.linalg.norm(np.cross(plane.normal, normal))
        assert slope < 5.0 * deviation * np.sqrt(12.0) / edge


def test_planes_come_by_support_and_coplanar_ones_are_one(rng) -> None:
    # Two parts of one table with a gap between them, and a smaller wall.
    table = patch(rng, (0, -1, -1), -1.5, 1.0, 4000, noise=0.001)
    table = table[np.abs(table[:, 0]) > 0.05]
    wall = patch(rng, (0, 0, -1), -2.5, 1.0, 1500, noise=0.001)
    planes = planes_in(np.concatenate([wall, table]), rng)
    assert len(planes) == 2
    assert planes[0].support > planes[1].support
    assert degrees_between(planes[0].normal, np.array([0, -1, -1]) / np.sqrt(2)) < 0.2
    assert planes[0].offset == pytest.approx(-1.5, abs=0.002)
    assert planes[1].offset == pytest.approx(-2.5, abs=0.002)


def test_a_hint_chooses_the_support(rng) -> None:
    wall = patch(rng, (0, 0, -1), -2.0, 2.0, 4000)
    floor = patch(rng, (0, -1, 0), -1.0, 2.0, 2000) + [0, 0, 2.0]
    frame = np.concatenate([wall, floor]).astype(np.float32)[None]
    without = model_environment([frame], SETTINGS, rng)
    assert without.detected[0].normal == pytest.approx([0, 0, -1], abs=0.01)
    hinted = model_environment([frame], replace(SETTINGS, up_hint=(0.1, -1.0, 0.0)), rng)
    assert hinted.detected[0].normal == pytest.approx([0, -1, 0], abs=0.01)
    assert hinted.environment.planes[0].id == "plane_0"
    with pytest.raises(NoEnvironmentError, match="faces up,"):
        model_environment([frame], replace(SETTINGS, up_hint=(1.0, 0.0, 0.0)), rng)


def test_a_scene_without_planes_is_refused(rng) -> None:
    cloud = rng.normal(size=(1, 3000, 3)).astype(np.float32) * 2.0
    with pytest.raises(NoEnvironmentError, match="no plane holds"):
        model_environment([cloud], replace(SETTINGS, plane_min_fraction=0.2), rng)
    with pytest.raises(NoEnvironmentError, match="expected at least 50"):
        model_environment([np.full((4, 4, 3), np.nan, np.float32)], SETTINGS, rng)


@pytest.mark.parametrize("seed", range(4))
def test_a_plane_that_touches_a_ball_elsewhere_is_none_there(seed) -> None:
    """The front of a board, 40 cm wide, lies 4 mm behind the nearest point of a ball beside it."""
    rng = np.random.default_rng(seed)
    radius, front = 0.05, 0.5
    board = patch(rng, [0.0, 0.0, -1.0], -front, 0.4, 6000, noise=0.001) + [0.35, 0.0, 0.0]
    center = np.array([-0.2, 0.0, front - 0.004 + radius])
    cap = rng.normal(size=(40000, 3))
    cap = center + radius * cap / np.linalg.norm(cap, axis=1, keepdims=True)
    cap = cap[np.einsum("ni,ni->n", cap - center, cap) < 0.0][:4000]
    points = np.concatenate([board, cap + 0.001 * rng.normal(size=cap.shape)])
    planes = planes_in(points, rng)
    assert any(plane.covers(board).mean() > 0.9 for plane in planes)
    assert not any(plane.covers(cap).any() for plane in planes)


TRUE_UP = np.array([0.0, -1.0, -0.4]) / np.linalg.norm([0.0, -1.0, -0.4])
"""In the sensor's frame: a camera that looks 22° down."""


def ramp(rng, degrees: float):
    """A cloud of a ramp that rises by an angle before the camera, and its normal."""
    angle = np.radians(degrees)
    across = np.array([1.0, 0.0, 0.0])
    # Turned about the camera's x axis.
    normal = TRUE_UP * np.cos(angle) + np.cross(across, TRUE_UP) * np.sin(angle)
    cloud = patch(rng, normal, -1.0, 1.5, 4000, noise=0.001) + [0.0, 0.3, 1.2]
    return cloud.astype(np.float32)[None], normal


@pytest.mark.parametrize("source", ["up_hint", "imu"])
def test_gravity_that_is_given_need_not_be_along_the_normal(rng, source) -> None:
    cloud, normal = ramp(rng, 12.0)
    given = replace(SETTINGS, gravity_source=source, up_hint=tuple(TRUE_UP))
    model = model_environment([cloud], given, rng, TRUE_UP if source == "imu" else None)
    assert model.rotation @ TRUE_UP == pytest.approx([0, 0, 1], abs=1e-9)
    assert model.environment.gravity == pytest.approx([0, 0, -9.81])
    support = model.environment.planes[0]
    assert degrees_between(support.normal, [0, 0, 1]) == pytest.approx(12.0, abs=0.2)
    assert degrees_between(support.normal, model.rotation @ normal) < 0.2
    # The origin lies on the support, straight below the camera.
    assert support.signed_distances(np.zeros(3)) == pytest.approx(0.0, abs=1e-9)
    camera = model.to_environment(np.zeros(3))
    assert camera[:2] == pytest.approx([0.0, 0.0], abs=1e-9)
    assert camera[2] > 0.0


def test_a_hint_only_chooses_the_support(rng) -> None:
    cloud, normal = ramp(rng, 12.0)
    model = model_environment([cloud], replace(SETTINGS, up_hint=tuple(TRUE_UP)), rng)
    assert degrees_between(model.rotation.T @ [0, 0, 1], normal) < 0.2


def test_a_support_that_does_not_face_up_is_refused(rng) -> None:
    cloud, _ = ramp(rng, 40.0)
    with pytest.raises(NoEnvironmentError, match="faces up"):
        model_environment([cloud], SETTINGS, rng, TRUE_UP)


@settings(max_examples=40, deadline=None)
@given(
    st.lists(
        st.tuples(*[st.floats(width=32) | st.sampled_from([0.0, 1.0, 1e-30, 1e30])] * 3),
        max_size=120,
    ),
    st.integers(0, 100),
)
@example([(0.0, 0.0, 0.0)] * 5 + [(0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0)], 16)
@example([(0.0, 0.0, 0.0)] * 5 + [(0.0, 0.0, 2.0), (0.0, 0.0, 1.0), (0.0, 1.0, 0.0)], 16)
def test_any_cloud_gives_a_model_or_one_error(points, repeat) -> None:
    cloud = np.array(points, dtype=np.float32).reshape(1, -1, 3)
    cloud = np.tile(cloud, (1, 1 + repeat, 1))
    try:
        model = model_environment([cloud], SETTINGS, np.random.default_rng(0))
    except NoEnvironmentError:
        return
    assert np.isfinite(model.rotation).all()
    assert model.rotation @ model.rotation.T == pytest.approx(np.eye(3))
