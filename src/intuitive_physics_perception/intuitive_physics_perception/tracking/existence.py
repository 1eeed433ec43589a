"""Whether a track is an object of its own: log odds, summed over what speaks for and against it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from intuitive_physics_perception.detection.detections import DetectedSphere, Detection

APART = float(np.log(0.98 / 0.17))
"""Log of the likelihood ratio of a sphere that stands apart, in nats: of balls that were rendered
into the real scenes for tuning 254 of 258 did (free, close to something, touching each other); of
what fitted a sphere where furniture was carried in none at four places. Rule of succession."""

NOT_APART = float(np.log(0.02 / 0.83))
"""The same of one that does not."""

ROUND = 0.05
"""Part of what is no ball, but fits a sphere, that is as round as one; and as frequent are balls.
Chosen: one in twenty."""

BALL_BULGE = 0.1
"""Standard deviation of each coefficient of a ball's `Bulge`: what edges that grow and noise that
is not quite as modelled make of it."""

ANY_BULGE = 0.5
"""The same of any smooth surface: a flat one is one standard deviation off."""

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
    return APART if outline is None or outline.stands_apart else NOT_APART


def evidence_of_shape(detections: Sequence[Detection]) -> float:
    """Return the log of the likelihood ratio that the shape gives which the detections of one track
    show together, nats.

    That of a ball and of any smooth surface is, with the mean c and the covariance C of all
    coefficients of their bulges, N(c; 0, C + β² I) / N(c; 0, C + α² I): about one where noise hides
    the shape. Some of what is no ball is round, so there is evidence against balls only.
    """
    bulges = [
        detection.outline.bulge
        for detection in detections
        if isinstance(detection, DetectedSphere) and detection.outline is not None
    ]
    if not bulges:
        return 0.0
    covariance = np.linalg.inv(sum(bulge.information for bulge in bulges))
    mean = covariance @ sum(bulge.information @ bulge.coefficients for bulge in bulges)
    ball, other = (covariance + width**2 * np.eye(3) for width in (BALL_BULGE, ANY_BULGE))
    widths = np.linalg.slogdet(other)[1] - np.linalg.slogdet(ball)[1]
    misfit = mean @ (np.linalg.inv(ball) - np.linalg.inv(other)) @ mean
    return -float(np.log1p((1.0 / ROUND - 1.0) * np.exp(0.5 * (misfit - widths))))


def evidence_of_company(balls: int, others: int) -> float:
    """Return the log of the odds that something new is a ball where so many others are new in the
    same frame, nats; at most zero.

    `balls`: of them, those that are more likely balls than not; `others`: the rest. Rule of
    succession: where furniture is carried in, few of many new things are balls.
    """
    return min(float(np.log((1.0 + balls) / (1.0 + others))), 0.0)


def log_odds(detections: Sequence[Detection]) -> float:
    """Return the log odds that detections of one track are of an object, nats.

    What has the shape of a ball is as likely one as not before its outline is seen. Looks at one
    thing have their errors in common, so their outlines count as one. A part of something larger
    stays where it is, and its fits with it: by d it moves with the log likelihood ratio
    d² / (2 w² r²), w being `WOBBLE`. What is seen once here and then there may be two things, so
    the longest step is no motion.

    `detections`: of the track, oldest first, at least one.
    """
    look = float(np.mean([evidence_of_outline(detection) for detection in detections]))
    look += evidence_of_shape(detections)
    ends = min(len(detections) // 2, ENDS)
    if ends == 0:
        return look
    places = np.array([detection.center for detection in detections])
    way = float(np.linalg.norm(places[-ends:].mean(axis=0) - places[:ends].mean(axis=0)))
    longest = float(np.linalg.norm(np.diff(places, axis=0), axis=1).max())
    moved = max(way - longest, 0.0) / (WOBBLE * detections[-1].radius)
    return look + min(0.5 * moved**2, MOST_OF_MOTION)
