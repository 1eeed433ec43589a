"""No frame waits for a compiler: what counts readings near faces is compiled once."""

from __future__ import annotations

import numpy as np
import pytest

from intuitive_physics_perception.compile import warm_up
from intuitive_physics_perception.detection import box_fit


@pytest.mark.parametrize("count", [100, 1500])
@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_one_kind_of_array_is_compiled_for(count: int, kind: type) -> None:
    # Of many readings every n-th is looked at, a view that is not contiguous.
    warm_up()
    rng = np.random.default_rng(3)
    points = rng.uniform(0.0, 0.3, (count, 3))
    points[np.arange(count), np.arange(count) % 3] = 0.0
    faces = box_fit.find_faces((points + 1.0).astype(kind), np.full(count, 1e-3, kind), rng)
    assert faces is not None
    assert np.abs(np.abs(faces.rotation) - np.abs(faces.rotation).round()).max() < 0.05
    assert len(box_fit._near_counts.signatures) == 1
