"""The faces of a box that are seen, from readings on all of them."""

from __future__ import annotations

import numpy as np
import pytest

from intuitive_physics_perception.detection.box_fit import cloud_of_box, find_faces
from intuitive_physics_perception.environment.noise import RangeNoise

NOISE = RangeNoise(constant=1e-3, quadratic=0.0, limit=1e-3, lateral=1e-3)


@pytest.mark.parametrize("count", [100, 1500])
def test_three_faces_at_right_angles_are_found(count: int) -> None:
    rng = np.random.default_rng(3)
    points = rng.uniform(0.0, 0.3, (count, 3))
    points[np.arange(count), np.arange(count) % 3] = 0.0
    faces = find_faces(cloud_of_box(points + 1.0, NOISE), rng)
    assert faces is not None
    assert np.abs(np.abs(faces.rotation) - np.abs(faces.rotation).round()).max() < 0.05
    assert np.mean(faces.face >= 0) == 1.0
