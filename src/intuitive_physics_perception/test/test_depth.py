"""Raw depth images and clouds to points: true where they are good, one clear error else."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from intuitive_physics.errors import InvalidInputError
from intuitive_physics_perception.depth import (
    Field,
    Intrinsics,
    depth_from_image_data,
    points_from_cloud_data,
    points_from_depth,
)

K = [500.0, 0.0, 3.0, 0.0, 400.0, 2.0, 0.0, 0.0, 1.0]
XYZ = [Field("x", 0, 7, 1), Field("y", 4, 7, 1), Field("z", 8, 7, 1)]


def cloud(points: np.ndarray, **changes):
    data = points.astype("<f4")
    arguments = {
        "width": data.shape[1],
        "height": data.shape[0],
        "point_step": 12,
        "row_step": 12 * data.shape[1],
        "fields": XYZ,
        "is_bigendian": False,
    }
    return points_from_cloud_data(data.tobytes(), **{**arguments, **changes})


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
        ((2**32 - 1, 2**32 - 1, K), "at most 50,000,000"),
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
    image = depth_from_image_data(
        padded.tobytes(), width=3, height=2, encoding="16UC1", step=8, is_bigendian=False
    )
    assert image.tolist() == [[1, 2, 3], [4, 5, 6]]


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
    arguments = {"width": 3, "height": 2, "encoding": "16UC1", "step": 6, "is_bigendian": False}
    with pytest.raises(InvalidInputError, match=message):
        depth_from_image_data(bytes(12), **{**arguments, **changes})


def test_fields_in_any_order_and_of_both_precisions() -> None:
    layout = np.dtype(
        {
            "names": ["z", "intensity", "x", "y"],
            "formats": ["<f8", "<u2", "<f4", "<f8"],
            "offsets": [0, 8, 10, 16],
            "itemsize": 26,
        }
    )
    rows = np.zeros((2, 3), layout)
    rows["x"], rows["y"], rows["z"] = 1.5, np.arange(6).reshape(2, 3), -2.25
    padded = b"".join(row.tobytes() + b"??" for row in rows)
    points = points_from_cloud_data(
        padded,
        width=3,
        height=2,
        point_step=26,
        row_step=80,
        fields=[
            Field("z", 0, 8, 1),
            Field("intensity", 8, 4, 1),
            Field("x", 10, 7, 1),
            Field("y", 16, 8, 1),
        ],
        is_bigendian=False,
    )
    assert points.dtype == np.float32
    assert points[..., 0] == pytest.approx(1.5)
    assert points[..., 1].tolist() == [[0, 1, 2], [3, 4, 5]]
    assert points[..., 2] == pytest.approx(-2.25)


def test_a_point_that_is_partly_unreadable_is_nan() -> None:
    points = cloud(np.array([[[1, 2, 3], [np.nan, 2, 3], [1, np.inf, 3]]]))
    assert np.isnan(points[0]).all(axis=1).tolist() == [False, True, True]


def test_an_empty_cloud_has_no_points() -> None:
    assert cloud(np.zeros((1, 0, 3))).shape == (1, 0, 3)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"fields": XYZ[:2]}, "z missing"),
        ({"fields": []}, "x, y, z missing"),
        ({"fields": [*XYZ[:2], Field("z", 8, 5, 1)]}, "field z .* datatype 5"),
        ({"fields": [*XYZ[:2], Field("z", 8, 7, 3)]}, "field z .* count 3"),
        ({"fields": [*XYZ[:2], Field("z", 10, 7, 1)]}, "bytes 10 to 14"),
        ({"is_bigendian": True}, "big-endian"),
        ({"row_step": 13}, "rows of 13 bytes"),
        ({"height": 2}, "48 for 2 rows"),
    ],
)
def test_clouds_that_cannot_be_read_are_refused(changes: dict, message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        cloud(np.zeros((1, 2, 3)), **changes)


sizes = st.integers(0, 40) | st.integers(0, 2**32 - 1)
raw_fields = st.lists(
    st.builds(
        Field,
        st.sampled_from(["x", "y", "z", "rgb", ""]),
        st.integers(0, 40) | st.integers(0, 2**32 - 1),
        st.sampled_from([7, 8]) | st.integers(0, 255),
        st.integers(0, 3),
    ),
    max_size=6,
)


@settings(max_examples=300, deadline=None)
@given(
    st.binary(max_size=400), sizes, sizes, sizes, sizes, raw_fields | st.just(XYZ), st.booleans()
)
def test_any_cloud_message_gives_points_or_one_error(
    data, width, height, point_step, row_step, fields, is_bigendian
) -> None:
    try:
        points = points_from_cloud_data(
            data,
            width=width,
            height=height,
            point_step=point_step,
            row_step=row_step,
            fields=fields,
            is_bigendian=is_bigendian,
        )
    except InvalidInputError:
        return
    assert points.shape == (height, width, 3)
    finite = np.isfinite(points)
    assert np.array_equal(finite.all(axis=2), finite.any(axis=2))


@settings(max_examples=300, deadline=None)
@given(
    st.binary(max_size=400),
    sizes,
    sizes,
    sizes,
    st.sampled_from(["16UC1", "32FC1", "mono16", "8UC1", ""]),
    st.booleans(),
)
def test_any_image_message_gives_points_or_one_error(
    data, width, height, step, encoding, is_bigendian
) -> None:
    try:
        image = depth_from_image_data(
            data,
            width=width,
            height=height,
            encoding=encoding,
            step=step,
            is_bigendian=is_bigendian,
        )
    except InvalidInputError:
        return
    assert image.shape == (height, width)
    if image.size:
        points = points_from_depth(image, Intrinsics(width, height, K).rays())
        depth = points[..., 2]
        assert ((depth > 0.0) | np.isnan(depth)).all()
