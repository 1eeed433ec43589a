"""Real depth frames of tables and rooms without a ball (shared/data/real/scenes)."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from intuitive_physics_perception.detection.detections import DetectedSphere
from intuitive_physics_perception.pipeline import PerceptionPipeline
from intuitive_physics_perception.settings import PerceptionSettings

NOISE = 0.002


@pytest.mark.needs("recordings")
@pytest.mark.parametrize("scene", ["table_0", "table_8"])
def test_no_ball_is_followed_where_there_is_none(recording: Callable[[str], Path], scene) -> None:
    with np.load(recording(f"scenes/{scene}.npz")) as data:
        depth, intrinsics = 0.001 * data["depth"].astype(np.float64), data["K"]
    v, u = np.mgrid[: depth.shape[0], : depth.shape[1]]
    rays = np.stack([u, v, np.ones_like(u)], axis=-1) @ np.linalg.inv(intrinsics).T
    depth[depth == 0.0] = np.nan
    settings, rng = PerceptionSettings(), np.random.default_rng(0)
    pipeline = PerceptionPipeline(settings, np.random.default_rng(0))
    frames, false = 10, 0
    for k in range(settings.environment_frames + frames):
        noisy = depth * (1.0 + NOISE * rng.standard_normal(depth.shape))
        result = pipeline.process((rays * noisy[..., None]).astype(np.float32), k / 30.0)
        false += sum(isinstance(found, DetectedSphere) for found in result.detections)
    assert result.model is not None
    assert false <= 0.1 * frames
