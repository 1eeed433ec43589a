"""Raw PointCloud2 data to points: true where they are good, one clear error else."""

from __future__ import annotations

from types import SimpleNamespace as Message

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from intuitive_physics.errors import InvalidInputError
from intuitive_physics_perception.input.point_cloud import points_of_cloud


def field(name: str, offset: int, datatype: int, count: int = 1) -> Message:
    return Message(name=name, offset=offset, datatype=datatype, count=count)


XYZ = [field("x", 0, 7, 1), field("y", 4, 7, 1), field("z", 8, 7, 1)]


def cloud(points: np.ndarray, **changes) -> Message:
    fields = {
        "data": points.astype("<f4").tobytes(),
        "width": points.shape[1],
        "height": points.shape[0],
        "point_step": 12,
        "row_step": 12 * points.shape[1],
        "fields": XYZ,
        "is_bigendian": False,
    }
    return Message(**{**fields, **changes})


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
    fields = [field("z", 0, 8), field("intensity", 8, 4), field("x", 10, 7), field("y", 16, 8)]
    message = cloud(np.zeros((2, 3, 3)), data=padded, point_step=26, row_step=80, fields=fields)
    points = points_of_cloud(message)
    assert points.dtype == np.float32
    assert points[..., 0] == pytest.approx(1.5)
    assert points[..., 1].tolist() == [[0, 1, 2], [3, 4, 5]]
    assert points[..., 2] == pytest.approx(-2.25)


def test_a_point_that_is_partly_unreadable_is_nan() -> None:
    points = points_of_cloud(cloud(np.array([[[1, 2, 3], [np.nan, 2, 3], [1, np.inf, 3]]])))
    assert np.isnan(points[0]).all(axis=1).tolist() == [False, True, True]


def test_an_empty_cloud_has_no_points() -> None:
    assert points_of_cloud(cloud(np.zeros((1, 0, 3)))).shape == (1, 0, 3)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"fields": XYZ[:2]}, "z missing"),
        ({"fields": []}, "x, y, z missing"),
        ({"fields": [*XYZ[:2], field("z", 8, 5, 1)]}, "field z .* datatype 5"),
        ({"fields": [*XYZ[:2], field("z", 8, 7, 3)]}, "field z .* count 3"),
        ({"fields": [*XYZ[:2], field("z", 10, 7, 1)]}, "bytes 10 to 14"),
        ({"is_bigendian": True}, "big-endian"),
        ({"row_step": 13}, "rows of 13 bytes"),
        ({"height": 2}, "48 for 2 rows"),
    ],
)
def test_clouds_that_cannot_be_read_are_refused(changes: dict, message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        points_of_cloud(cloud(np.zeros((1, 2, 3)), **changes))


sizes = st.integers(0, 40) | st.integers(0, 2**32 - 1)


@settings(max_examples=500, deadline=None)
@given(
    st.fixed_dictionaries(
        {},
        optional={
            "data": st.binary(max_size=400),
            "width": sizes,
            "height": sizes,
            "point_step": sizes,
            "row_step": sizes,
            "is_bigendian": st.booleans(),
            "fields": st.lists(
                st.builds(
                    field,
                    st.sampled_from(["x", "y", "z", "rgb", ""]) | st.text(max_size=3),
                    sizes,
                    st.sampled_from([7, 8]) | st.integers(0, 255),
                    st.integers(0, 3) | sizes,
                ),
                max_size=8,
            ),
        },
    )
)
def test_any_cloud_message_gives_points_or_one_sentence(changes) -> None:
    message = cloud(np.ones((1, 4, 3)), **changes)
    try:
        points = points_of_cloud(message)
    except InvalidInputError as error:
        sentence = str(error)
        assert "expected" in sentence
        assert len(sentence) < 600
        return
    assert points.shape == (message.height, message.width, 3)
    finite = np.isfinite(points)
    assert np.array_equal(finite.all(axis=2), finite.any(axis=2))
