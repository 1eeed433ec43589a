"""What the newest frame shows of a track, apart from what was known before."""

from __future__ import annotations

import numpy as np

from intuitive_physics.observation import Detections
from intuitive_physics_perception.tracking.motion import RADIUS
from intuitive_physics_perception.tracking.track import Track


def newest_detection(track: Track) -> Detections | None:
    """Return the detection in a track's newest frame, given the radius its average found.

    The centre of a sphere is moved as `record_of` does, with the gain of this frame alone.

    Returns
    -------
    Detections
        One, in the environment's frame; None where the object was not seen in that frame.
    """
    step = track.steps[-1]
    if step.seen is None:
        return None
    own = step.seen.covariance - step.seen.systematic
    position, covariance = step.seen.center, own[:3, :3]
    bias = step.seen.systematic[:3, :3]
    if track.attitude is None:
        gain = own[:3, 3] / own[3, 3]
        position = position + gain * (track.mean[RADIUS] - step.seen.radius)
        covariance = covariance - own[3, 3] * np.outer(gain, gain)
        bias = bias + track.covariance[RADIUS, RADIUS] * np.outer(gain, gain)
    return Detections([step.time], position[None], covariance[None], bias)
