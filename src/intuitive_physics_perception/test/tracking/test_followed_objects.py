"""What shows an object is no part of the environment."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from intuitive_physics_perception.settings import PerceptionSettings
from intuitive_physics_perception.tracking.followed_objects import MARGIN, FollowedObjects

from ..conftest import FLOOR, seen_sphere

SETTINGS = PerceptionSettings()


@given(seed=st.integers(0, 10_000))
def test_only_readings_about_what_is_followed_are_removed(corner_model, seed) -> None:
    """Those nearer to an object than its bounding radius and the margin, of any number of them."""
    rng, model = np.random.default_rng(seed), corner_model[1]
    followed = FollowedObjects(FLOOR, SETTINGS, 1)
    places = np.array([[1.0, 0.0, 0.4], [1.5, 0.2, 0.6], [1.2, -0.6, 0.5]])[: seed % 4]
    for k in range(10):
        balls = places + [0.02 * k, 0.0, 0.0]
        followed.tracker.update(k / 30, [seen_sphere(rng, ball, 0.06) for ball in balls])
    tracks = followed.tracker.tracks
    assert len(tracks) == len(places)
    points = rng.uniform(-0.5, 0.5, (20, 30, 3)) + model.to_sensor(np.array([1.2, 0.0, 0.5]))
    points = points.astype(np.float32)
    points[rng.random((20, 30)) < 0.1] = np.nan
    left = np.isfinite(points[..., 0])
    for track in tracks:
        away = np.linalg.norm(points - model.to_sensor(track.mean[:3]), axis=2)
        left &= away >= track.scene_object(SETTINGS).shape.bounding_radius + MARGIN
    removed = followed.removed_from(points, model)
    np.testing.assert_array_equal(removed, np.where(left[..., None], points, np.nan))
