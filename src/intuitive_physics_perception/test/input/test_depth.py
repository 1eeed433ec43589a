"""Raw depth images to points: true where they are good, one clear error else."""

from __future__ import annotations

from types import SimpleNamespace as Message

import numpy as np
import pytest

from intuitive_physics.errors import InvalidInputError
from intuitive_physics_perception.input.camera import Intrinsics
from intuitive_physics_perception.input.depth import depth_of_image, points_from_depth

K = [500.0, 0.0, 3.0, 0.0, 400.0, 2.0, 0.0, 0.0, 1.0]


def test_a_pixel_looks_through_the_pinhole() -> None:
    # u = f_x x / z + c_x, v = f_y y / z + c_y
    points = points_from_depth(np.full((5, 7), 2000, np.uint16), Intrinsics(7, 5, K).rays())
    u, v = np.meshgrid(np.arange(7), np.arange(5))
    assert points[..., 2] == pytest.approx(2.0)
    assert 500 * points[..., 0] / points[..., 2] + 3 == pytest.approx(u, abs=1e-4)
    assert 400 * points[..., 1] / points[..., 2] + 2 == pytest.approx(v, abs=1e-4)


def test_metres_and_millimetres_agree_and_missing_readings_are_nan() -> None:
    rays = Intrinsics(3, 1, [1, 0, 1, 0, 1, 0, 0, 0, 1]).rays()
    millimetres = points_from_depth(np.array([[1500, 0, 65535]], np.uint16), rays)
    metres = points_from_depth(np.array([[1.5, np.inf, 65.535]], np.float32), rays)
    assert np.array_equal(np.isnan(millimetres[0]).all(axis=1), [False, True, False])
    assert np.allclose(millimetres, metres, equal_nan=True)
    assert np.isnan(points_from_depth(np.array([[-1.0, np.nan, 0.0]], np.float32), rays)).all()


@pytest.mark.parametrize(
    ("model", "terms"),
    [
        ("plumb_bob", [0.1, -0.05, 0.001, -0.002, 0.01]),
        ("rational_polynomial", [0.2, 0.03, 0.001, 0.002, 0.01, 0.1, 0.02, 0.005]),
    ],
)
def test_distorting_an_undistorted_ray_gives_its_pixel(model: str, terms: list[float]) -> None:
    matrix = np.array([[300.0, 0, 160], [0, 300.0, 120], [0, 0, 1]])
    rays = Intrinsics(320, 240, matrix, terms, model).rays().astype(float)
    x, y = rays[..., 0], rays[..., 1]
    k1, k2, p1, p2, k3, k4, k5, k6 = [*terms, 0, 0, 0][:8]
    r2 = x**2 + y**2
    radial = (1 + k1 * r2 + k2 * r2**2 + k3 * r2**3) / (1 + k4 * r2 + k5 * r2**2 + k6 * r2**3)
    u = 300 * (x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x**2)) + 160
    v = 300 * (y * radial + p1 * (r2 + 2 * y**2) + 2 * p2 * x * y) + 120
    seen_u, seen_v = np.meshgrid(np.arange(320), np.arange(240))
    assert np.abs(u - seen_u).max() < 1e-2
    assert np.abs(v - seen_v).max() < 1e-2


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((0, 5, K), "0 x 5 pixels"),
        ((2**32 - 1, 2**32 - 1, K), "at most 16,000,000"),
        ((7, 5, np.zeros(9)), "focal length fx"),
        ((7, 5, np.zeros(8)), "camera matrix"),
        ((7, 5, K, [0.1] * 4, "equidistant"), "equidistant"),
        ((7, 5, K, [0.1] * 7, "plumb_bob"), "7 terms"),
    ],
)
def test_a_camera_that_is_none_is_refused(arguments: tuple, message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        Intrinsics(*arguments)


def test_image_and_camera_must_have_one_size() -> None:
    with pytest.raises(InvalidInputError, match=r"\(7, 6\).*\(7, 5\)"):
        points_from_depth(np.zeros((6, 7), np.uint16), Intrinsics(7, 5, K).rays())
    with pytest.raises(InvalidInputError, match="int32"):
        points_from_depth(np.zeros((5, 7), np.int32), Intrinsics(7, 5, K).rays())


def test_image_rows_may_be_padded() -> None:
    padded = np.zeros((2, 4), "<u2")
    padded[:, :3] = [[1, 2, 3], [4, 5, 6]]
    image = Message(
        data=padded.tobytes(), width=3, height=2, encoding="16UC1", step=8, is_bigendian=0
    )
    assert depth_of_image(image).tolist() == [[1, 2, 3], [4, 5, 6]]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"encoding": "rgb8"}, "'rgb8'; expected a depth image"),
        ({"is_bigendian": True}, "big-endian"),
        ({"step": 5}, "rows of 5 bytes"),
        ({"height": 3}, "truncated"),
    ],
)
def test_images_that_are_not_depth_are_refused(changes: dict, message: str) -> None:
    header = {"width": 3, "height": 2, "encoding": "16UC1", "step": 6, "is_bigendian": 0}
    with pytest.raises(InvalidInputError, match=message):
        depth_of_image(Message(data=bytes(12), **{**header, **changes}))
