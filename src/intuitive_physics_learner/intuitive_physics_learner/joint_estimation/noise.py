"""How noisy observed positions are, told from the trajectories alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from intuitive_physics.observation import Observation

SMALLEST_NOISE = 1e-4
"""m; no camera measures better, and what is divided by it stays well conditioned."""

NORMAL_MEDIAN = 0.6745
"""Median of |x| for x of the standard normal distribution."""


def position_noise(observations: Sequence[Observation]) -> float:
    """Standard deviation in m of a point on each axis.

    Third differences of free flight and of uniform motion vanish at equal time steps, so those of
    what was seen are noise, with twenty times its variance; a median passes over contacts. Steps
    that are not equal leave in some of the motion: then this is too large rather than too small.
    """
    differences = [
        np.diff(seen.trajectory.positions, 3, axis=0).ravel()
        for observation in observations
        for seen in observation.objects
    ]
    pooled = np.abs(np.concatenate(differences))
    if pooled.size == 0:
        return SMALLEST_NOISE
    return max(float(np.median(pooled)) / NORMAL_MEDIAN / np.sqrt(20.0), SMALLEST_NOISE)
