"""Kernels about spheres say what arrays do: which rays pass it, and outlines."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import distance_transform_edt

from intuitive_physics_perception.detection.sphere_fit import passes_by
from intuitive_physics_perception.detection.sphere_hypotheses import depths_of
from intuitive_physics_perception.detection.spheres import roundness_of
from intuitive_physics_perception.detection.swept_sphere import passing_way


@given(st.integers(0, 10_000), st.floats(0.02, 1.5))
def test_a_ray_passes_by_only_what_it_misses(seed, reach) -> None:
    """Some parts in 100,000 beside the reach either is right; NaN, and what lies behind, pass."""
    rng = np.random.default_rng(seed)
    center = rng.normal(size=3) + [0.0, 0.0, 1.0]
    points = (rng.normal(size=(60, 3)) * 0.5 + center).astype(np.float32)
    points[0] = np.nan
    rays = points.astype(np.float64)
    passed = [passes_by.py_func(*point, *center, reach) for point in points]
    misses = passing_way(rays, center, np.zeros(3))
    ahead = rays @ center > 0.0
    assert not (passed & ahead & (misses < reach)).any()
    assert np.all(passed | ~(misses > 1.001 * reach))
    assert np.all(passed | ahead)


@given(st.integers(0, 10_000), st.integers(1, 40))
def test_roundness_is_that_of_the_second_moments(seed, width) -> None:
    rng = np.random.default_rng(seed)
    parts = [np.flatnonzero(rng.random(30 * width) < 0.3) for _ in range(3)]
    starts = np.cumsum([0, *map(len, parts)])
    found = roundness_of(np.concatenate(parts), starts, width)
    for part, value in zip(parts, found, strict=True):
        if len(part) > 1:
            moments = np.cov(np.divmod(part, width), bias=True)
            largest = max(np.linalg.eigvalsh(moments)[-1], 1e-9)
            assert value == pytest.approx(len(part) / (4.0 * np.pi * largest))


@given(st.integers(0, 10_000))
def test_rays_pass_the_nearest_place_on_a_way(seed) -> None:
    """Of many places along the way, none is nearer to the ray, and one is about as near."""
    rng = np.random.default_rng(seed)
    place, way = np.array([0.0, 0.0, 2.0]) + rng.normal(0.0, 0.2, 3), rng.normal(0.0, 0.2, 3)
    points = rng.normal(0.0, 0.5, (20, 3)) + place
    rays = points / np.linalg.norm(points, axis=1)[:, None]
    places = place + np.linspace(-0.5, 0.5, 2001)[:, None] * way
    off = places[:, None] - np.einsum("pi,ni->pn", places, rays)[..., None] * rays
    nearest = np.linalg.norm(off, axis=2).min(axis=0)
    passed = passing_way(points, place, way)
    assert np.all(passed <= nearest + 1e-9)
    assert passed == pytest.approx(nearest, abs=1e-3)


@given(st.integers(0, 10_000), st.integers(3, 40), st.integers(3, 40), st.floats(0.0, 1.0))
def test_depths_are_distances_to_the_nearest_pixel_outside(seed, height, width, filled) -> None:
    inside = np.zeros((height, width), dtype=bool)
    inside[1:-1, 1:-1] = np.random.default_rng(seed).random((height - 2, width - 2)) < filled
    rows, columns = np.nonzero(inside)
    assert np.array_equal(
        depths_of(inside, rows, columns), distance_transform_edt(inside)[rows, columns]
    )
