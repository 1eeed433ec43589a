"""Planes with and without edges."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from intuitive_physics.scene import Plane

angle = st.floats(0.0, 2.0 * np.pi)


def polygon(corners: int, normal, offset: float, radius: float = 1.0) -> np.ndarray:
    """A regular polygon, counter-clockwise seen against the normal."""
    first = np.cross(normal, [0.3, -0.5, 0.8])
    first /= np.linalg.norm(first)
    second = np.cross(normal, first)
    angles = 2.0 * np.pi * np.arange(corners)[:, None] / corners
    return offset * normal + radius * (np.cos(angles) * first + np.sin(angles) * second)


def test_a_plane_without_edges_covers_everything() -> None:
    assert Plane("p", "m", (0, 0, 1), 0.0).covers(np.full((2, 3), 1e6)).tolist() == [True, True]


@given(st.integers(3, 9), angle, angle, st.floats(-2, 2), st.floats(-3, 3))
def test_a_boundary_covers_what_lies_above_and_below_its_polygon(
    corners, turn, tilt, offset, height
) -> None:
    normal = np.array([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)])
    boundary = polygon(corners, normal, offset)
    plane = Plane("p", "m", normal, offset, boundary)
    middles = 0.5 * (boundary + np.roll(boundary, -1, axis=0))
    center = offset * normal
    inside, outside = (center + part * (middles - center) for part in (0.999, 1.001))
    assert plane.covers(inside + height * normal).all()
    assert not plane.covers(outside + height * normal).any()
    assert plane.covers(center) == pytest.approx(True)
