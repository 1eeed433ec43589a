"""A ball that moves during the exposure: where it was in the middle of it."""

from __future__ import annotations

import numpy as np
import pytest

from intuitive_physics_perception.detection.swept_sphere import fit_sweep, unswept

NOISE = np.square([1e-3, 0.0, 1.0, 1e-5])
SMALL = {"width": 400, "height_pixels": 300, "focal": 328.0}
RATE = 60.0


def swept_readings(rng, sphere, sweep, count=1500, instants=4000):
    """Readings (n, 3) m of a swept ball without noise: the mean range over all instants in which a
    ray meets it, h = sqrt(r² - m²) before the nearest point to its centre."""
    toward = sphere[:3] + rng.uniform(-0.5, 0.5, (count, 1)) * sweep
    toward = toward + rng.uniform(-1.0, 1.0, (count, 3)) * sphere[3]
    rays = toward / np.linalg.norm(toward, axis=1)[:, None]
    times = (np.arange(instants) + 0.5) / instants - 0.5
    centers = sphere[:3] + times[:, None] * sweep
    along = rays @ centers.T
    rest = sphere[3] ** 2 - (np.sum(centers**2, axis=1) - along**2)
    ranges = np.where(rest > 0.0, along - np.sqrt(np.maximum(rest, 0.0)), np.nan)
    # Rays that graze for a few instants alone are integrated badly here.
    enough = (rest > 0.0).mean(axis=1) > 0.1
    return rays[enough] * np.nanmean(ranges[enough], axis=1)[:, None]


@pytest.mark.parametrize("way", [[0.06, 0.0, 0.0], [0.02, -0.03, 0.05], [0.0, 0.0, 0.1]])
def test_moved_readings_lie_on_the_sphere_in_the_middle_of_the_exposure(way, rng) -> None:
    sphere, sweep = np.array([0.2, -0.1, 1.8, 0.04]), np.array(way)
    readings = swept_readings(rng, sphere, sweep)
    off = np.linalg.norm(unswept(readings, sphere, sweep) - sphere[:3], axis=1) - sphere[3]
    # The sum over instants has an error of an instant's share of the range at either end.
    assert np.abs(off).max() < 2.0 * np.linalg.norm(sweep) / 4000 + 1e-4 * sphere[3]


@pytest.mark.parametrize("way", [[0.06, 0.0, 0.0], [0.02, -0.03, 0.05], [0.03, 0.03, -0.06]])
def test_centre_radius_and_sweep_are_fitted_together(way, rng) -> None:
    sphere, sweep = np.array([0.2, -0.1, 1.8, 0.04]), np.array(way)
    readings = swept_readings(rng, sphere, sweep)
    across = sweep - (sweep @ sphere[:3]) * sphere[:3] / (sphere[:3] @ sphere[:3])
    start = sphere + [0.004, -0.004, 0.004, 0.002]
    fitted = fit_sweep(readings, start, 0.7 * across, 0.1, NOISE, 0.0)
    assert fitted.sphere == pytest.approx(sphere, abs=0.002)
    # Both ends are alike: the sign of the sweep is that of the start.
    assert fitted.sweep == pytest.approx(sweep, abs=0.006)
