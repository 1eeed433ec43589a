"""Draws that are conditioned on being outside of surfaces."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import ks_2samp, kstest, truncnorm

from intuitive_physics.geometry.gaps import Body, gap_between, gap_to_plane
from intuitive_physics.materials import StaticParameters
from intuitive_physics.scene import Environment, Plane, Scene, SceneObject, StaticBox
from intuitive_physics.shapes import Box, Capsule, Sphere
from intuitive_physics.state import ObjectState
from intuitive_physics_predictor.noise import StateNoise, StateSpread
from intuitive_physics_predictor.noisy_newton import PreparedScene, predict
from intuitive_physics_predictor.outside import objects_inside

THETA = StaticParameters.uniform(["ball", "floor"])
SIGMA, RADIUS, HALF = 1e-3, 0.03, 0.5
BALL = Sphere(RADIUS)
ALIKE = 1e-3
"""Probability of a test of Kolmogorov and Smirnov below which two distributions differ."""


def sheet(name, center, u, v):
    """A bounded plane about a centre with half edges u and v; its normal is along u × v."""
    center, u, v = np.asarray(center, float), np.asarray(u, float), np.asarray(v, float)
    normal = np.cross(u, v)
    normal /= np.linalg.norm(normal)
    corners = [center - u - v, center + u - v, center + u + v, center - u + v]
    return Plane(name, "floor", normal, normal @ center, corners)


TABLE = sheet("table", (0, 0, 0), (HALF, 0, 0), (0, HALF, 0))
WALL = sheet("wall", (-HALF, 0, HALF), (0, HALF, 0), (0, 0, HALF))
OTHER_WALL = sheet("other wall", (0, -HALF, HALF), (0, 0, HALF), (HALF, 0, 0))
FLOOR = Plane("floor", "floor", (0, 0, 1), 0.0)
CORNER = Environment([TABLE, WALL, OTHER_WALL])


def correlated_covariance(seed=0):
    root = np.random.default_rng(seed).normal(size=(12, 12))
    covariance = root @ root.T
    scale = SIGMA / np.sqrt(covariance[2, 2])
    return covariance * scale**2


def make_scene(environment, *objects, covariance=None):
    """A scene of (shape, position) with the same covariance each."""
    covariance = SIGMA**2 * np.eye(12) if covariance is None else covariance
    return Scene(
        environment,
        tuple(SceneObject(f"object_{k}", "ball", shape) for k, (shape, _) in enumerate(objects)),
        tuple(ObjectState(position, covariance=covariance) for _, position in objects),
    )


def draw(scene, count=4000, seed=0, size_noise=0.0):
    prepared = PreparedScene.of(scene, THETA, StateNoise())
    return prepared.sampled(count, np.random.default_rng(seed), size_noise)


def unconditioned(scene, count, seed):
    return StateSpread.of(scene.states, StateNoise()).draw(count, np.random.default_rng(seed))


def bodies(scene, states):
    return [
        Body(item.shape, states[:, k, 0:3], states[:, k, 3:7])
        for k, item in enumerate(scene.objects)
    ]


def smallest_gaps(scene, states):
    """Smallest gap (n_samples,) of any object to any surface, m."""
    boxes = [
        Body(Box(box.edge_lengths), box.center, box.orientation) for box in scene.environment.boxes
    ]
    gaps = [
        [gap_to_plane(body, plane) for plane in scene.environment.planes]
        + [gap_between(body, box) for box in boxes]
        for body in bodies(scene, states)
    ]
    return np.min(np.concatenate(gaps), axis=0)


def is_possible(scene, states):
    """Which samples (n_samples,) of balls over planes have none of them below or in another."""
    possible = np.ones(len(states), bool)
    parts = bodies(scene, states)
    for k, body in enumerate(parts):
        for plane in scene.environment.planes:
            behind = plane.signed_distances(body.positions) < 0.0
            possible &= ~(behind & plane.covers(body.positions)) & (gap_to_plane(body, plane) >= 0)
        for other in parts[:k]:
            possible &= gap_between(body, other) >= 0.0
    return possible


def assert_alike(ours, truth):
    """Check each number of the states, but for the quaternion, which balls do not need."""
    for k in range(ours.shape[1]):
        for part in (0, 1, 2, 7, 8, 9, 10, 11, 12):
            comparison = ks_2samp(ours[:, k, part], truth[:, k, part])
            assert comparison.pvalue > ALIKE, (k, part, comparison)


@pytest.mark.parametrize("plane", [FLOOR, TABLE], ids=["without edges", "bounded"])
@pytest.mark.parametrize("deviations", [-3.5, -1.0, 0.0, 1.0, 2.5])
def test_gap_has_the_truncated_normal_distribution(plane, deviations):
    scene = make_scene(Environment([plane]), (BALL, (0, 0, RADIUS + deviations * SIGMA)))
    states = draw(scene).states[:, 0]
    gaps = (states[:, 2] - RADIUS) / SIGMA
    assert gaps.min() >= 0.0
    assert kstest(gaps, truncnorm(-deviations, np.inf, loc=deviations).cdf).pvalue > ALIKE
    # What the gap does not depend on keeps its own distribution.
    for part in (0, 1, 7, 8, 9, 10, 11, 12):
        assert kstest(states[:, part] / SIGMA, "norm").pvalue > ALIKE


def test_velocity_correlated_with_the_gap_follows_it():
    scene = make_scene(
        Environment([FLOOR]),
        (BALL, (0, 0, RADIUS - 0.5 * SIGMA)),
        covariance=correlated_covariance(),
    )
    free = unconditioned(scene, 20_000, 1)
    assert_alike(draw(scene).states, free[is_possible(scene, free)])


@pytest.mark.parametrize(
    "place",
    [
        (-HALF + RADIUS, -HALF + RADIUS, RADIUS),
        (HALF, 0.0, RADIUS - 0.5 * SIGMA),
        (HALF, 0.0, 0.5 * SIGMA),
    ],
    ids=["in a corner", "on an edge", "beside an edge"],
)
def test_corners_and_edges_cut_the_distribution_off(place):
    small = Sphere(0.1 * SIGMA) if place[2] < RADIUS - SIGMA else BALL
    scene = make_scene(CORNER, (small, place), covariance=correlated_covariance(2))
    free = unconditioned(scene, 60_000, 1)
    assert_alike(draw(scene).states, free[is_possible(scene, free)])


def test_balls_that_touch_are_drawn_apart():
    scene = make_scene(
        Environment([TABLE]), (BALL, (0, 0, RADIUS)), (BALL, (2 * RADIUS, 0, RADIUS + SIGMA))
    )
    states = draw(scene).states
    free = unconditioned(scene, 30_000, 1)
    assert is_possible(scene, states).all()
    assert_alike(states, free[is_possible(scene, free)])


@pytest.mark.parametrize(
    ("shape", "height"),
    [(BALL, RADIUS), (Box((0.1, 0.06, 0.04)), 0.02), (Capsule(0.02, 0.1), 0.07)],
    ids=["ball", "box", "capsule"],
)
@pytest.mark.parametrize("below", [0.0, 2.0, 6.0, 18.0], ids=lambda n: f"{n:g} deviations below")
def test_no_sample_is_inside(shape, height, below):
    environment = Environment(
        [TABLE, WALL], [StaticBox("box", "floor", (0, 0.2, 0.1), (0, 0, 0, 1), (1, 0.2, 0.2))]
    )
    for place in ((0, 0, height), (0, 0.2, 0.2 + height), (-HALF + 0.05, -0.2, height)):
        lower = np.array(place) - (0, 0, below * SIGMA)
        scene = make_scene(environment, (shape, lower))
        worlds = draw(scene, 500)
        assert smallest_gaps(scene, worlds.states).min() > -2e-9
        assert (worlds.states[:, 0, 2] > 0).all()
        assert not objects_inside(worlds, worlds.states[0]).any()


def test_mean_far_inside_begins_at_the_surface():
    for deviation in (SIGMA, 1e-7, 0.0):
        scene = make_scene(
            CORNER, (BALL, (-HALF, 0, 0.3 * RADIUS)), covariance=deviation**2 * np.eye(12)
        )
        states = draw(scene, 200).states[:, 0]
        for gaps in (states[:, 2] - RADIUS, states[:, 0] + HALF - RADIUS):
            assert (gaps >= -1e-9).all()
            assert np.mean(gaps) <= deviation + 1e-9


def test_no_room_ends_too():
    # Two walls nearer to each other than the ball is thick, on a table: nothing fits.
    facing = sheet("facing wall", (-HALF + RADIUS, 0, HALF), (0, 0, HALF), (0, HALF, 0))
    scene = make_scene(
        Environment([TABLE, WALL, facing]),
        (BALL, (-HALF + 0.5 * RADIUS, 0, RADIUS)),
        (BALL, (-HALF + 0.5 * RADIUS, 0, RADIUS)),
    )
    states = draw(scene, 50).states
    assert np.isfinite(states).all()
    assert np.abs(states[..., 0:3]).max() < 2 * HALF


@pytest.mark.parametrize("height", [0.2, -0.2], ids=["over the table", "under the table"])
def test_far_from_surfaces_draws_are_those_without_any(height):
    scene = make_scene(CORNER, (BALL, (0, 0, height)), (Capsule(0.02, 0.1), (0.2, 0, height)))
    np.testing.assert_array_equal(draw(scene, 500).states, unconditioned(scene, 500, 0))


def test_surfaces_change_nothing_else_that_is_drawn():
    # Draws that are outside at once stay, and the generator goes on as without surfaces.
    near, far = (
        make_scene(CORNER, (BALL, (0, 0, height)), (BALL, (0.2, 0, height)))
        for height in (RADIUS, 0.2)
    )
    worlds, free = (draw(scene, 200, size_noise=0.01) for scene in (near, far))
    np.testing.assert_array_equal(worlds.dimensions, free.dimensions)
    shifted = free.states - (0, 0, 0.2 - RADIUS, *[0] * 10)
    kept = shifted[..., 2] >= free.dimensions[..., 0] + 1e-9
    assert 0.3 < kept.mean() < 0.7
    np.testing.assert_allclose(worlds.states[kept], shifted[kept], atol=1e-12)
    assert (worlds.states[..., 2] - worlds.dimensions[..., 0]).min() > -2e-9


def test_same_seed_same_samples_one_by_one():
    scene = make_scene(CORNER, (BALL, (-HALF + RADIUS, 0, RADIUS)), (BALL, (0.2, 0, RADIUS)))
    first = draw(scene, 50, seed=3).states
    np.testing.assert_array_equal(first, draw(scene, 50, seed=3).states)
    assert (first != draw(scene, 50, seed=4).states).any()
    assert len(np.unique(first[:, 0, 2])) == 50


def test_a_resting_ball_stays_on_the_table():
    scene = make_scene(CORNER, (BALL, (-HALF + RADIUS, 0.1, RADIUS)), (BALL, (0.2, 0, RADIUS)))
    positions = predict(
        scene, THETA, np.linspace(0, 2, 21), rng=np.random.default_rng(0), sample_count=500
    ).positions
    assert positions[..., 2].min() > 0.98 * RADIUS


def test_objects_inside_are_found():
    scene = make_scene(CORNER, (BALL, (0, 0, RADIUS)), (BALL, (0.2, 0, RADIUS)))
    prepared = PreparedScene.of(scene, THETA, StateNoise())
    states = unconditioned(scene, 400, 0)
    states[0, 1, 2] = -0.01
    worlds = prepared.world.taken(np.zeros(400, np.int64), states=states)
    below = states[..., 2] < RADIUS - 1e-9
    assert below.any()
    np.testing.assert_array_equal(objects_inside(worlds, prepared.spread.means), below)
