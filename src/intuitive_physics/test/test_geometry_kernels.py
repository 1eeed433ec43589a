"""Geometry for kernels against geometry for arrays, and against what defines a closest point."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba import njit

from intuitive_physics.geometry import clipping, closest_points, quaternions
from intuitive_physics.geometry.gaps import Body, gap_between, gap_to_plane
from intuitive_physics.geometry.polygons import clip_polygon
from intuitive_physics.geometry.rotations import rotate_quaternions, rotation_matrix
from intuitive_physics.scene import Plane
from intuitive_physics.shapes import Box, Capsule, Sphere

from .laws_scenes import random_quaternion

SEEDS = st.integers(0, 2**31)
UPRIGHT = np.array([0.0, 0.0, 0.0, 1.0])
ROOM = 16
RADIUS = 1e-3


def callable_from_python(kernel):
    """Give a kernel, which only kernels can call, a caller."""

    @njit
    def call(*arguments):
        return kernel(*arguments)

    return call


rotated_axes = callable_from_python(quaternions.rotated_axes)
turned_by = callable_from_python(quaternions.turned_by)
nearest_of_segments = callable_from_python(closest_points.nearest_of_segments)
segment_nearest_to_box = callable_from_python(closest_points.segment_nearest_to_box)
point_from_box = callable_from_python(closest_points.point_from_box)
nearest_on_polygon = callable_from_python(closest_points.nearest_on_polygon)
part_over_polygon = callable_from_python(closest_points.part_over_polygon)
clip = callable_from_python(clipping.clip)
clip_by_edges = callable_from_python(clipping.clip_by_edges)


def random_polygon(rng):
    """Corners (n, 3) of a convex polygon in a plane at an angle, and the plane's normal."""
    angles = np.sort(rng.uniform(0.0, 2.0 * np.pi, rng.integers(3, 9)))
    x, y, n = rotation_matrix(random_quaternion(rng)).T
    corners = np.cos(angles)[:, None] * x + np.sin(angles)[:, None] * y + rng.normal(size=3)
    return corners, n


def orientation_along(direction):
    """Orientation whose z axis points along a direction."""
    z = np.array([0.0, 0.0, 1.0])
    axis = np.cross(z, direction)
    angle = np.arctan2(np.linalg.norm(axis), direction[2])
    return rotate_quaternions(UPRIGHT, axis / np.linalg.norm(axis) * angle)


def thin_capsule(start, span):
    length = float(np.linalg.norm(span))
    return Body(Capsule(RADIUS, length), start + 0.5 * span, orientation_along(span))


@given(SEEDS)
def test_axes_are_the_columns_of_the_matrix(seed):
    q = random_quaternion(np.random.default_rng(seed))
    matrix = rotation_matrix(q)
    np.testing.assert_allclose(np.transpose(rotated_axes(tuple(q))), matrix, atol=1e-15)
    np.testing.assert_allclose(matrix @ matrix.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(matrix) == pytest.approx(1.0)


def test_matrices_of_many_are_those_of_each():
    rng = np.random.default_rng(0)
    q = np.array([[random_quaternion(rng) for _ in range(3)] for _ in range(2)])
    each = [[rotation_matrix(one) for one in row] for row in q]
    np.testing.assert_array_equal(rotation_matrix(q), each)


@given(SEEDS, st.sampled_from([0.0, 1e-12, 1e-5, 0.1, 1.0, 3.0]))
def test_both_rotate_alike_and_as_the_matrix_does(seed, scale):
    rng = np.random.default_rng(seed)
    q, vector, point = random_quaternion(rng), scale * rng.normal(size=3), rng.normal(size=3)
    rotated = rotate_quaternions(q, vector)
    np.testing.assert_allclose(turned_by(tuple(q), tuple(vector)), rotated, atol=1e-14)
    after = rotation_matrix(rotate_quaternions(UPRIGHT, vector)) @ rotation_matrix(q)
    np.testing.assert_allclose(rotation_matrix(rotated) @ point, after @ point, atol=1e-13)


@given(SEEDS)
def test_segments_are_as_far_apart_as_thin_capsules(seed):
    rng = np.random.default_rng(seed)
    starts, spans = rng.normal(size=(2, 3)), rng.normal(size=(2, 3))
    s, t = nearest_of_segments(*(tuple(v) for v in (starts[0], spans[0], starts[1], spans[1])))
    distance = np.linalg.norm(starts[0] + s * spans[0] - starts[1] - t * spans[1])
    bodies = [thin_capsule(start, span) for start, span in zip(starts, spans, strict=True)]
    assert gap_between(*bodies) + 2.0 * RADIUS == pytest.approx(distance, abs=1e-9)


@given(SEEDS)
def test_a_segment_is_as_far_from_a_box_as_a_thin_capsule(seed):
    rng = np.random.default_rng(seed)
    start, span, half = rng.normal(size=3), rng.normal(size=3), rng.uniform(0.1, 1.0, 3)
    t = segment_nearest_to_box(tuple(start), tuple(span), tuple(half))
    distance, direction = point_from_box(tuple(start + t * span), tuple(half))
    capsule = thin_capsule(start, span)
    box = Body(Box(tuple(2.0 * half)), np.zeros(3), UPRIGHT)
    # Where the segment enters the box both searches end within 1e-7 of a squared distance.
    assert gap_between(capsule, box) + RADIUS == pytest.approx(max(distance, 0.0), abs=4e-4)
    assert np.linalg.norm(direction) == pytest.approx(1.0)


@given(SEEDS)
def test_leaving_a_box_by_the_distance_ends_on_its_surface(seed):
    rng = np.random.default_rng(seed)
    half = rng.uniform(0.1, 1.0, 3)
    point = 1.5 * half * rng.uniform(-1.0, 1.0, 3)
    distance, direction = point_from_box(tuple(point), tuple(half))
    surface = np.abs(point - distance * np.array(direction)) - half
    assert surface.max() == pytest.approx(0.0, abs=1e-12)
    assert (distance < 0.0) == (np.abs(point) < half).all()


@given(SEEDS)
def test_a_point_is_as_far_from_a_polygon_as_a_small_sphere(seed):
    rng = np.random.default_rng(seed)
    corners, n = random_polygon(rng)
    plane = Plane("p", "m", n, float(n @ corners[0]), corners)
    point = corners.mean(axis=0) + rng.uniform(0.0, 1.0) * n + rng.normal(size=3)
    point += max(0.0, 0.01 - float(plane.signed_distances(point))) * n
    boundary = np.array(plane.boundary)
    near = nearest_on_polygon(
        tuple(point), boundary.ctypes.data, len(boundary), tuple(plane.normal), plane.offset
    )
    gap = gap_to_plane(Body(Sphere(RADIUS), point, UPRIGHT), plane)
    assert gap + RADIUS == pytest.approx(float(np.linalg.norm(point - near)), abs=1e-9)


@given(SEEDS)
def test_the_part_over_a_polygon_is_where_points_are_over_it(seed):
    rng = np.random.default_rng(seed)
    corners, n = random_polygon(rng)
    start, span = corners.mean(axis=0) + rng.normal(size=3), 2.0 * rng.normal(size=3)
    low, high = part_over_polygon(
        tuple(start), tuple(span), corners.ctypes.data, len(corners), tuple(n)
    )
    inward = np.cross(n, np.roll(corners, -1, axis=0) - corners)
    for t in np.linspace(0.0, 1.0, 23):
        over = (((start + t * span - corners) * inward).sum(axis=1) >= 0.0).all()
        assert over == (low <= t <= high)


def clipped(corners, normal, limit):
    left = np.zeros((ROOM, 3))
    count = clip(corners.ctypes.data, len(corners), tuple(normal), limit, left.ctypes.data, ROOM)
    return left[:count]


@given(SEEDS)
def test_both_clip_alike(seed):
    rng = np.random.default_rng(seed)
    corners, _ = random_polygon(rng)
    normal = rng.normal(size=3)
    limit = float(normal @ corners.mean(axis=0)) + 0.3 * rng.normal()
    got, expected = clipped(corners, normal, limit), clip_polygon(corners, -normal, -limit)
    assert len(got) == len(expected)
    for corner in expected:
        assert np.linalg.norm(got - corner, axis=1).min() < 1e-9


@given(SEEDS)
def test_clipping_by_edges_is_clipping_by_each(seed):
    rng = np.random.default_rng(seed)
    boundary, n = random_polygon(rng)
    corners, _ = random_polygon(rng)
    corners += boundary.mean(axis=0) - corners.mean(axis=0)
    expected = corners
    for start, end in zip(boundary, np.roll(boundary, -1, axis=0), strict=True):
        outward = np.cross(end - start, n)
        expected = clip_polygon(expected, -outward, float(-outward @ start))
    pair = np.zeros((2, 2 * ROOM, 3))
    pair[0, : len(corners)] = corners
    first, second = (each.ctypes.data for each in pair)
    count, where = clip_by_edges(
        first, len(corners), second, 2 * ROOM, boundary.ctypes.data, len(boundary), tuple(n)
    )
    assert where in (first, second)
    got = pair[0 if where == first else 1, :count]
    assert len(got) == len(expected)
    for corner in expected:
        assert np.linalg.norm(got - corner, axis=1).min() < 1e-9


def test_what_has_no_room_is_not_written():
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    left = np.zeros((4, 3))
    count = clip(square.ctypes.data, 4, (1.0, 0.0, 0.0), 0.5, left.ctypes.data, 2)
    assert count == 2
    assert not left[2:].any()
