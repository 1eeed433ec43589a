"""Edges that seem larger or smaller than they are, the same all round: separate from noise."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from intuitive_physics_perception.detection.sphere_fit import readings_beyond, refine_sphere

PIXEL = 1.0 / 550.0
"""rad between rays."""

WALL = 3.0
LIMITS = (0.015, 0.4)
LATERAL = 0.45 * PIXEL
"""rad, of each reading's direction."""


def readings(
    sphere: NDArray[np.float64], growth: float, noise: float, rng: np.random.Generator
) -> NDArray[np.float64]:
    """What a grid of rays reads of a sphere before a wall, whose outline is `growth` rad larger.

    A ray inside the sphere meets it at l cos β - √(r² - l² sin² β), β its angle to the centre. One
    that is only inside the grown outline reads what is at the outline, √(l² - r²).
    """
    away = float(np.linalg.norm(sphere[:3]))
    half = np.arcsin(sphere[3] / away)
    steps = np.arange(-2.0 * half, 2.0 * half, PIXEL) + rng.uniform(0.0, PIXEL)
    across, up = (axis.ravel() for axis in np.meshgrid(steps, steps))
    rays = np.column_stack([across, up, np.ones_like(up)])
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    turn = np.array([sphere[0], sphere[1], sphere[2] - away])
    rays = rays + turn / away
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    # Each reading is taken from a little beside its own ray.
    taken = rays + LATERAL * rng.normal(size=rays.shape)
    taken /= np.linalg.norm(taken, axis=1, keepdims=True)
    along = taken @ sphere[:3]
    angle = np.arccos(np.minimum(along / away, 1.0))
    root = sphere[3] ** 2 - away**2 + along**2
    rim = np.sqrt(away**2 - sphere[3] ** 2)
    ranges = np.where(root > 0.0, along - np.sqrt(np.maximum(root, 0.0)), rim)
    ranges = np.where(angle < half + growth, ranges, WALL / rays[:, 2])
    return rays * (ranges + noise * rng.normal(size=len(rays)))[:, None]


def fitted(
    points: NDArray[np.float64], start: NDArray[np.float64], noise: float, growth: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    model = np.square([noise, 0.0, 1.0, LATERAL])
    near = points[np.linalg.norm(points, axis=1) < 0.5 * (start[2] + WALL)]
    sphere = start
    for _ in range(2):
        beyond = readings_beyond(points, sphere, model)
        sphere, covariance, shift, _, inliers = refine_sphere(
            near, beyond, sphere, *LIMITS, model, 0.0, growth
        )
        assert inliers > 50
    return sphere, covariance, shift


@pytest.mark.parametrize("away", [0.8, 1.6])
def test_errors_are_as_large_as_noise_and_growth_say(away: float) -> None:
    """Growths drawn from the prior: (e Σ⁻¹ e) / 4 is one on average, Σ = covariance + s sᵀ."""
    rng = np.random.default_rng(3)
    truth = np.array([0.05, -0.1, away, 0.05])
    sigma, noise = 0.7 * PIXEL, 0.001 + 0.001 * away**2
    squares = []
    for _ in range(60):
        points = readings(truth, sigma * rng.normal(), noise, rng)
        sphere, covariance, shift = fitted(points, truth * 1.02, noise, sigma)
        error = sphere - truth
        whole = covariance + np.outer(shift, shift)
        squares.append(error @ np.linalg.solve(whole, error) / 4.0)
    assert 0.5 < np.mean(squares) < 1.5


def test_growth_that_is_not_asked_for_is_taken_for_the_sphere() -> None:
    rng = np.random.default_rng(4)
    truth = np.array([0.0, 0.0, 1.6, 0.05])
    points = readings(truth, 1.0 * PIXEL, 0.004, rng)
    sphere, covariance, shift = fitted(points, truth, 0.004, 0.0)
    assert np.abs(shift).max() < 1e-6
    assert sphere[3] - truth[3] > 5.0 * np.sqrt(covariance[3, 3])
    with_growth, covariance, shift = fitted(points, truth, 0.004, PIXEL)
    assert abs(with_growth[3] - truth[3]) < 2.0 * np.sqrt(covariance[3, 3] + shift[3] ** 2)
    assert abs(with_growth[3] - truth[3]) < 0.5 * abs(sphere[3] - truth[3])


def test_much_curvature_tells_the_growth_itself() -> None:
    """Near by, a millimetre of noise on a large ball: the surface alone says how large it is."""
    rng = np.random.default_rng(5)
    truth = np.array([0.0, 0.0, 0.6, 0.12])
    points = readings(truth, 2.0 * PIXEL, 0.0005, rng)
    sphere, _, shift = fitted(points, truth, 0.0005, PIXEL)
    assert abs(sphere[3] - truth[3]) < 0.0003
    # The prior says little, so a growth of one standard deviation moves the fit by little.
    assert np.abs(shift).max() < 0.2 * PIXEL * 0.6
