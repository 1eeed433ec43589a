"""Kernels about spheres say what arrays do: the fit, which rays pass it, and outlines."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import distance_transform_edt

from intuitive_physics_perception.detection.sphere_fit import (
    BEHIND_SIGMAS,
    GATES,
    INLIER_SIGMAS,
    MAX_STEPS,
    RIM_SIGMAS,
    STILL,
    SURFACE_VARIANCE,
    passes_by,
    refine_sphere,
)
from intuitive_physics_perception.detection.sphere_hypotheses import depths_of
from intuitive_physics_perception.detection.spheres import roundness_of
from intuitive_physics_perception.detection.swept_sphere import passing_way

NOISE = np.array([0.002**2, 0.001**2, 0.02**2, 0.0005**2])
SMALLEST, LARGEST = 0.02, 0.2
SHARING = 3.0


def surface_equations(points, fitted, growth, gate):
    """Rows (k, 5), errors (k,), weights (k,) and squared errors (k,) of readings on the surface."""
    center, radius = fitted[:3], fitted[3]
    ranges = np.linalg.norm(points, axis=1)
    along = points @ center / ranges
    ahead, sine2 = along - ranges, np.maximum(center @ center - along**2, 0.0) / radius**2
    variance = np.minimum(NOISE[0] + NOISE[1] * ranges**4, NOISE[2])
    inside2 = np.minimum(sine2, 1.0)
    bias = variance * inside2 / (2.0 * radius)
    error = np.hypot(np.sqrt(sine2) * radius, ahead) - radius - bias
    spread = variance * (1.0 - inside2) + NOISE[3] * ranges**2 * inside2 + 2.0 * bias**2
    spread += SURFACE_VARIANCE
    rim = 1.0 - RIM_SIGMAS * growth * np.linalg.norm(center) / radius
    on = (error**2 <= gate**2 * spread) & (ahead >= -BEHIND_SIGMAS * np.sqrt(variance))
    on &= (rim >= 1.0) | (np.sqrt(sine2) <= rim)
    met = (ranges + ahead - radius * np.sqrt(1.0 - inside2)) / ranges
    normals = (points * met[:, None] - center) / (radius * np.sqrt(np.maximum(sine2, 1.0)))[:, None]
    rows = np.column_stack([normals, np.ones(len(points)), np.zeros(len(points))])
    weights = 1.0 / (spread + SHARING * variance * (1.0 - inside2))
    return rows[on], error[on], weights[on], (error**2 / spread)[on]


def outline_equations(points, fitted, least, most, variance):
    """Rows (k, 5), errors (k,) and weights (k,) of rays that pass the centre at such distances."""
    center, away = fitted[:3], float(np.linalg.norm(fitted[:3]))
    passed = points * (points @ center / np.square(points).sum(axis=1))[:, None] - center
    misses = np.linalg.norm(passed, axis=1)
    chosen = (misses > least) & (misses < most)
    directions = passed[chosen] / misses[chosen, None]
    count = int(chosen.sum())
    rows = np.column_stack([directions, np.ones(count), np.full(count, away)])
    errors = misses[chosen] - fitted[3] - fitted[4] * away
    return rows, errors, np.full(count, 1.0 / variance)


def fit_by_arrays(points, beyond, start, growth):
    """Sphere (4,), covariance (4, 4) and misfit of the same fit."""
    fitted, prior = np.append(start, 0.0), 1.0 / max(growth, 1e-7) ** 2
    for step in range(MAX_STEPS):
        gate = INLIER_SIGMAS * GATES[min(step, len(GATES) - 1)]
        away2, radius = float(fitted[:3] @ fitted[:3]), fitted[3]
        variance = NOISE[3] * away2 + SURFACE_VARIANCE
        grown = radius + fitted[4] * np.sqrt(away2)
        *surface, squares = surface_equations(points, fitted, growth, gate)
        parts = [surface, outline_equations(beyond, fitted, 0.5 * radius, grown, variance)]
        if growth > 0.0:
            widest = grown + gate * np.sqrt(variance)
            parts.append(outline_equations(points, fitted, grown, widest, variance))
        rows, errors, weights = (np.concatenate(part) for part in zip(*parts, strict=True))
        normal = rows.T @ (weights[:, None] * rows) + prior * np.diag([0, 0, 0, 0, 1.0])
        right = rows.T @ (weights * errors) - prior * fitted[4] * np.eye(5)[4]
        inverse = np.linalg.inv(normal)
        change = np.clip(inverse @ right, -0.5 * radius, 0.5 * radius)
        fitted += change
        fitted[3] = np.clip(fitted[3], 0.5 * SMALLEST, 2.0 * LARGEST)
        if step >= len(GATES) and np.abs(change).max() < STILL:
            break
    shift = inverse[:4, 4] * np.sqrt(prior)
    return fitted[:4], inverse[:4, :4] - np.outer(shift, shift), squares.sum() / (len(squares) - 4)


@given(st.integers(0, 10_000), st.integers(60, 700), st.sampled_from([0.0, 0.001]))
def test_the_fit_is_that_of_equations_in_arrays(seed, count, growth) -> None:
    """Rays through and past a ball, whose readings are taken from its surface or from behind it,
    in less than one and in several blocks."""
    rng = np.random.default_rng(seed)
    center, radius = np.array([0.1, -0.05, 1.2]), 0.06
    rays = center + np.append(rng.uniform(-1.3, 1.3, (count, 2)) * radius, np.zeros((count, 1)), 1)
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    along = rays @ center
    inside = radius**2 - center @ center + along**2
    ranges = np.where(inside > 0.0, along - np.sqrt(np.maximum(inside, 0.0)), 1.5)
    points = rays * (ranges + rng.normal(0.0, 0.002, count))[:, None]
    start = np.append(center, radius) + rng.normal(0.0, 0.002, 4)
    on, beyond = points[inside > 0.0], points[inside <= 0.0]
    fit = refine_sphere(on, beyond, start, SMALLEST, LARGEST, NOISE, SHARING, growth)
    sphere, covariance, misfit = fit_by_arrays(on, beyond, start, growth)
    assert fit.sphere == pytest.approx(sphere, abs=1e-8)
    assert fit.covariance == pytest.approx(covariance, rel=1e-5, abs=1e-12)
    assert fit.misfit == pytest.approx(misfit, rel=1e-6)


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
