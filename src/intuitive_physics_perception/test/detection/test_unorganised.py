"""Clouds without pixels are treated as images are."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from intuitive_physics_perception.detection.cluster_view import readings_in_cone
from intuitive_physics_perception.detection.foreground import (
    CELLS_PER_GAP,
    LINES_APART,
    ForegroundFinder,
    neighbour_labels,
)
from intuitive_physics_perception.detection.spheres import SphereFinder
from intuitive_physics_perception.environment.noise import RangeNoise
from intuitive_physics_perception.environment.range_cloud import angle_between_lines
from intuitive_physics_perception.environment.ray_planes import RayPlanes
from intuitive_physics_perception.settings import PerceptionSettings

SETTINGS = PerceptionSettings()


@given(st.integers(0, 10_000), st.floats(0.3, 6.0))
def test_what_lies_before_planes_is_what_no_pixel_has_behind_its_free_range(
    corner_model, seed, scale
) -> None:
    """Random readings in all directions, and one in ten of them missing."""
    model = corner_model[1]
    rng = np.random.default_rng(seed)
    points = (rng.normal(size=(400, 3)) * scale * [0.5, 0.4, 1.0]).astype(np.float32)
    points[rng.random(400) < 0.1] = np.nan
    clusters = ForegroundFinder(model, SETTINGS).find(points[None])
    read = np.flatnonzero(np.isfinite(points[:, 2]))
    ranges = np.linalg.norm(points[read].astype(np.float64), axis=1)
    in_range = (ranges >= SETTINGS.min_range) & (ranges <= SETTINGS.max_range)
    planes = RayPlanes(model.detected, model.noise, SETTINGS)
    free = planes.free_ranges(points[read])
    assert clusters.readings == in_range.sum()
    # Single precision decides otherwise within a part in 100,000 of a metre, or at an outline.
    unsure = np.abs(ranges - free) < 1e-4
    expected = int((in_range & (ranges < free)).sum())
    assert abs(clusters.foreground - expected) <= int(unsure.sum()) + 1


@pytest.mark.parametrize(("window", "expected"), [(1, 1.0), (2, 4.0), (3, 9.0)])
def test_the_correlation_of_errors_is_measured_on_planes(window, expected, rng) -> None:
    """Means over windows of w × w have the variance 1 / w², their mean in a cell that of all: a
    factor of w², less what a cell's border cuts off.

    3600 / 64 cells, medians of squares: one standard deviation is a fifth.
    """
    side, spacing = 120, 1.0 / 525.0
    v, u = np.mgrid[:side, :side] * spacing
    points = 2.0 * np.dstack([u - u.mean(), v - v.mean(), np.ones_like(u)]).reshape(-1, 3)
    white = rng.normal(size=(side + window, side + window))
    views = np.lib.stride_tricks.sliding_window_view(white, (window, window))
    errors = views.mean(axis=(2, 3))[:side, :side].ravel() * window
    order = rng.permutation(side * side)
    noise = RangeNoise(0.002, 0.0015, 0.05, 0.0008, 2.0)
    measured = noise.with_correlation_on_surfaces(points[order], errors[order], spacing)
    assert 0.5 * expected < measured.correlated < 1.5 * expected
    few = noise.with_correlation_on_surfaces(points[:40], errors[:40], spacing)
    assert few.correlated == 2.0


@given(st.integers(0, 10_000), st.floats(0.01, 1.5))
def test_a_cone_holds_what_is_near_its_axis(seed, angle) -> None:
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(300, 3)).astype(np.float32)
    points[::7] = np.nan
    axis = rng.normal(size=3)
    axis = (axis / np.linalg.norm(axis)).astype(np.float32)
    indices = readings_in_cone(points, axis, np.float32(np.cos(angle) ** 2))
    cosines = points @ axis / np.linalg.norm(points, axis=1)
    sure = np.abs(cosines - np.cos(angle)) > 1e-5
    inside = np.zeros(300, dtype=bool)
    inside[indices] = True
    with np.errstate(invalid="ignore"):
        assert np.array_equal(inside[sure], (cosines > np.cos(angle))[sure])


def test_a_shuffled_cloud_has_the_ball_of_its_image(corner_model) -> None:
    room, model = corner_model
    place, radius = np.array([1.4, 0.1, 0.3]), 0.07
    image = room.points([(place, radius)])
    cloud = np.random.default_rng(0).permutation(image.reshape(-1, 3))[None]
    spheres = []
    for points in (image, cloud):
        clusters = ForegroundFinder(model, SETTINGS).find(points)
        finder = SphereFinder(model, SETTINGS, np.random.default_rng(1))
        ((sphere,),) = [part.spheres for part in finder.find(points, clusters) if part.spheres]
        assert np.linalg.norm(sphere.center - room.to_camera(place)) < 0.003
        assert sphere.radius == pytest.approx(radius, abs=0.002)
        spheres.append(sphere)
    assert clusters.foreground == pytest.approx(spheres[0].points, rel=0.3)


def lines_on_a_sphere(line_gap: float) -> np.ndarray:
    """Readings (n, 3) of a ball of 0.3 m at 2.2 m by a scanner with lines some degrees apart."""
    center, radius = np.array([2.2, 0.0, 0.0]), 0.3
    elevation = np.radians(np.arange(-15.0, 15.1, line_gap))
    azimuth = np.radians(np.arange(-15.0, 15.0, 0.2))
    e, a = (grid.ravel() for grid in np.meshgrid(elevation, azimuth))
    rays = np.column_stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    along = rays @ center
    square = along**2 - center @ center + radius**2
    near = square > 0.0
    return rays[near] * (along[near] - np.sqrt(square[near]))[:, None]


@settings(deadline=None)
@given(st.integers(1, 300), st.floats(0.04, 1.0), st.integers(0, 10_000))
def test_clusters_hang_together_by_pairs_nearer_than_the_gap(count, gap, seed) -> None:
    """As the components of the graph of all such pairs, where no cell holds two readings."""
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    logarithms = rng.uniform(-0.5, 0.5, count)
    places = np.column_stack([directions, logarithms])
    cells = np.floor(places * CELLS_PER_GAP / gap)
    _, alone = np.unique(cells, axis=0, return_index=True)
    places = places[np.sort(alone)]
    near = np.linalg.norm(places[:, None] - places, axis=2) <= gap
    _, expected = connected_components(csr_array(near))
    labels = neighbour_labels(np.exp(places[:, 3:]) * places[:, :3], gap)
    assert len({*zip(labels.tolist(), expected.tolist(), strict=True)}) == expected.max() + 1
    assert labels.max() == expected.max()


@pytest.mark.parametrize("line_gap", [1.0, 2.0, 3.0])
def test_the_lines_of_a_scanner_are_as_far_apart_as_they_are(line_gap) -> None:
    points = lines_on_a_sphere(line_gap)
    assert angle_between_lines(points) == pytest.approx(np.radians(line_gap), rel=0.02)


@pytest.mark.parametrize("line_gap", [2.0, 3.0])
def test_the_lines_on_a_ball_are_one_cluster(line_gap) -> None:
    points = lines_on_a_sphere(line_gap)
    labels = neighbour_labels(points, LINES_APART * angle_between_lines(points))
    # All but the outermost lines, whose ranges differ by more.
    assert np.bincount(labels).max() > 0.65 * len(points)
    # The gap that is usual for a camera leaves them apart.
    assert np.bincount(neighbour_labels(points, 0.03)).max() < 0.6 * len(points)
