"""Rays and readings against planes, by the equations that define them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from intuitive_physics_perception.environment.plane_relief import PlaneRelief
from intuitive_physics_perception.environment.ray_planes import HIDING_DEPTH, RayPlanes
from intuitive_physics_perception.settings import PerceptionSettings

SETTINGS = PerceptionSettings()


@given(seed=st.integers(0, 10_000))
def test_a_free_range_ends_where_noise_and_unevenness_reach_a_plane(corner_model, seed) -> None:
    """There the distance d of the nearest plane that a ray meets is √((s σ c)² + t²)."""
    model = corner_model[1]
    rays = np.random.default_rng(seed).normal(size=(50, 3)) + [0.0, 0.0, 2.0]
    units = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    free = RayPlanes(model.detected, model.noise, SETTINGS).free_ranges(rays.astype(np.float32))
    spread = SETTINGS.plane_sigmas * model.noise.deviation(free)
    gaps = [np.where(free < 0.999 * SETTINGS.max_range, np.inf, 0.0)]
    for plane in model.detected:
        cosine = -(units @ plane.normal)
        with np.errstate(divide="ignore"):
            meets = (cosine > 1e-3) & plane.covers(units * (-plane.offset / cosine)[:, None])
        surface = plane.heights(units * free[:, None])
        distance = -plane.offset - free * cosine - surface
        margin = np.hypot(spread * cosine, SETTINGS.plane_tolerance)
        gaps.append(np.where(meets, distance - margin, np.inf))
    # Single precision of some metres, and a ray at the rim of a hull that one of both leaves out.
    unsure = np.abs(np.min(gaps, axis=0)) > 1e-4
    assert unsure.sum() <= 1


@pytest.mark.parametrize(
    ("depth", "explained", "visible"),
    [(0.0, 1.0, 1.0), (2.0 * HIDING_DEPTH, 1.0, 0.5), (-2.0 * HIDING_DEPTH, 0.5, 1.0)],
)
def test_what_lies_before_a_plane_hides_it_and_what_lies_behind_it_contradicts_it(
    corner_model, depth, explained, visible, rng
) -> None:
    """Half of the readings lie on the support, the others as far before it as given."""
    plane = corner_model[1].detected[0]
    weights = rng.dirichlet(np.ones(len(plane.hull)), 400)
    places = (0.5 * plane.hull.mean(axis=0) + 0.5 * weights @ plane.hull)[:, :3]
    places += plane.heights(places)[:, None] * plane.normal
    along = -(places @ plane.normal) / np.linalg.norm(places, axis=1)
    units = places / np.linalg.norm(places, axis=1, keepdims=True)
    moved = np.arange(400) % 2 == 0
    places[moved] -= (depth / along)[moved, None] * units[moved]
    planes = RayPlanes([plane], corner_model[1].noise, SETTINGS)
    places[0] = np.nan
    agreement = planes.agreement(places.astype(np.float32))
    assert agreement.readings == 399
    assert agreement.explained == pytest.approx(explained, abs=0.01)
    assert agreement.visible == pytest.approx(visible, abs=0.01)
    assert agreement.support == pytest.approx(explained, abs=0.01)


def test_without_planes_nothing_is_hidden(corner_model) -> None:
    points = np.full((10, 3), 1.0, dtype=np.float32)
    agreement = RayPlanes([], corner_model[1].noise, SETTINGS).agreement(points)
    assert (agreement.readings, agreement.explained, agreement.visible) == (10, 0.0, 1.0)


@given(seed=st.integers(0, 10_000), sag=st.sampled_from([0.0, 0.02]))
def test_only_readings_off_a_plane_lie_before_it_wherever_it_ends(corner_model, seed, sag) -> None:
    """Off it are those whose distance d from its surface has d² > (s σ)² + t²; no NaN is a
    reading."""
    model, rng = corner_model[1], np.random.default_rng(seed)
    plane, axes = model.detected[0], np.linalg.svd(model.detected[0].normal[None])[2][1:].T
    bowl = PlaneRelief(plane.hull.mean(axis=0), axes, np.array([0.0, 0.0, 0.0, sag, 0.0, sag]))
    plane = replace(plane, relief=bowl if sag else None)
    points = plane.hull.mean(axis=0) + rng.normal(size=(2000, 3)) @ (axes @ axes.T)
    heights = plane.heights(points) + rng.uniform(-0.1, 0.1, len(points))
    points = (points + heights[:, None] * plane.normal).astype(np.float32)
    points[rng.random(len(points)) < 0.3] = np.nan
    planes = RayPlanes([plane], model.noise, SETTINGS)
    kept, readings = planes.readings_before(points, continued=True)
    ranges = np.linalg.norm(points, axis=1)
    assert readings == np.sum((ranges >= SETTINGS.min_range) & (ranges <= SETTINGS.max_range))
    before = points[kept]
    assert np.isfinite(before).all()
    distances = before @ plane.normal - plane.offset - plane.heights(before)
    spread = SETTINGS.plane_sigmas * model.noise.deviation(ranges[kept])
    assert (np.abs(distances) > np.hypot(spread, SETTINGS.plane_tolerance) - 1e-4).all()
    assert 0 < len(kept) < readings


@given(seed=st.integers(0, 10_000), sag=st.sampled_from([0.0, 0.02]))
def test_a_reading_lies_before_all_planes_up_to_the_free_range_of_its_ray(
    corner_model, seed, sag
) -> None:
    model, rng = corner_model[1], np.random.default_rng(seed)
    first, *others = model.detected
    axes = np.linalg.svd(first.normal[None])[2][1:].T
    bowl = PlaneRelief(first.hull.mean(axis=0), axes, np.array([0.0, 0.0, 0.0, sag, 0.0, sag]))
    planes = RayPlanes(
        [replace(first, relief=bowl if sag else None), *others], model.noise, SETTINGS
    )
    points = (rng.normal(size=(2000, 3)) + [0.0, 0.0, 2.0]).astype(np.float32)
    ranges, free = np.linalg.norm(points, axis=1), planes.free_ranges(points)
    in_range = (ranges >= SETTINGS.min_range) & (ranges <= SETTINGS.max_range)
    is_before = np.zeros(len(points), dtype=bool)
    is_before[planes.readings_before(points)[0]] = True
    differ = is_before != (in_range & (ranges < free))
    assert not (differ & (np.abs(ranges - free) > 1e-3)).any()
    assert 0 < is_before.sum() < in_range.sum()
