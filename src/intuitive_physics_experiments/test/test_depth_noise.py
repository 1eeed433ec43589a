"""The camera's faults have the sizes they were asked to have."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from intuitive_physics.errors import InvalidInputError
from intuitive_physics_experiments.rendering.depth_noise import DepthNoise, NoisyDepthCamera
from intuitive_physics_experiments.rendering.depth_renderer import DepthImage

FOCAL_LENGTH = 460.0
CLEAN = DepthNoise(
    axial_constant=0.0, axial_quadratic=0.0, lateral_sigma=0.0, edge_loss=0.0, random_loss=0.0
)


def wall(depth: float, size: tuple[int, int] = (200, 300), cosine: float = 1.0) -> DepthImage:
    return DepthImage(np.full(size, depth, np.float32), np.full(size, cosine, np.float32))


def read(image: DepthImage, noise: DepthNoise, seed: int = 0) -> np.ndarray:
    return NoisyDepthCamera(image, FOCAL_LENGTH, noise, np.random.default_rng(seed)).read()


@pytest.mark.parametrize("depth", [0.5, 1.0, 2.0, 3.0])
def test_axial_noise_has_its_sigma_and_no_bias(depth):
    # σ(z) = a + b z²; quantisation to q adds q² / 12 of variance.
    noise = replace(CLEAN, axial_constant=0.001, axial_quadratic=0.0012, subpixels=64)
    readings = read(wall(depth), noise) / 1000.0
    quantum = depth**2 / (FOCAL_LENGTH * noise.baseline * noise.subpixels)
    expected = float(np.sqrt(noise.sigma(np.array(depth)) ** 2 + (quantum**2 + 0.001**2) / 12.0))
    assert readings.std() == pytest.approx(expected, rel=0.05)
    # Depth is one over disparity: noise of disparity lifts the mean by σ² / z.
    assert readings.mean() == pytest.approx(depth, abs=5 * expected / 245 + expected**2 / depth)


@pytest.mark.parametrize("depth", [1.0, 2.0, 4.0])
def test_quantisation_steps_grow_with_the_square_of_depth(depth):
    # dz = z² / (f b S) between neighbouring levels of disparity.
    image = wall(depth)
    slope = np.linspace(0.9 * depth, 1.1 * depth, image.depth.size, dtype=np.float32)
    image.depth[:] = slope.reshape(image.depth.shape)
    levels = np.unique(read(image, replace(CLEAN, subpixels=8))).astype(float)
    middle = np.argmin(np.abs(levels - 1000.0 * depth))
    expected = depth**2 / (FOCAL_LENGTH * CLEAN.baseline * 8) * 1000.0
    assert (levels[middle + 1] - levels[middle - 1]) / 2.0 == pytest.approx(
        expected, rel=0.1, abs=0.6
    )


def test_random_loss_is_as_frequent_as_asked():
    readings = read(wall(1.0), replace(CLEAN, random_loss=0.1))
    assert (readings == 0).mean() == pytest.approx(0.1, abs=5 * np.sqrt(0.09 / readings.size))


@pytest.mark.parametrize(("degrees", "share"), [(60.0, 0.0), (78.5, 0.5), (86.0, 1.0)])
def test_grazing_angles_lose_readings(degrees, share):
    readings = read(wall(1.0, cosine=np.cos(np.radians(degrees))), CLEAN)
    assert (readings == 0).mean() == pytest.approx(share, abs=0.02)


def test_out_of_range_and_empty_pixels_have_no_reading():
    for depth in (0.2, 9.0, 0.0):
        assert not read(wall(depth), CLEAN).any()


def test_an_object_shades_the_background_at_its_left():
    # The shadow of the second imager is f b (1 / z_near - 1 / z_far) pixels wide.
    image = wall(2.0)
    image.depth[50:150, 100:200] = 1.0
    readings = read(image, CLEAN)
    width = FOCAL_LENGTH * CLEAN.baseline * (1.0 / 1.0 - 1.0 / 2.0)
    lost = (readings[100] == 0).nonzero()[0]
    assert lost.max() == 99
    assert lost.size == pytest.approx(width, abs=1.0)


def test_edges_lose_readings_and_jitter():
    image = wall(2.0)
    image.depth[:100] = 1.0
    lossy = read(image, replace(CLEAN, edge_loss=0.5))
    assert (lossy[99:101] == 0).mean() == pytest.approx(0.5, abs=0.1)
    assert lossy[98].all()
    jittered = read(image, replace(CLEAN, lateral_sigma=0.5))
    # P(step of one pixel up) of the rounded normal deviate, e^-2 / (1 + 2 e^-2 + …)
    assert (jittered[99] > 1500).mean() == pytest.approx(0.1065, abs=0.05)


def test_same_seed_same_image_other_seed_other_image():
    noise = DepthNoise()
    assert np.array_equal(read(wall(1.0), noise, 3), read(wall(1.0), noise, 3))
    assert not np.array_equal(read(wall(1.0), noise, 3), read(wall(1.0), noise, 4))


def test_a_region_gives_what_the_whole_image_would(renderer, full_image):
    # Faults computed again only around the ball equal those of the whole image.
    center, radius = (0.5, 0.4, 0.4), 0.07
    noise = DepthNoise()
    sensors = [
        NoisyDepthCamera(image, FOCAL_LENGTH, noise, np.random.default_rng(5))
        for image in (renderer.background, full_image(center, radius))
    ]
    rendered = renderer.render_balls([center], [radius])
    by_region = sensors[0].read(rendered.image, rendered.region)
    assert np.array_equal(by_region, sensors[1].read())


@pytest.mark.parametrize(
    "change",
    [{"nearest": 0.0}, {"nearest": 9.0}, {"grazing_start": 89.0}, {"baseline": 0.0}],
)
def test_senseless_sizes_are_refused(change):
    with pytest.raises(InvalidInputError):
        DepthNoise(**change)
