"""Spheres where they are, as large as they are, and nothing else called a sphere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from intuitive_physics_perception.detection.cluster_view import ClusterView
from intuitive_physics_perception.detection.detections import DetectedSphere
from intuitive_physics_perception.detection.fitted_sphere import (
    SphereFitter,
    Start,
    rounding_covariance,
)
from intuitive_physics_perception.detection.foreground import ForegroundFinder
from intuitive_physics_perception.detection.solids import SolidFinder, all_objects
from intuitive_physics_perception.detection.sphere_fit import refine_sphere
from intuitive_physics_perception.detection.sphere_hypotheses import outline_sphere
from intuitive_physics_perception.detection.spheres import SphereFinder
from intuitive_physics_perception.environment.noise import RangeNoise
from intuitive_physics_perception.settings import KnownObject, PerceptionSettings

SETTINGS = PerceptionSettings()
NOTHING = np.zeros((0, 3))


@pytest.fixture(scope="module")
def find(corner_model):
    """Spheres of a depth image of the corner, in the world."""
    room, model = corner_model
    foreground = ForegroundFinder(model, SETTINGS)
    finder = SphereFinder(model, SETTINGS, np.random.default_rng(4))
    solids = SolidFinder(model, SETTINGS, np.random.default_rng(5))

    def spheres(balls=(), extra=()):
        points = room.points(balls, extra)
        seen = all_objects(points, finder.find(points, foreground.find(points)), solids)
        found = [one.detection for one in seen]
        spheres = [seen for seen in found if isinstance(seen, DetectedSphere)]
        return [(room.rotation @ s.center + room.origin, s) for s in spheres]

    return spheres


def near_side(rng, center, radius, count, noise=0.0):
    """Readings of the side of a sphere that the origin sees, with noise along the rays."""
    directions = rng.normal(size=(60 * count, 3)) * 0.2 + np.asarray(center)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    along = directions @ center
    root = along**2 - np.dot(center, center) + radius**2
    hit = np.flatnonzero(root > 0.0)[:count]
    ranges = along[hit] - np.sqrt(root[hit]) + noise * rng.normal(size=hit.size)
    return directions[hit] * ranges[:, None]


@pytest.mark.parametrize("radius", [0.03, 0.05, 0.07])
@pytest.mark.parametrize("distance", [1.0, 1.5, 2.0])
def test_centre_and_radius_are_within_the_bars(find, radius, distance) -> None:
    # Bars of the perception issue: position RMSE below 5 mm up to 2 m, radius within 2 mm.
    rng, errors, surprises = np.random.default_rng(2), [], []
    for _ in range(8):
        angle, drop = rng.uniform(-0.3, 0.3), rng.uniform(0.1, 0.3)
        flat = np.sqrt(distance**2 - (drop * distance) ** 2)
        center = np.array([flat * np.cos(angle), flat * np.sin(angle), 0.8 - drop * distance])
        ((place, sphere),) = find([(center, radius)])
        errors.append([*(place - center), sphere.radius - radius])
        surprises.append((sphere.radius - radius) ** 2 / sphere.covariance[3, 3])
    errors = np.array(errors)
    assert np.sqrt(np.square(errors[:, :3]).sum(axis=1).mean()) < 0.003
    assert np.sqrt(np.square(errors[:, 3]).mean()) < 0.002
    # The covariance is honest: squared errors in variances are one on average.
    assert np.mean(surprises) < 3.0


def test_errors_near_the_camera_are_as_large_as_stated(corner_model, find) -> None:
    """(eᵀ C⁻¹ e) / 3 is one on average, or up to a half of that where the surface shows the centre
    better than an outline of whole pixels. Of 40 centres it is known to 13 %."""
    room, _ = corner_model
    rng, squares = np.random.default_rng(2), []
    for _ in range(40):
        center = rng.uniform([0.45, -0.1, 0.5], [0.6, 0.1, 0.65])
        ((place, sphere),) = find([(center, 0.04)])
        error = room.rotation.T @ (place - center)
        squares.append(error @ np.linalg.solve(sphere.covariance[:3, :3], error) / 3.0)
    assert 0.4 < np.mean(squares) < 1.4


@pytest.mark.parametrize("radius", [8, 16, 32])
def test_a_disc_of_pixels_is_off_by_what_rounding_says(radius) -> None:
    """Its middle, and the radius that its area has."""
    rng, errors = np.random.default_rng(0), []
    pixels = np.stack(np.mgrid[-radius - 2 : radius + 3, -radius - 2 : radius + 3], axis=-1)
    for _ in range(600):
        center = rng.uniform(size=2)
        inside = np.linalg.norm(pixels - center, axis=-1) < radius
        off = pixels[inside].mean(axis=0) - center
        errors.append([*off, np.sqrt(inside.sum() / np.pi) - radius])
    # At 1 m a pixel of 1 mrad is 1 mm wide.
    stated = rounding_covariance(np.array([0.0, 0.0, 1.0, 0.001 * radius]), 0.001)
    variances = 1e-6 * np.mean(np.square(errors), axis=0)
    assert variances == pytest.approx(np.diag(stated)[[0, 1, 3]], rel=0.5)
    # What is seen of the surface stays where it is.
    assert stated[2, 2] == pytest.approx(stated[3, 3]) == pytest.approx(stated[2, 3])


def test_the_fit_is_unbiased_where_noise_is_large(rng) -> None:
    # Noise of a fifth of the radius: plain geometric least squares is off by a tenth of it.
    noise = np.square([0.01, 0.0, 1.0, 0.0008])
    center, radius = np.array([0.1, -0.2, 2.5]), 0.05
    fits = []
    for _ in range(60):
        points = near_side(rng, center, radius, 400, 0.01)
        start = np.append(center + 0.01, 0.06)
        fit = refine_sphere(points, NOTHING, start, 0.015, 0.4, noise, 0.0, 0.0)
        assert fit.inliers > 380
        assert fit.misfit == pytest.approx(1.0, abs=0.4)
        fits.append([*(fit.sphere - [*center, radius]), fit.covariance[3, 3]])
    fits = np.array(fits)
    scatter = fits[:, :4].std(axis=0)
    assert np.abs(fits[:, :4].mean(axis=0)).max() < 0.1 * radius
    assert scatter[3] < 2.0 * np.sqrt(np.median(fits[:, 4]))


def test_readings_that_share_an_error_tell_no_more_than_one_of_them(rng) -> None:
    """Three equal readings in place of each: the fit and its covariance stay as they were."""
    noise = np.square([0.002, 0.0, 1.0, 1e-7])
    points = near_side(rng, np.array([0.1, 0.2, 1.5]), 0.06, 300, 0.002)
    limits = NOTHING, np.array([0.1, 0.2, 1.5, 0.06]), 0.015, 0.4, noise
    once = refine_sphere(points, *limits, 0.0, 0.0)
    shared = refine_sphere(np.repeat(points, 3, axis=0), *limits, 2.0, 0.0)
    independent = refine_sphere(np.repeat(points, 3, axis=0), *limits, 0.0, 0.0)
    covariance = np.diag(once.covariance)
    assert shared.sphere == pytest.approx(once.sphere, abs=0.3 * np.sqrt(covariance.min()))
    # Where rays graze, the second order of the error, 2 β², counts as each reading's own.
    assert np.diag(shared.covariance) == pytest.approx(covariance, rel=0.1)
    assert np.diag(independent.covariance) == pytest.approx(covariance / 3.0, rel=0.05)


def test_without_noise_the_fit_is_exact(rng) -> None:
    noise = np.square([1e-4, 0.0, 1.0, 1e-5])
    truth = np.array([0.3, -0.1, 1.7, 0.06])
    points = near_side(rng, truth[:3], truth[3], 500)
    start = outline_sphere(points)
    fit = refine_sphere(points, NOTHING, start, 0.015, 0.4, noise, 0.0, 0.0)
    assert fit.sphere == pytest.approx(truth, abs=1e-6)


def test_a_known_radius_places_a_hidden_ball_better(corner_model, make_room, shapes) -> None:
    _, model = corner_model
    # Noise of its own: what is found does not depend on the tests before.
    room = make_room(tilt=25.0, seed=7)
    foreground = ForegroundFinder(model, SETTINGS)
    centers = [np.array([1.9, 0.05 * k - 0.3, 0.4]) for k in range(12)]
    frames = []
    for center in centers:
        box = shapes["box"](center - [0.4, -0.055, 0.0], (0.05, 0.1, 0.4), 0.0)
        frames.append(room.points([(center, 0.07)], [box]))
    errors, counts = {}, {}
    for objects in (
        (),
        (KnownObject("small", 0.03, "wood"), KnownObject("large", 0.07, "foam")),
    ):
        settings = replace(SETTINGS, known_objects=objects)
        finder = SphereFinder(model, settings, np.random.default_rng(4))
        misses = []
        for center, points in zip(centers, frames, strict=True):
            parts = finder.find(points, foreground.find(points))
            for sphere in (sphere for part in parts for sphere in part.spheres):
                misses.append(room.rotation @ sphere.center + room.origin - center)
        counts[bool(objects)] = len(misses)
        errors[bool(objects)] = np.sqrt(np.square(misses).sum(axis=1).mean())
    assert min(counts.values()) >= 8
    assert errors[True] < 0.9 * errors[False]


@pytest.mark.parametrize(
    "balls",
    [
        [((1.5, -0.4, 0.4), 0.07), ((1.6, 0.0, 0.5), 0.05), ((1.4, 0.3, 0.3), 0.03)],
        [((1.4, -0.05, 0.4), 0.05), ((1.4, 0.05, 0.4), 0.05)],
    ],
    ids=["apart", "touching"],
)
def test_several_balls_at_once(find, balls) -> None:
    detected = find(balls)
    assert len(detected) == len(balls)
    for center, radius in balls:
        assert min(np.linalg.norm(place - center) for place, _ in detected) < 0.005
        assert min(abs(sphere.radius - radius) for _, sphere in detected) < 0.002


def test_a_ball_half_hidden_by_a_box(find, shapes) -> None:
    box = shapes["box"]((1.2, 0.05, 0.45), (0.05, 0.1, 0.4), 0.0)
    detected = find([((1.6, 0.0, 0.4), 0.07)], [box])
    assert len(detected) == 1
    assert detected[0][0] == pytest.approx([1.6, 0.0, 0.4], abs=0.008)


def test_a_ball_cut_by_the_edge_of_the_image(corner_model, find) -> None:
    room, _ = corner_model
    edge = room.rotation @ (np.array([(0 - 319.5) / room.focal, -0.2, 1.0]) * 1.5) + room.origin
    ((place, _),) = find([(edge, 0.07)])
    assert place == pytest.approx(edge, abs=0.006)


def test_a_ball_lying_on_the_floor(find) -> None:
    ((place, sphere),) = find([((1.3, 0.1, 0.05), 0.05)])
    assert place == pytest.approx([1.3, 0.1, 0.05], abs=0.004)
    assert sphere.radius == pytest.approx(0.05, abs=0.002)


@pytest.mark.parametrize("seed", range(3))
def test_what_is_no_sphere_is_not_called_one(find, shapes, seed) -> None:
    rng = np.random.default_rng(seed)
    turn, size = rng.uniform(0, 1.5), rng.uniform(0.05, 0.15)
    at = (rng.uniform(1.2, 1.8), rng.uniform(-0.3, 0.3))
    for shape in (
        shapes["box"]((*at, size / 2), (size, size, size), turn),
        shapes["box"]((*at, 0.5), (size, 0.6 * size, 0.4 * size), turn),
        shapes["cylinder"](*at, 0.5 * size, 2.5 * size),
        shapes["cylinder"](*at, 0.5 * size, size),
        shapes["bowl"]((*at, 0.3), size),
        shapes["capsule"]((*at, 0.3), [0.4 * size, size, 0.3 * size], 0.5 * size),
        shapes["capsule"]((*at, 0.3), [0.7 * size, 0.7 * size, 0.0], 0.5 * size),
    ):
        assert find(extra=[shape]) == [], shape


@pytest.mark.parametrize("seed", range(4))
def test_a_hand_is_no_ball(find, shapes, seed) -> None:
    # A palm, as a flat box, and four fingers and a thumb of rounded ends, spread and turned.
    rng = np.random.default_rng(seed)
    turn = Rotation.random(random_state=seed).as_matrix()
    at = np.array([rng.uniform(1.0, 1.4), rng.uniform(-0.2, 0.2), 0.5])
    parts = [shapes["box"](at, (0.09, 0.10, 0.03), turn)]
    for finger in np.linspace(-0.035, 0.035, 4):
        spread = np.array([2.0 * finger, 1.0, rng.uniform(-0.2, 0.2)])
        half = 0.035 * spread / np.linalg.norm(spread)
        start = np.array([finger, 0.05, 0.0])
        parts.append(shapes["capsule"](at + turn @ (start + half), turn @ half, 0.009))
    thumb = np.array([0.025, 0.02, 0.0])
    parts.append(shapes["capsule"](at + turn @ ([0.045, 0.0, 0.0] + thumb), turn @ thumb, 0.01))
    assert find(extra=parts) == []


def test_a_ball_in_a_hand_s_fingers_is_one(find, shapes) -> None:
    ball = np.array([1.3, 0.0, 0.5])
    fingers = [
        shapes["capsule"](ball + [0.0, side * 0.06, -0.02], (0.0, 0.0, 0.04), 0.009)
        for side in (-1.0, 1.0)
    ]
    ((place, sphere),) = find([(ball, 0.05)], fingers)
    assert place == pytest.approx(ball, abs=0.006)
    assert sphere.radius == pytest.approx(0.05, abs=0.004)


def test_no_reading_makes_no_sphere(corner_model) -> None:
    """As where all that is near a sphere lies on the others of its cluster."""
    room, model = corner_model
    points = room.points([((1.5, 0.0, 0.3), 0.05)])
    (cluster,) = ForegroundFinder(model, SETTINGS).find(points).indices
    fitter = SphereFitter(model.noise, SETTINGS, np.random.default_rng(0))
    fitter.look_from(model)
    start = Start(np.append(room.to_camera([1.5, 0.0, 0.3]), 0.05))
    view = ClusterView(points, cluster)
    nothing = fitter.part(view, np.zeros(len(cluster), dtype=bool))
    assert fitter.fitted(view, fitter.part_near(view, start), start) is not None
    assert fitter.fitted(view, nothing, start) is None


def test_an_empty_scene_has_no_spheres(find) -> None:
    assert all(find() == [] for _ in range(3))


def test_noise_grows_with_range_squared_up_to_its_limit() -> None:
    noise = RangeNoise(0.003, 0.001, 0.02, 0.001)
    assert noise.deviation([0.0, 2.0, 100.0]) == pytest.approx([0.003, 0.005, 0.02])
