"""Gaps between bodies, against points tried all over their surfaces."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from intuitive_physics.geometry.gaps import Body, gap_between, gap_to_plane
from intuitive_physics.geometry.rotations import rotation_matrix
from intuitive_physics.scene import Plane
from intuitive_physics.shapes import Box, Capsule, Sphere

from .laws_scenes import random_quaternion

SHAPES = {
    "sphere": Sphere(0.1),
    "box": Box((0.2, 0.3, 0.1)),
    "capsule": Capsule(0.05, 0.3),
    "long box": Box((0.6, 0.05, 0.05)),
}
NAMES = st.sampled_from(sorted(SHAPES))
SEEDS = st.integers(0, 2**31)


def random_body(shape, rng, spread=0.4):
    orientation = random_quaternion(rng)
    return Body(shape, rng.normal(size=3) * spread, orientation)


def core(body):
    """Half extents of the box, segment or point that a body is all round about, and how far."""
    match body.shape:
        case Box():
            return np.array(body.shape.edge_lengths) / 2, 0.0
        case Capsule():
            return np.array([0, 0, body.shape.length / 2]), body.shape.radius
    return np.zeros(3), body.shape.radius


def distance(a, b):
    """Distance of two bodies by minimising over points of both cores: a convex problem."""
    (half_a, radius_a), (half_b, radius_b) = core(a), core(b)
    turn_a, turn_b = rotation_matrix(a.orientations), rotation_matrix(b.orientations)

    def apart(x):
        return a.positions + turn_a @ x[:3] - b.positions - turn_b @ x[3:]

    halves = np.concatenate([half_a, half_b])
    found = minimize(
        lambda x: apart(x) @ apart(x),
        np.zeros(6),
        jac=lambda x: 2 * np.concatenate([apart(x) @ turn_a, -apart(x) @ turn_b]),
        bounds=list(zip(-halves, halves, strict=True)),
        method="L-BFGS-B",
        options={"ftol": 1e-15, "gtol": 1e-12, "maxiter": 500},
    )
    return np.sqrt(found.fun) - radius_a - radius_b


@given(NAMES, NAMES, SEEDS)
@settings(max_examples=150)
def test_gap_is_the_distance(first, second, seed):
    rng = np.random.default_rng(seed)
    a, b = random_body(SHAPES[first], rng), random_body(SHAPES[second], rng)
    got, true = float(gap_between(a, b)), distance(a, b)
    if isinstance(a.shape, Box) and isinstance(b.shape, Box):
        # Along axes it is a lower bound, but never says "overlap" of what is apart.
        assert got <= true + 1e-6
        assert (got > 1e-6) == (true > 1e-6) or abs(true) < 1e-4
    elif true > -min(core(a)[1] + core(b)[1], 0.04):
        # The search ends within 1e-7 of a square, 3e-4 m at worst where cores meet.
        assert got == pytest.approx(true, abs=1e-5 if true > 1e-3 else 4e-4)
    else:
        assert got <= 1e-9
    assert float(gap_between(b, a)) == pytest.approx(got, abs=1e-8)


@given(NAMES, NAMES, SEEDS)
@settings(max_examples=50)
def test_many_poses_are_as_each_alone(first, second, seed):
    rng = np.random.default_rng(seed)
    ones = [random_body(SHAPES[first], rng) for _ in range(4)]
    many = Body(
        SHAPES[first],
        np.array([body.positions for body in ones]),
        np.array([body.orientations for body in ones]),
    )
    other = random_body(SHAPES[second], rng)
    alone = [float(gap_between(body, other)) for body in ones]
    np.testing.assert_allclose(gap_between(many, other), alone, atol=1e-9)


@given(NAMES, SEEDS)
def test_gap_to_a_plane_is_that_of_the_lowest_point(name, seed):
    rng = np.random.default_rng(seed)
    body = random_body(SHAPES[name], rng)
    plane = Plane("p", "m", rng.normal(size=3), rng.normal())
    half, radius = core(body)
    signs = np.array(np.meshgrid(*[(-1, 1)] * 3)).reshape(3, -1).T
    corners = body.positions + (signs * half) @ rotation_matrix(body.orientations).T
    lowest = plane.signed_distances(corners).min() - radius
    assert float(gap_to_plane(body, plane)) == pytest.approx(lowest, abs=1e-12)


TABLE = Plane("table", "wood", (0, 0, 1), 0.5, [(0, 0, 0.5), (1, 0, 0.5), (1, 1, 0.5), (0, 1, 0.5)])


@pytest.mark.parametrize(
    ("center", "gap"),
    [
        ((0.5, 0.5, 0.7), 0.1),  # above it
        ((1.3, 0.5, 0.9), 0.4),  # beyond an edge: sqrt(.3² + .4²) - .1
        ((1.3, 1.4, 0.5), 0.4),  # beside a corner
        ((1.08, 0.5, 0.51), np.hypot(0.08, 0.01) - 0.1),  # hangs on an edge
    ],
)
def test_gap_to_a_plane_with_edges(center, gap):
    body = Body(Sphere(0.1), np.array(center), np.array([0, 0, 0, 1.0]))
    assert float(gap_to_plane(body, TABLE)) == pytest.approx(gap, abs=1e-12)


@pytest.mark.parametrize("name", sorted(SHAPES))
def test_what_is_below_a_table_does_not_touch_it(name):
    body = Body(SHAPES[name], np.array([0.5, 0.5, 0.499]), np.array([0, 0, 0, 1.0]))
    assert float(gap_to_plane(body, TABLE)) > 0.001
