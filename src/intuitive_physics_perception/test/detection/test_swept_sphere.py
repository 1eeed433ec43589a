"""A ball that moves during the exposure: where it was in the middle of it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2

from intuitive_physics_perception.detection.cluster_view import ClusterView
from intuitive_physics_perception.detection.fitted_sphere import SphereFitter, Start
from intuitive_physics_perception.detection.sphere_hypotheses import scanned_motion
from intuitive_physics_perception.detection.swept_sphere import fit_sweep, unswept
from intuitive_physics_perception.environment.noise import RangeNoise
from intuitive_physics_perception.frame import Scan
from intuitive_physics_perception.pipeline import PerceptionPipeline
from intuitive_physics_perception.settings import PerceptionSettings

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
    moved = unswept(readings, np.full(len(readings), np.nan), sphere, sweep)
    off = np.linalg.norm(moved - sphere[:3], axis=1) - sphere[3]
    # The sum over instants has an error of an instant's share of the range at either end.
    assert np.abs(off).max() < 2.0 * np.linalg.norm(sweep) / 4000 + 1e-4 * sphere[3]


@pytest.mark.parametrize("way", [[0.06, 0.0, 0.0], [0.02, -0.03, 0.05], [0.03, 0.03, -0.06]])
def test_centre_radius_and_sweep_are_fitted_together(way, rng) -> None:
    sphere, sweep = np.array([0.2, -0.1, 1.8, 0.04]), np.array(way)
    readings = swept_readings(rng, sphere, sweep)
    across = sweep - (sweep @ sphere[:3]) * sphere[:3] / (sphere[:3] @ sphere[:3])
    start = sphere + [0.004, -0.004, 0.004, 0.002]
    times = np.full(len(readings), np.nan)
    fitted = fit_sweep(readings, times, start, 0.7 * across, 0.1, NOISE, 0.0)
    assert fitted.sphere == pytest.approx(sphere, abs=0.002)
    # Both ends are alike: the sign of the sweep is that of the start.
    assert fitted.sweep == pytest.approx(sweep, abs=0.006)


def scanned_readings(rng, sphere, velocity, noise=0.0, count=300, duration=0.1):
    """Readings (n, 3) m of a ball that was in the centre of the sphere (4,) m in the middle of a
    scan, and their times after its beginning (n,) s: each of another ray at another time."""
    offsets = rng.uniform(0.0, duration, count)
    centers = sphere[:3] + (offsets - 0.5 * duration)[:, None] * velocity
    toward = centers + rng.uniform(-1.0, 1.0, (count, 3)) * sphere[3]
    rays = toward / np.linalg.norm(toward, axis=1)[:, None]
    along = np.sum(rays * centers, axis=1)
    rest = sphere[3] ** 2 - (np.sum(centers**2, axis=1) - along**2)
    meets = rest > 0.0
    ranges = along[meets] - np.sqrt(rest[meets]) + rng.normal(0.0, noise, meets.sum())
    return rays[meets] * ranges[:, None], offsets[meets].astype(np.float32)


velocities = st.tuples(*[st.floats(-4.0, 4.0)] * 3)


@given(velocities, st.integers(0, 10_000))
def test_readings_of_known_times_lie_on_the_sphere_where_it_was_in_the_middle(way, seed) -> None:
    """p' = p - t s, exact but for the rounding of single precision."""
    sphere, duration = np.array([0.2, -0.1, 1.8, 0.12]), 0.1
    readings, offsets = scanned_readings(np.random.default_rng(seed), sphere, np.array(way))
    times = offsets / duration - 0.5
    moved = unswept(readings, times, sphere, duration * np.array(way))
    off = np.linalg.norm(moved - sphere[:3], axis=1) - sphere[3]
    assert np.abs(off).max() < 1e-5


@settings(deadline=None)
@given(st.tuples(*[st.floats(-0.5, 0.5)] * 3), st.integers(0, 10_000))
def test_sphere_and_velocity_of_a_scanned_ball_are_fitted_together(way, seed) -> None:
    """Without noise no error is left; it begins at rest, beside the ball."""
    sphere, sweep = np.array([0.2, -0.1, 1.8, 0.12]), 0.1 * np.array(way)
    readings, offsets = scanned_readings(np.random.default_rng(seed), sphere, np.array(way))
    start, noise = sphere + [0.01, 0.0, 0.0, 0.0], np.square([0.01, 0.0, 1.0, 1e-5])
    fitted = fit_sweep(readings, offsets / 0.1 - 0.5, start, np.zeros(3), 1e3, noise, 0.0)
    assert fitted.sphere == pytest.approx(sphere, abs=1e-3)
    assert fitted.sweep == pytest.approx(sweep, abs=1e-3)


@pytest.mark.parametrize("speed", [0.0, 0.5, 3.0])
def test_errors_of_a_scanned_ball_are_as_large_as_stated(speed, rng) -> None:
    """Squared errors of the centre in its covariance: χ² of three degrees of freedom for each scan,
    but for what is added for the edges that a beam smears."""
    noise = RangeNoise(0.005, 0.0, 0.05, 1e-4)
    fitter = SphereFitter(noise, PerceptionSettings(), rng)
    squares = []
    for _ in range(100):
        sphere = np.append(rng.uniform(-0.2, 0.2, 2), [rng.uniform(1.5, 2.5), 0.12])
        direction = rng.normal(size=3)
        velocity = speed * direction / np.linalg.norm(direction)
        readings, offsets = scanned_readings(rng, sphere, velocity, 0.005)
        points = readings.astype(np.float32)[None]
        view = ClusterView(points, np.arange(len(readings)), None, Scan(offsets, 0.1))
        start = Start(*scanned_motion(view.readings, view.times_of(view.cluster)))
        found = fitter.fitted(view, fitter.part(view), start)
        if found is None:
            continue
        error = found.center - sphere[:3] - (found.delay - 0.05) * velocity
        squares.append(error @ np.linalg.solve(found.covariance[:3, :3], error))
    assert len(squares) > 90
    assert 0.6 < np.mean(squares) / 3.0 < 1.3


@pytest.mark.long
@pytest.mark.parametrize(
    ("speed", "exposure", "least"),
    [
        (3.0, 0.0, 0.0),
        (3.0, 0.015, 0.0),
        (3.0, 0.015, 0.5),
        (8.0, 0.005, 0.0),
        (8.0, 0.005, 0.5),
        # Where a pixel needs half of the exposure, 12 cm of sweep leave what is wider than s / 4,
        # next to nothing of a ball of 3 cm.
        (8.0, 0.015, 0.0),
    ],
)
def test_a_fast_ball_is_one_ball_where_it_was_in_mid_exposure(
    make_room, shapes, speed, exposure, least
) -> None:
    """Against the exact path: found in nearly every frame that shows it whole, one number, and
    squared errors as the covariance says."""
    rng = np.random.default_rng([round(1e3 * exposure), round(speed), round(10 * least)])
    squares, missed, numbers, delays = [], 0, [], []
    for throw in range(2):
        room = make_room(tilt=15.0, height=1.0, seed=throw, **SMALL)
        settings = PerceptionSettings(environment_frames=4, exposure=exposure)
        pipeline = PerceptionPipeline(settings, np.random.default_rng(0))
        for k in range(4):
            pipeline.process(room.points(), k / RATE)
        radius, side = rng.uniform(0.03, 0.06), rng.choice([-1.0, 1.0])
        heading = np.array([rng.uniform(-0.4, 0.4), -side, rng.uniform(0.0, 0.35)])
        depth = rng.uniform(1.6, 2.3)
        start = np.array([depth, 0.45 * depth * side, rng.uniform(0.7, 0.9)])
        seen_from = None
        for time in np.arange(0.0, 0.8, 1.0 / RATE):
            velocity = speed * heading / np.linalg.norm(heading) - [0.0, 0.0, 9.81 * time]
            center = start + time * (velocity + [0.0, 0.0, 4.905 * time])
            sweep = velocity * exposure
            if not _is_whole(room, center, radius + 0.5 * np.linalg.norm(sweep)):
                break
            ball = shapes["swept"](center, radius, sweep, least)
            result = pipeline.process(room.points(extra=[ball]), 4 / RATE + time)
            seen_from = time if seen_from is None else seen_from
            if result.objects and len(delays) == throw:
                delays.append(time - seen_from)
            near = [d for d in result.detections if np.linalg.norm(d.center - center) < 2 * radius]
            missed += len(near) != 1
            numbers += [item.object.id for item in result.objects]
            for detection in near:
                off = detection.center - center
                squares.append(off @ np.linalg.solve(detection.covariance[:3, :3], off))
        numbers.append("end of a throw")
    assert missed <= 0.05 * (len(squares) + missed)
    assert len(set(numbers)) == 2
    assert max(delays) < 0.1
    # The median of χ² with three degrees of freedom; a few readings at the edge of a small ball at
    # 2 m move it by a factor of two or so.
    assert 0.4 * chi2.median(3) < np.median(squares) < 2.5 * chi2.median(3)


def _is_whole(room, center, reach) -> bool:
    """Whether the image shows all of a ball of a radius `reach`, above the floor."""
    x, y, z = room.to_camera(center)
    margin = room.focal * reach / z
    column, row = room.focal * x / z + room.matrix[0, 2], room.focal * y / z + room.matrix[1, 2]
    inside = margin < column < room.width - margin and margin < row < room.height_pixels - margin
    return bool(inside and center[2] > reach)
