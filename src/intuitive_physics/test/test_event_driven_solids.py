"""One sphere among bounded planes and static boxes: faces, edges and corners."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from intuitive_physics.geometry.rotations import rotation_matrix
from intuitive_physics.scene import Plane
from intuitive_physics.shapes import Sphere

from .laws_scenes import EVENT_DRIVEN, UPRIGHT, Body, G, coefficients, make_scene

R = 0.05
FLOOR = Plane("floor", "ground", (0, 0, 1), 0.0)
# Impacts and flights are closed forms, so only rounding is left:
EXACT = 1e-9
COMMON = coefficients(0.4, mu_s=0.5, e=0.5)
"""θ_s where its values hardly matter."""


def table(height=0.8, half=0.5):
    """A square table top, its edges at ±half in x and y."""
    corners = [(-half, -half), (half, -half), (half, half), (-half, half)]
    return Plane("table", "ground", (0, 0, 1), height, [(*corner, height) for corner in corners])


def box(center=(0.0, 0.0, 0.4), edges=(1.0, 1.0, 0.8), orientation=UPRIGHT):
    return center, edges, orientation


def one_ball(solids, position, velocity=(0, 0, 0), spin=(0, 0, 0), gravity=(0, 0, -G)):
    planes = [solid for solid in solids if isinstance(solid, Plane)]
    boxes = [solid for solid in solids if not isinstance(solid, Plane)]
    ball = Body(Sphere(R), position, UPRIGHT, velocity, spin)
    return make_scene(ball, planes=planes, boxes=boxes, gravity=gravity)


@pytest.mark.parametrize("top", [table(), box()], ids=["sheet", "box"])
@pytest.mark.parametrize("v", [0.75, 1.5, 4.0])
def test_ball_rolls_off_a_table(top, v):
    # Where v² > g r nothing holds the ball on the edge: it flies v sqrt(2 h / g) from there, and
    # lands at floor + r. On the floor it keeps v, being a ball that rolls.
    assert v**2 > G * R
    fall = np.sqrt(2 * 0.8 / G)
    leaves = 0.25 / v
    scene = one_ball([FLOOR, top], (0.25, 0, 0.8 + R), (v, 0, 0), (0, v / R, 0))
    theta = coefficients(0.8, mu_s=0.9)
    times = np.array([leaves, leaves + 0.5 * fall, leaves + fall, leaves + fall + 1.0])
    path = EVENT_DRIVEN.path(scene, theta, times)[0]
    landing = 0.5 + v * fall
    along = [0.5, 0.5 + v * fall / 2, landing, landing + v]
    np.testing.assert_allclose(path[:, 0], along, atol=1e-8)
    # On the way it is at h - g t²/2 over the floor.
    np.testing.assert_allclose(path[:, 2] - R, [0.8, 0.6, 0.0, 0.0], atol=1e-8)


@pytest.mark.parametrize("top", [table(), box()], ids=["sheet", "box"])
@pytest.mark.parametrize("v", [0.02, 0.2, 0.5])
def test_slow_ball_goes_round_the_edge(top, v):
    # A ball that rolls round an edge has 7/10 v² + g r cos θ constant and leaves where
    # v² = g r cos θ: cos θ = (10 + 7 v0² / (g r)) / 17, from (sin θ, cos θ) r beside the edge with
    # v along (cos θ, -sin θ). So much friction keeps it from slipping until then.
    cosine = (10 + 7 * v**2 / (G * R)) / 17
    sine = np.sqrt(1 - cosine**2)
    speed = np.sqrt(G * R * cosine)
    scene = one_ball([FLOOR, top], (0.499, 0, 0.8 + R), (v, 0, 0), (0, v / R, 0))
    theta = coefficients(1000.0)
    path = EVENT_DRIVEN.path(scene, theta, np.arange(1, 20001) * 1e-4)[0]
    last = np.flatnonzero(path[:, 2] > R + 1e-2)[-1]
    velocity = (path[last] - path[last - 100]) / 1e-2
    # Pieces of 4 mrad are good to 1e-5, but for the last, in which what presses is taken as linear.
    assert velocity[0] == pytest.approx(speed * cosine, rel=2e-4)
    assert velocity[1] == pytest.approx(0.0, abs=1e-9)
    drop = 0.8 + R * cosine - 0.5 * (path[last] + path[last - 100])[2]
    # The middle of the last 10 ms is g (5 ms)² / 2 below the middle of their chord.
    fall = drop - 0.5 * G * 5e-3**2
    assert velocity[2] == pytest.approx(-np.sqrt((speed * sine) ** 2 + 2 * G * fall), rel=2e-4)


def test_ball_rests_on_a_box():
    scene = one_ball([FLOOR, box()], (0.1, 0.2, 1.2))
    path = EVENT_DRIVEN.path(scene, coefficients(0.4, mu_s=0.5, e=0.6), [5.0, 10.0])[0]
    np.testing.assert_allclose(path, [(0.1, 0.2, 0.8 + R)] * 2, atol=EXACT)


def test_ball_falls_past_the_table_onto_the_floor():
    scene = one_ball([FLOOR, table()], (0.5 + R + 1e-3, 0, 1.5))
    path = EVENT_DRIVEN.path(scene, coefficients(0.4, mu_s=0.5), [5.0])[0, 0]
    np.testing.assert_allclose(path, (0.5 + R + 1e-3, 0, R), atol=EXACT)


def test_what_is_behind_a_sheet_passes():
    # Thrown up from beneath, a ball goes through a one-sided sheet and lands on it coming down.
    scene = one_ball([FLOOR, table()], (0, 0, 0.3), (0, 0, 5.0))
    theta = coefficients(0.4, mu_s=0.5)
    up = np.linspace(0.01, 0.5, 20)
    path = EVENT_DRIVEN.path(scene, theta, [*up, 5.0])[0]
    np.testing.assert_allclose(path[:-1, 2], 0.3 + 5.0 * up - 0.5 * G * up**2, atol=EXACT)
    assert path[-1, 2] == pytest.approx(0.8 + R, abs=EXACT)
    # One that never comes out in front falls back; one under the table rolls freely.
    low = one_ball([FLOOR, table()], (0, 0, 0.3), (0, 0, np.sqrt(2 * G * 0.48)))
    assert EVENT_DRIVEN.path(low, theta, [5.0])[0, 0, 2] == pytest.approx(R, abs=EXACT)
    under = one_ball([FLOOR, table()], (-0.7, 0, R), (1, 0, 0), (0, 1 / R, 0))
    assert EVENT_DRIVEN.path(under, theta, [1.4])[0, 0, 0] == pytest.approx(0.7, abs=EXACT)


def directions(scale):
    return st.tuples(*[st.floats(-scale, scale)] * 3)


@given(
    corner=st.tuples(*[st.sampled_from([-1, 0, 1])] * 3).filter(any),
    spread=directions(0.45),
    aim=directions(0.3),
    speed=st.floats(0.5, 10.0),
    e=st.floats(0.1, 1.0),
    turn=directions(1.0),
)
@settings(max_examples=300)
def test_reflection_at_faces_edges_and_corners(corner, spread, aim, speed, e, turn):
    # Without gravity and friction: v' = v - (1 + e) (v·n) n, n from the nearest point of the box to
    # the centre. `corner` has a zero for each axis along which the hit is inside the box.
    half = np.array([0.3, 0.4, 0.2])
    corner = np.array(corner)
    quaternion = np.array([*turn, 1.0]) / np.linalg.norm([*turn, 1.0])
    to_world = rotation_matrix(quaternion)
    point = np.where(corner == 0, spread, corner) * half
    normal = corner * (1.0 + np.abs(spread))
    normal = normal / np.linalg.norm(normal)
    velocity = -normal + np.asarray(aim)
    velocity *= speed / np.linalg.norm(velocity)
    if e * abs(velocity @ normal) < 6e-3 or velocity @ normal > -0.2 * speed:
        return
    hit = point + R * normal
    before = 0.02 / speed
    start = hit - before * velocity
    solid = box((0.1, 0.2, 0.3), 2 * half, quaternion)

    def placed(p):
        return to_world @ p + (0.1, 0.2, 0.3)

    scene = one_ball([solid], placed(start), to_world @ velocity, gravity=(0, 0, 0))
    times = [before, before + 0.01]
    path = EVENT_DRIVEN.path(scene, coefficients(0.0, e=e), times)[0]
    after = velocity - (1 + e) * (velocity @ normal) * normal
    np.testing.assert_allclose(path[0], placed(hit), atol=EXACT)
    # Rounding of the hit, 1e-15 m, over the radius turns the normal by 1e-14.
    np.testing.assert_allclose(path[1], placed(hit + 0.01 * after), atol=EXACT)


def test_ball_dropped_on_an_edge_at_45_degrees():
    # Falling with its centre r / √2 beside the edge, it meets it with n at 45° and goes off
    # sideways at the speed it came with.
    drop = 0.3
    offset = R * np.sqrt(0.5)
    scene = one_ball([box()], (0.5 + offset, 0, 0.8 + offset + drop))
    speed, t_hit = np.sqrt(2 * G * drop), np.sqrt(2 * drop / G)
    path = EVENT_DRIVEN.path(scene, coefficients(0.0, e=1.0), [t_hit, t_hit + 0.1])[0]
    truth = [
        (0.5 + offset, 0, 0.8 + offset),
        (0.5 + offset + 0.1 * speed, 0, 0.8 + offset - 0.005 * G),
    ]
    np.testing.assert_allclose(path, truth, atol=EXACT)


def test_ball_rolls_over_the_seam_of_two_tables():
    # Two sheets side by side are one table: the ball keeps its speed across the seam.
    halves = []
    for x in (-1.0, 0.0):
        corners = [(x, -1, 0.8), (x + 1, -1, 0.8), (x + 1, 1, 0.8), (x, 1, 0.8)]
        halves.append(Plane(f"from_{x}", "ground", (0, 0, 1), 0.8, corners))
    scene = one_ball(halves, (-0.3, 0, 0.8 + R), (0.4, 0.1, 0), (-0.1 / R, 0.4 / R, 0))
    path = EVENT_DRIVEN.path(scene, COMMON, [0.5, 1.0, 1.5])[0]
    np.testing.assert_allclose(path[:, 0], -0.3 + 0.4 * np.array([0.5, 1.0, 1.5]), atol=1e-6)
    np.testing.assert_allclose(path[:, 2], 0.8 + R, atol=1e-6)


def test_ball_on_a_tilted_box_rolls_down_its_face():
    # A face that slopes by β: a = 5/7 g sin β, until the contact leaves the face.
    beta = 0.2
    solid = box((0, 0, 0), (1, 1, 0.4), (0, np.sin(beta / 2), 0, np.cos(beta / 2)))
    upward = np.array([np.sin(beta), 0, np.cos(beta)])
    downhill = np.array([np.cos(beta), 0, -np.sin(beta)])
    start = (0.2 + R) * upward
    path = EVENT_DRIVEN.path(one_ball([solid], start), COMMON, [0.2, 0.6])[0]
    truth = 0.5 * 5 / 7 * G * np.sin(beta) * np.square([0.2, 0.6])
    assert truth[-1] < 0.5
    np.testing.assert_allclose((path - start) @ downhill, truth, atol=EXACT)
    np.testing.assert_allclose((path - start) @ upward, 0.0, atol=EXACT)


def test_start_a_little_inside_a_box_is_moved_out():
    # By the shortest way, here up by 1 cm.
    scene = one_ball([box()], (0, 0, 0.79 + R))
    path = EVENT_DRIVEN.path(scene, COMMON, [0.0, 1.0])[0]
    np.testing.assert_allclose(path, [(0, 0, 0.8 + R)] * 2, atol=EXACT)
