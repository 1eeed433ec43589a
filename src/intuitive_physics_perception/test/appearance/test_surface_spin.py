"""The spin that images of a sphere show, on textures that are known in closed form."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from intuitive_physics_perception.appearance import spin_fit
from intuitive_physics_perception.appearance.registration import (
    CELLS,
    DISAGREEMENT,
    GRADIENT,
    MEAT,
    POWER,
    PRODUCT,
    RIM,
    add_scores,
)
from intuitive_physics_perception.appearance.sphere_image import GRID_CELLS, SphereImage, pitch_of
from intuitive_physics_perception.appearance.spin_fit import ImageSeries, Spin
from intuitive_physics_perception.appearance.surface_spin import SurfaceSpin
from intuitive_physics_perception.appearance.turn_search import LAGS, turn_tables

from ..conftest import waves

CELLS_ACROSS = GRID_CELLS
RATE = 30.0

Field = Callable[[NDArray[np.float64]], NDArray[np.float64]]


def image(
    surface: Field,
    orientation: NDArray[np.float64],
    axes: NDArray[np.float64],
    light: Field = lambda n: 0.0 * n[..., 0],
    noise: float = 0.0,
    rng: np.random.Generator | None = None,
) -> SphereImage:
    """What a view with axes (3, 3) sees of a ball whose axes are those of `orientation`."""
    line = (np.arange(CELLS_ACROSS) - 0.5 * (CELLS_ACROSS - 1)) * pitch_of(CELLS_ACROSS)
    x, y = np.meshgrid(line, line)
    with np.errstate(invalid="ignore"):
        z = np.sqrt(1.0 - x**2 - y**2)
    directions = np.stack([x, y, z], axis=-1) @ axes
    values = surface(directions @ orientation) + light(directions)
    if rng is not None:
        values = values + noise * rng.normal(size=values.shape)
    return SphereImage(np.where(z > RIM, values, np.nan), 10.0, axes, 0.0)


def axes_towards(direction: NDArray[np.float64]) -> NDArray[np.float64]:
    toward = direction / np.linalg.norm(direction)
    right = np.cross(toward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(toward, right), toward])


def flight(
    surface: Field, spin: NDArray[np.float64], frames: int, seed: int = 0, **more
) -> tuple[list[float], list[SphereImage]]:
    """Images of a ball whose line of sight turns slowly."""
    start = Rotation.random(random_state=seed)
    times = [k / RATE for k in range(frames)]
    views = [axes_towards(np.array([-1.0, 0.3 * t, 0.2 + 0.5 * t])) for t in times]
    turns = [(Rotation.from_rotvec(t * spin) * start).as_matrix() for t in times]
    return times, [image(surface, *pair, **more) for pair in zip(turns, views, strict=True)]


def estimated(times: list[float], images: list[SphereImage]) -> SurfaceSpin:
    """What is known of a spin after some images."""
    estimator = SurfaceSpin()
    for time, view in zip(times, images, strict=True):
        estimator.take(time, view)
    return estimator


def random_spin(seed: int, turn: float) -> NDArray[np.float64]:
    """A spin (3,) rad/s that turns a ball by some rad from frame to frame."""
    direction = np.random.default_rng(seed).normal(size=3)
    return direction * (turn * RATE / np.linalg.norm(direction))


def test_the_gradient_is_that_of_the_misfit() -> None:
    series = ImageSeries(*flight(waves(1), np.array([2.0, -3.0, 1.0]), 3))
    at = np.array([2.6, -2.5, 1.4])

    def misfit(spin: NDArray[np.float64]) -> float:
        # Σ (e_k - e_j)² / 2 = Σ (e_k² + e_j²) / 2 - Σ e_k e_j.
        totals = series.overlaid(spin, 2)
        return float(totals[POWER] - totals[PRODUCT])

    step = 1e-3
    numeric = [
        (misfit(at + step * unit) - misfit(at - step * unit)) / (2.0 * step) for unit in np.eye(3)
    ]
    gradient = -series.overlaid(at, 2)[GRADIENT:MEAT]
    # Slopes are those of a linear interpolation, and cells come and go at the rim.
    assert gradient == pytest.approx(numeric, abs=0.1 * float(np.linalg.norm(numeric)))


def test_smooth_light_makes_no_difference() -> None:
    times, images = flight(waves(2), np.array([3.0, 1.0, -4.0]), 3)
    _, lit = flight(
        waves(2),
        np.array([3.0, 1.0, -4.0]),
        3,
        light=lambda n: 2.0 * n[..., 0] - n[..., 1] * n[..., 2] + 3.0 * n[..., 2] ** 2,
    )
    first, second = (ImageSeries(times, own).overlaid(np.ones(3), 2) for own in (images, lit))
    assert second[CELLS] == first[CELLS]
    assert second[[PRODUCT, POWER]] == pytest.approx(first[[PRODUCT, POWER]], rel=0.05)


@pytest.mark.parametrize("spin", [(0.5, 2.0, -3.0), (12.0, -9.0, 4.0), (30.0, 5.0, -25.0)])
def test_a_texture_tells_the_spin(spin: tuple[float, float, float]) -> None:
    truth = np.array(spin)
    estimator = estimated(*flight(waves(3), truth, 6))
    assert estimator.spin is not None
    error = estimator.spin.mean - truth
    assert np.linalg.norm(error) < 0.3
    assert error @ np.linalg.solve(estimator.spin.covariance, error) < 16.0


def last_spin(
    surface: Field, spin: NDArray[np.float64], frames: int, seed: int, noise: float = 0.05
) -> Spin | None:
    """What is known of a spin at the end of a flight."""
    rng = np.random.default_rng(seed)
    return estimated(*flight(surface, spin, frames, seed, noise=noise, rng=rng)).spin


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("turn", [1.4, 1.9, 2.4])
def test_a_fast_ball_is_known(turn: float, seed: int) -> None:
    truth = random_spin(seed, turn)
    estimate = last_spin(waves(seed), truth, 8, seed)
    assert estimate is not None
    assert np.linalg.norm(estimate.mean - truth) < 1.0
    error = estimate.mean - truth
    assert error @ np.linalg.solve(estimate.covariance, error) < 16.0


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("turn", [2.9, np.pi, 3.4])
def test_about_half_a_turn_from_frame_to_frame_is_not_believed(turn: float, seed: int) -> None:
    truth = random_spin(seed, turn)
    assert last_spin(waves(seed), truth, 8, seed) is None


@pytest.mark.parametrize("seed", range(6))
def test_images_a_whole_turn_apart_say_nothing_of_the_axis(seed: int) -> None:
    truth = random_spin(seed, 2.0 * np.pi / 3.0)
    estimate = last_spin(waves(seed), truth, 8, seed)
    assert estimate is None or np.linalg.norm(estimate.mean - truth) < 1.5


def test_a_pattern_on_one_side_is_known_when_it_comes_back() -> None:
    inner = waves(11, number=9.0)
    cap: Field = lambda n: np.clip((n[..., 0] - 0.3) / 0.4, 0.0, 1.0) * inner(n)  # noqa: E731
    known = 0
    for seed in range(8):
        truth = random_spin(seed, 1.9)
        estimate = last_spin(cap, truth, 10, seed)
        known += estimate is not None
        assert estimate is None or np.linalg.norm(estimate.mean - truth) < 2.0
    assert known >= 6


def test_views_without_a_common_part_tell_nothing() -> None:
    estimator = SurfaceSpin()
    for k, toward in enumerate(([-1.0, 0.0, 0.1], [1.0, 0.0, 0.1], [0.0, 0.0, -1.0])):
        axes = axes_towards(np.array(toward) + [0.0, 0.01, 0.0])
        estimator.take(k / RATE, image(waves(k), np.eye(3), axes))
    assert estimator.spin is None


def test_centres_that_are_off_alike_turn_the_axis() -> None:
    spin, deviation = np.array([0.0, 40.0, 30.0]), 0.02
    times, images = flight(waves(3), spin, 6)
    exact, unsure = (
        ImageSeries(times, [replace(view, place_deviation=off) for view in images]).fitted(spin)
        for off in (0.0, deviation)
    )
    # Turned about an axis across the line of sight, which is near -x, the spin moves along x.
    more = unsure.covariance[0, 0] - exact.covariance[0, 0]
    assert more > 0.9 * (deviation * np.linalg.norm(spin)) ** 2


def test_noise_widens_the_covariance(monkeypatch) -> None:
    monkeypatch.setattr(spin_fit, "ALIGNMENT_DEVIATION", 0.0)
    monkeypatch.setattr(spin_fit, "LIGHT_SLOPE", 0.0)
    spreads = []
    for noise in (0.0, 0.4):
        times, images = flight(
            waves(4), np.array([4.0, 2.0, 1.0]), 5, noise=noise, rng=np.random.default_rng(0)
        )
        estimate = ImageSeries(times, images).fitted(np.array([4.0, 2.0, 1.0]))
        spreads.append(float(np.trace(estimate.covariance)))
    assert spreads[1] > 1.5 * spreads[0]


@pytest.mark.parametrize("seed", range(10))
def test_noise_is_no_pattern(seed: int) -> None:
    estimator = SurfaceSpin()
    plain: Field = lambda n: 0.0 * n[..., 0]  # noqa: E731
    rng = np.random.default_rng(seed)
    for time, view in zip(*flight(plain, np.ones(3), 7, noise=1.0, rng=rng), strict=True):
        estimator.take(time, view)
        assert estimator.spin is None


def test_what_stands_still_in_the_room_is_light() -> None:
    estimator = SurfaceSpin()
    for time, view in zip(*flight(waves(5), np.zeros(3), 7), strict=True):
        estimator.take(time, view)
        assert estimator.spin is None


@pytest.mark.parametrize("seed", range(4))
def test_a_highlight_that_goes_with_the_line_of_sight_is_no_pattern(seed: int) -> None:
    """On a plain ball that passes close by it is half-way between lamp and sensor."""
    rng = np.random.default_rng(seed)
    lamp = rng.normal(size=3) + [-0.5, -0.5, 1.0]
    estimator = SurfaceSpin()
    plain: Field = lambda n: 0.0 * n[..., 0]  # noqa: E731
    for k in range(12):
        axes = axes_towards(np.array([-0.6, 3.0 * k / RATE - 0.6, 0.2 + 0.2 * k / RATE]))
        middle = lamp / np.linalg.norm(lamp) + axes[2]
        middle /= np.linalg.norm(middle)
        gleam: Field = lambda n, at=middle: 3.0 * np.maximum(n @ at, 0.0) ** 60  # noqa: E731
        estimator.take(k / RATE, image(plain, np.eye(3), axes, gleam, noise=0.1, rng=rng))
        assert estimator.spin is None


def test_a_pattern_that_looks_the_same_elsewhere_has_no_one_spin() -> None:
    # Sixteen meridians: a turn about their axis by a sixteenth goes unnoticed.
    meridians: Field = lambda n: np.cos(16.0 * np.arctan2(n[..., 0], n[..., 1]))  # noqa: E731
    estimator = SurfaceSpin()
    axes = axes_towards(np.array([0.0, 0.1, 1.0]))
    for k in range(6):
        turn = Rotation.from_rotvec([0.0, 0.0, 0.15 * k]).as_matrix()
        estimator.take(k / RATE, image(meridians, turn, axes))
    assert estimator.spin is None


def test_another_spin_after_a_hit_is_not_the_one_before() -> None:
    times, images = flight(waves(6), np.array([8.0, 2.0, -3.0]), 5)
    _, others = flight(waves(6), np.array([-6.0, 9.0, 7.0]), 12, seed=9)
    estimator = estimated(times, images)
    assert estimator.spin is not None
    for k, view in enumerate(others[5:10]):
        estimator.take(times[-1] + (k + 1) / RATE, view)
    assert estimator.spin is None or estimator.spin.mean == pytest.approx([-6.0, 9.0, 7.0], abs=0.5)


def test_a_spin_is_at_its_rotation_in_each_table() -> None:
    step = 0.5
    rotations, turns, places = turn_tables(step)
    for lag in range(1, LAGS + 1):
        back = rotations[places[::50, lag - 1]]
        left = Rotation.from_matrix(back) * Rotation.from_rotvec(lag * turns[::50])
        # At most half of the diagonal of a cell of the grid, which shrinks far from its middle.
        assert left.magnitude().max() <= 0.5 * np.sqrt(3.0) * step + 1e-9


def test_images_that_lie_on_one_another_score_by_their_power() -> None:
    view = image(waves(8), np.eye(3), axes_towards(np.array([-1.0, 0.2, 0.1]))).coarse
    scores = np.zeros(2)
    add_scores(view, view, np.stack([np.eye(3), np.diag([-1.0, 1.0, -1.0])]), 0.12, scores)
    rows, columns = np.indices(view.shape)
    power = np.nansum(np.square(view[(rows + columns) % 2 == 0]))
    # Turned by half a turn nothing is seen in both.
    assert scores == pytest.approx([(1.0 - DISAGREEMENT) * power, 0.0], rel=1e-4)
