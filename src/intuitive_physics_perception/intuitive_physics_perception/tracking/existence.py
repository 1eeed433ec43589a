"""Whether a track is an object of its own: log odds, summed over what speaks for and against it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from intuitive_physics_perception.detection.detections import DetectedSphere, Detection
from intuitive_physics_perception.detection.fitted_sphere import stands_apart

APART = float(np.log(0.98 / 0.17))
"""Log of the likelihood ratio of a sphere that stands apart, in nats: of balls that were rendered
into the real scenes for tuning 254 of 258 did (free, close to something, touching each other); of
what fitted a sphere where furniture was carried in none at four places. Rule of succession."""

NOT_APART = float(np.log(0.02 / 0.83))
"""The same of one that does not."""

WOBBLE = 0.5
"""Standard deviation, in radii, of the place of a sphere that is fitted to what is none, over the
time for which it is: a quarter to eight tenths where people and chairs come into real scenes."""

ENDS = 5
"""First and last detections of a track between which it is seen whether it has moved."""

MOST_OF_MOTION = 8.0
"""Largest evidence of motion, nats: what is no ball moves, too, when it is carried."""


def evidence_of_outline(detection: Detection) -> float:
    """Return the log of the likelihood ratio that the outline of one detection gives, nats.

    What was fitted as a whole, as boxes and capsules are, stands apart.
    """
    outline = detection.outline if isinstance(detection, DetectedSphere) else None
    return APART if outline is None or stands_apart(outline) else NOT_APART


def log_odds(detections: Sequence[Detection]) -> float:
    """Return the log odds that detections of one track are of an object, nats.

    Before anything is seen of it an object is as likely as not. Looks at one thing have their
    errors in common, so they count as one. A part of something larger stays where it is, and its
    fits with it: by d it moves with the log likelihood ratio d² / (2 w² r²), w being `WOBBLE`.

    `detections`: of the track, oldest first, at least one.
    """
    look = float(np.mean([evidence_of_outline(detection) for detection in detections]))
    ends = min(len(detections) // 2, ENDS)
    if ends == 0:
        return look
    first = np.mean([detection.center for detection in detections[:ends]], axis=0)
    last = np.mean([detection.center for detection in detections[-ends:]], axis=0)
    moved = float(np.linalg.norm(last - first)) / (WOBBLE * detections[-1].radius)
    return look + min(0.5 * moved**2, MOST_OF_MOTION)
