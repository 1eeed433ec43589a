"""Markers show bodies where and as large as they are, and distributions as Fig. 1 of the paper."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker

from intuitive_physics.geometry.rotations import rotation_matrix
from intuitive_physics.scene import Environment, Plane, SceneObject, StaticBox
from intuitive_physics.shapes import Box, Capsule, Sphere
from intuitive_physics.state import ObjectState
from intuitive_physics_ros.markers import (
    ELLIPSOIDS,
    MAX_SAMPLES,
    MOST_POINTS,
    distribution_markers,
    environment_markers,
    material_color,
    name_markers,
    object_markers,
    trajectory_marker,
)

LENGTHS = st.floats(0.01, 10.0)
DIRECTIONS = arrays(np.float64, 3, elements=st.floats(-1.0, 1.0)).filter(
    lambda v: np.linalg.norm(v) > 1e-3
)
QUARTER_TURN_ABOUT_X = (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))


def xyz(message):
    return np.array([message.x, message.y, message.z])


def z_axis(orientation):
    quaternion = (orientation.x, orientation.y, orientation.z, orientation.w)
    return rotation_matrix(quaternion)[:, 2]


@given(LENGTHS, LENGTHS)
def test_capsule_is_a_cylinder_with_two_caps(radius, length):
    thing = SceneObject("pill", "wood", Capsule(radius, length))
    state = ObjectState((1.0, 2.0, 3.0), QUARTER_TURN_ABOUT_X)
    cylinder, *caps = object_markers([thing], [state], Header(frame_id="world"))
    assert cylinder.type == Marker.CYLINDER
    np.testing.assert_allclose(xyz(cylinder.scale), [2 * radius, 2 * radius, length])
    # A quarter turn about x takes z onto -y.
    ends = sorted(cap.pose.position.y for cap in caps)
    np.testing.assert_allclose(ends, [2.0 - length / 2, 2.0 + length / 2], atol=1e-12)
    for cap in caps:
        assert cap.type == Marker.SPHERE
        np.testing.assert_allclose(xyz(cap.scale), 2 * radius)


def test_each_shape_has_its_size_and_each_marker_its_id():
    things = [
        SceneObject("ball", "rubber", Sphere(0.1)),
        SceneObject("box", "rubber", Box((1.0, 2.0, 3.0))),
        SceneObject("pill", "wood", Capsule(0.1, 1.0)),
    ]
    header = Header(frame_id="world")
    markers = object_markers(things, [ObjectState((i, 0, 0)) for i in range(3)], header)
    np.testing.assert_allclose(xyz(markers[0].scale), 0.2)
    np.testing.assert_allclose(xyz(markers[1].scale), [1.0, 2.0, 3.0])
    assert [marker.id for marker in markers] == list(range(5))
    assert all(marker.header == header for marker in markers)
    assert markers[0].color == markers[1].color != markers[2].color


def test_a_colour_that_was_seen_goes_before_that_of_the_material():
    things = [SceneObject(f"ball_{k}", "rubber", Sphere(0.1)) for k in range(2)]
    states = [ObjectState((k, 0, 0)) for k in range(2)]
    seen, unseen = object_markers(
        things, states, Header(), colors=[np.array([0.25, 0.5, 1.0]), None]
    )
    assert (seen.color.r, seen.color.g, seen.color.b, seen.color.a) == (0.25, 0.5, 1.0, 1.0)
    assert unseen.color == material_color("rubber")


@given(DIRECTIONS, st.floats(-5.0, 5.0))
def test_plane_without_edges_lies_in_the_plane(normal, offset):
    plane = Plane("wall", "brick", normal, offset)
    (marker,) = environment_markers(Environment([plane]))
    np.testing.assert_allclose(z_axis(marker.pose.orientation), plane.normal, atol=1e-4)
    assert abs(plane.signed_distances(xyz(marker.pose.position))) < 1e-9


def test_plane_that_looks_straight_down():
    (marker,) = environment_markers(Environment([Plane("ceiling", "plaster", (0, 0, -1), -3.0)]))
    np.testing.assert_allclose(z_axis(marker.pose.orientation), [0, 0, -1], atol=1e-12)
    assert marker.pose.position.z == 3.0


@given(st.integers(3, 12), LENGTHS)
def test_bounded_plane_is_covered_by_its_triangles(corners, radius):
    angles = 2 * np.pi * np.arange(corners) / corners
    boundary = radius * np.column_stack([np.cos(angles), np.sin(angles), np.zeros(corners)])
    (marker,) = environment_markers(Environment([Plane("table", "wood", (0, 0, 1), 0, boundary)]))
    a, b, c = np.array([xyz(point) for point in marker.points]).reshape(-1, 3, 3).swapaxes(0, 1)
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
    # Regular polygon: n/2 r² sin(2π/n).
    assert area == pytest.approx(corners / 2 * radius**2 * math.sin(2 * math.pi / corners))


@given(st.floats(0.1, 20.0))
def test_names_stand_above_their_objects(gravity):
    ball = SceneObject("ball", "rubber", Sphere(0.1))
    state = ObjectState((1.0, 2.0, 3.0))
    (marker,) = name_markers([ball], [state], Header(), up=(0.0, 0.0, gravity))
    assert (marker.type, marker.text) == (Marker.TEXT_VIEW_FACING, "ball")
    x, y, z = xyz(marker.pose.position)
    assert (x, y) == (1.0, 2.0)
    # The letters, whose middle this is, end above the ball.
    assert z - marker.scale.z / 2 > 3.1
    (marker,) = name_markers([ball], [state], Header(), up=np.zeros(3))
    assert np.isfinite(xyz(marker.pose.position)).all()


def test_environment_box_and_frame():
    box = StaticBox("crate", "wood", (1, 2, 3), QUARTER_TURN_ABOUT_X, (0.1, 0.2, 0.3))
    (marker,) = environment_markers(Environment(boxes=[box], frame_id="room"))
    assert marker.header.frame_id == "room"
    np.testing.assert_array_equal(xyz(marker.pose.position), [1, 2, 3])
    np.testing.assert_array_equal(xyz(marker.scale), [0.1, 0.2, 0.3])


@given(st.integers(0, 30), st.integers(1, 600))
def test_trajectories_keep_their_ends_and_the_number_of_points(n, n_times):
    paths = np.arange(n * n_times * 3, dtype=float).reshape(n, n_times, 3)
    marker = trajectory_marker(paths, Header(), ColorRGBA(a=1.0))
    assert len(marker.points) <= max(MOST_POINTS, 2 * n)
    assert len(marker.points) % 2 == 0
    if n:
        np.testing.assert_array_equal(xyz(marker.points[0]), paths[0, 0])
        np.testing.assert_array_equal(xyz(marker.points[-1]), paths[-1, -1])


def test_points_that_are_not_finite_are_not_drawn():
    paths = np.zeros((1, 4, 3))
    paths[0, 2:] = np.nan
    assert len(trajectory_marker(paths, Header(), ColorRGBA()).points) == 2


def test_color_of_a_material_stays():
    assert material_color("wood") == material_color("wood")
    assert material_color("wood") != material_color("steel")
    assert material_color("wood", alpha=0.5).a == 0.5


HEADER = Header(frame_id="lab")


def shown(covariance=None, samples=20, objects=2, times=101):
    rng = np.random.default_rng(0)
    positions = rng.normal(size=(samples, objects, times, 3))
    given = np.eye(3) * 1e-4 if covariance is None else covariance
    covariances = np.broadcast_to(given, (objects, times, 3, 3))
    names = [f"ball_{k}" for k in range(objects)]
    message = distribution_markers(HEADER, names, positions, positions.mean(axis=0), covariances)
    return message.markers


def test_earlier_markers_are_cleared_first():
    clearing, *rest = shown()
    assert clearing.action == Marker.DELETEALL
    assert all(marker.action == Marker.ADD for marker in rest)
    assert all(marker.header == HEADER for marker in rest)


def test_each_object_has_thin_samples_a_mean_and_ellipsoids():
    markers = shown(objects=3)[1:]
    by_kind = {kind: [m for m in markers if m.ns == kind] for kind in {m.ns for m in markers}}
    assert {kind: len(found) for kind, found in by_kind.items()} == {
        "samples": 3,
        "mean": 3,
        "covariance": 3 * ELLIPSOIDS,
    }
    for sample, mean in zip(by_kind["samples"], by_kind["mean"], strict=True):
        assert 0 < sample.scale.x < mean.scale.x
        assert sample.color.a < mean.color.a
    for found in by_kind.values():
        assert len({marker.id for marker in found}) == len(found)


def test_covariance_that_is_not_finite_has_no_ellipsoid():
    covariance = np.broadcast_to(np.eye(3) * 1e-4, (2, 101, 3, 3)).copy()
    covariance[1, 60:] = np.nan
    ellipsoids = [marker for marker in shown(covariance) if marker.ns == "covariance"]
    # Of the second object's eight, evenly up to point 100, the first four are before point 60.
    assert len(ellipsoids) == ELLIPSOIDS + 4
    for marker in ellipsoids:
        assert np.isfinite([marker.scale.x, marker.scale.y, marker.scale.z]).all()


def test_many_samples_are_no_load_on_rviz():
    few, many = (
        sum(len(m.points) for m in shown(samples=n, objects=1, times=501)) for n in (20, 5000)
    )
    assert many <= 2 * few
    assert MAX_SAMPLES >= 20


@given(st.integers(0, 2**31))
def test_an_ellipsoid_reaches_two_deviations_along_its_axes(seed):
    root = np.random.default_rng(seed).normal(size=(3, 3)) * 0.1 + 0.05 * np.eye(3)
    covariance = root @ root.T
    marker = next(m for m in shown(covariance) if m.ns == "covariance")
    q = marker.pose.orientation
    axes = rotation_matrix((q.x, q.y, q.z, q.w))
    size = np.array([marker.scale.x, marker.scale.y, marker.scale.z])
    # Σ = R diag((size / 4)²) R', but for variances below 0.1 mm², which would be too thin to see.
    rebuilt = axes @ np.diag((size / 4) ** 2) @ axes.T
    np.testing.assert_allclose(rebuilt, covariance, atol=1e-7 + 1e-6 * covariance.max())
    assert np.linalg.det(axes) == pytest.approx(1.0)
