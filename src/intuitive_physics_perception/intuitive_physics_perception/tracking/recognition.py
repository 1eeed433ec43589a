"""Which known object a track is, told by its radius."""

from __future__ import annotations

import numpy as np

from intuitive_physics_perception.settings import PerceptionSettings
from intuitive_physics_perception.tracking.motion import RADIUS
from intuitive_physics_perception.tracking.track import Track

PATIENCE = 4
KNOWN_RADIUS_DEVIATION = 1e-5


def settle(track: Track, settings: PerceptionSettings) -> None:
    """Call a track an object as soon as that is clear, and a known one where it is."""
    if not track.confirmed and _is_settled(track, settings):
        track.confirmed = True
        _recognise(track, settings)


def _is_settled(track: Track, settings: PerceptionSettings) -> bool:
    """Whether it was seen often enough, and its radius tells known objects apart."""
    deviation = np.sqrt(track.covariance[RADIUS, RADIUS])
    return track.hits >= settings.confirming_hits and (
        not settings.known_objects
        or track.attitude is not None
        or 2.0 * deviation < settings.known_object_tolerance
        or track.hits >= PATIENCE * settings.confirming_hits
    )


def _recognise(track: Track, settings: PerceptionSettings) -> None:
    """Give the track the known object nearest in radius, whose radius then holds."""
    known = min(
        settings.known_objects,
        key=lambda thing: abs(thing.radius - track.mean[RADIUS]),
        default=None,
    )
    if known is None or track.attitude is not None:
        return
    tolerance = settings.known_object_tolerance
    if abs(known.radius - track.mean[RADIUS]) > tolerance:
        return
    track.known = known
    # A measurement of the radius alone, as good as a known one: it moves the centre, too.
    variance = track.covariance[RADIUS, RADIUS] + KNOWN_RADIUS_DEVIATION**2
    gain = track.covariance[:, RADIUS] / variance
    track.mean = track.mean + gain * (known.radius - track.mean[RADIUS])
    track.covariance = track.covariance - np.outer(gain, gain) * variance
