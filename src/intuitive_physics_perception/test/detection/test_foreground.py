"""Pixels of a frame are divided into clusters as a graph of neighbours is into components."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from intuitive_physics_perception.detection.foreground import grid_clusters

JUMP, SIGMAS = 0.02, 6.0
CONSTANT, QUADRATIC, LIMIT = 0.002, 0.001, 0.01
LIMITS = np.array([0.04, 100.0, CONSTANT**2, QUADRATIC**2, LIMIT**2], dtype=np.float32)


def components(ranges, marks, fewest):
    """Pixels of each component of at least so many, in the order of their first pixels."""
    rows, columns = np.divmod(np.flatnonzero(marks), marks.shape[1])
    deviations = np.minimum(np.hypot(CONSTANT, QUADRATIC * ranges**2), LIMIT)
    near = (np.abs(rows[:, None] - rows) <= 1) & (np.abs(columns[:, None] - columns) <= 1)
    near &= marks[rows, columns][:, None] == marks[rows, columns]
    own = ranges[rows, columns]
    # A pixel is compared with those before it, by its own noise.
    jumps = JUMP + SIGMAS * deviations[rows, columns]
    near &= np.tril(np.abs(own[:, None] - own) <= jumps[:, None])
    _, labels = connected_components(csr_array(near), directed=False)
    pixels = np.flatnonzero(marks)
    parts = [pixels[labels == k] for k in range(labels.max(initial=-1) + 1)]
    return sorted((part for part in parts if len(part) >= fewest), key=lambda part: part[0])


@given(st.integers(0, 10_000), st.sampled_from([0.3, 0.6, 0.95]), st.integers(1, 6))
def test_clusters_of_an_image_are_components_of_neighbours(seed, filled, fewest) -> None:
    """Steps of 3 cm and noise: many pixels are about as far from their neighbours as a jump."""
    rng = np.random.default_rng(seed)
    height, width = rng.integers(1, 12, 2)
    ranges = 1.0 + 0.03 * rng.integers(0, 3, (height, width)) + 0.003 * rng.random((height, width))
    marks = (rng.integers(1, 3, (height, width)) * (rng.random((height, width)) < filled)).astype(
        np.uint8
    )
    points = np.zeros((height, width, 3), dtype=np.float32)
    points[..., 2] = ranges
    order, starts = grid_clusters(points, marks, LIMITS, JUMP, SIGMAS, fewest)
    expected = components(points[..., 2].astype(np.float64), marks, fewest)
    assert np.array_equal(starts, np.cumsum([0, *map(len, expected)]))
    assert np.array_equal(order, np.concatenate([np.zeros(0, np.int64), *expected]))
