"""Balls that are the end of a capsule: seen along its axis, a capsule shows no more than that."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.shapes import Capsule
from intuitive_physics_perception.tracking.motion import POSITION
from intuitive_physics_perception.tracking.track import Track


def is_in_capsule(place: NDArray[np.float64], tracks: Iterable[Track]) -> bool:
    """Return whether a place (3,) is in one of the capsules that are followed.

    No other thing has its centre there, as two share no space.
    """
    for track in tracks:
        if track.attitude is None or not isinstance(track.attitude.shape, Capsule):
            continue
        capsule, axis = track.attitude.shape, track.attitude.rotation[:, 2]
        away = place - track.mean[POSITION]
        half = 0.5 * capsule.length
        off = away - float(np.clip(away @ axis, -half, half)) * axis
        if np.linalg.norm(off) < capsule.radius:
            return True
    return False
