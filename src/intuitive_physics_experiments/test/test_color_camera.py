"""Painted balls turn in the colour image as they turn in the room; plain ones never seem to."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.scene import Environment, Plane
from intuitive_physics_experiments.rendering.ball_surface import (
    DOT_RADIUS,
    PATTERNS,
    BallSurface,
    dot_centers,
)
from intuitive_physics_experiments.rendering.camera import Camera
from intuitive_physics_experiments.rendering.color_camera import (
    ColorCamera,
    ColoredBall,
    ColorNoise,
    RoomLight,
)
from intuitive_physics_experiments.rendering.depth_renderer import DepthRenderer
from intuitive_physics_experiments.rendering.thrown_ball import BallMotion

SILENT = ColorNoise(deviation=0.0, blur=0.0)
AHEAD = np.array([1.5, 0.0, 1.0])


@pytest.fixture(scope="module")
def renderer():
    camera = Camera.looking_at((0.0, 0.0, 1.0), (1.0, 0.0, 1.0), width=120, height=100)
    floor = Plane("floor", "room", (0.0, 0.0, 1.0), 0.0)
    return DepthRenderer(camera, Environment([floor]))


def read(renderer: DepthRenderer, ball: ColoredBall, noise: ColorNoise = SILENT, **light):
    rng = np.random.default_rng(0)
    return ColorCamera(renderer, RoomLight(**light), noise, rng).read([ball]).astype(float)


@pytest.mark.parametrize("pattern", PATTERNS)
def test_only_a_plain_ball_looks_the_same_from_all_sides(renderer, pattern):
    surface = BallSurface(pattern)
    turned = Rotation.from_rotvec([0.0, 0.0, 1.2]).as_matrix()
    first = read(renderer, ColoredBall(AHEAD, 0.05, surface))
    second = read(renderer, ColoredBall(AHEAD, 0.05, surface, turned))
    assert np.array_equal(first, second) == (pattern == "plain")


def test_a_mark_is_where_the_rotation_has_brought_it(renderer):
    dot = dot_centers()[0]
    # Brings the dot's middle to the side that the camera sees: -x in the room.
    way, _ = Rotation.align_vectors([[-1.0, 0.0, 0.0]], [dot])
    ball = ColoredBall(AHEAD, 0.1, BallSurface("dots"), way.as_matrix())
    image = read(renderer, ball, ambient=1.0, diffuse=0.0)
    u, v = np.rint(renderer.camera.project(AHEAD)).astype(int)
    dark = 255.0 * np.array(BallSurface().mark)
    bright = 255.0 * np.array(BallSurface().ground)
    assert image[v, u] == pytest.approx(dark, abs=1.0)
    # The dot's rim is at sin(0.22) radii from the middle.
    pixels = 460.0 * 0.1 * np.sin(DOT_RADIUS) / 1.4
    assert image[v, u + round(pixels) - 2] == pytest.approx(dark, abs=1.0)
    assert image[v, u + round(pixels) + 2] == pytest.approx(bright, abs=1.0)


def test_light_stands_still_while_a_ball_turns(renderer):
    spin = np.array([0.0, 0.0, 9.0])
    ball = ColoredBall(AHEAD, 0.05, BallSurface(), angular_velocity=spin)
    assert np.array_equal(read(renderer, ball), read(renderer, ball.after(0.1)))
    above = read(renderer, ball, direction=(0.0, 0.0, 1.0))
    u, v = np.rint(renderer.camera.project(AHEAD)).astype(int)
    assert above[v - 8, u].sum() > above[v + 8, u].sum()


def test_noise_has_its_deviation(renderer):
    ball = ColoredBall(AHEAD, 0.05, BallSurface())
    clean = read(renderer, ball, replace(SILENT, blur=0.5))
    noisy = read(renderer, ball, ColorNoise(deviation=3.0))
    assert np.std(noisy - clean) == pytest.approx(3.0, rel=0.05)


def test_orientation_is_the_integral_of_the_spin():
    times = np.linspace(0.0, 1.0, 121)
    spin = np.array([1.0, -2.0, 0.5])
    motion = BallMotion(times, np.zeros((121, 3)), np.zeros((121, 3)), np.tile(spin, (121, 1)))
    assert motion.orientation_at(0.7) == pytest.approx(
        Rotation.from_rotvec(0.7 * spin).as_matrix(), abs=1e-9
    )


def test_what_cannot_be_is_refused():
    with pytest.raises(InvalidInputError, match="expected one of plain, dots, seams, logo"):
        BallSurface("stripes")
    with pytest.raises(InvalidInputError, match="expected none below 0"):
        ColorNoise(deviation=-1.0)
