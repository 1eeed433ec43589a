"""What is measured of a cluster's pixels, against NumPy."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from intuitive_physics_perception.detection.cluster_view import (
    directions_of,
    extent_of,
    outline_of,
)


@given(
    seed=st.integers(0, 10_000),
    size=st.tuples(st.integers(1, 40), st.integers(1, 40)),
    part=st.floats(0.01, 1.0),
)
def test_outline_extent_and_directions_of_a_cluster(seed, size, part) -> None:
    """First and last rows and columns; the largest less the smallest coordinate; points over their
    lengths, by the same operations of single precision."""
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(size[0] * size[1], 3)).astype(np.float32)
    count = max(1, round(part * len(points)))
    cluster = np.sort(rng.choice(len(points), count, replace=False))
    rows, columns = np.divmod(cluster, size[1])
    of_numpy = rows.min(), rows.max(), columns.min(), columns.max()
    assert outline_of(cluster, size[1]) == of_numpy
    chosen = points[cluster]
    np.testing.assert_array_equal(extent_of(points, cluster), np.ptp(chosen, axis=0))
    lengths = np.linalg.norm(chosen, axis=1, keepdims=True)
    np.testing.assert_array_equal(directions_of(points, cluster), chosen / lengths)
