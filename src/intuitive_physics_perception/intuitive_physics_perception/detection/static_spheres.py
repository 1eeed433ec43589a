"""Places that stand still and looked like a sphere, and how often they did."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import betaln

from intuitive_physics.frames.change_of_frame import RigidTransform
from intuitive_physics_perception.detection.detections import DetectedSphere

BALL_HITS = 49.0
"""Looks in which a ball counts as found before its first one, against one in vain: its chance has
the mean 0.98, as that of a ball to stand apart (`APART` in `existence`)."""

DISTRUST_FRAMES = 300
"""Frames for which a place that failed counts as no ball. Then it begins as one where something was
missed: a hand may have hidden a part of a ball. Set by hand."""


def evidence_of_looks(hits: int, misses: int) -> float:
    """Return the log of the likelihood ratio, nats, that something is a ball which was found to be
    a sphere in some looks and in others not.

    A ball is found with a chance p near one, of density k pᵏ⁻¹, k being `BALL_HITS`; what is none
    with any chance.
    """
    ball = betaln(BALL_HITS + hits, 1.0 + misses) - betaln(BALL_HITS, 1.0)
    return float(ball - betaln(1.0 + hits, 1.0 + misses))


@dataclass(eq=False)
class StaticSphere:
    """A place where a sphere was found.

    Parameters
    ----------
    sphere : (4,) m, centre and radius as found first, in the frame that stands still
    misses, hits : looks in which no sphere was found there, and in which one was
    distrusted : frames for which it still counts as no ball
    """

    sphere: NDArray[np.float64]
    misses: int
    hits: int = 1
    distrusted: int = 0

    def take(self, *, looked: bool, hit: bool) -> None:
        """Count a frame."""
        if self.distrusted:
            self.distrusted -= 1
            return
        was_trusted = self.is_trusted
        self.hits += hit
        self.misses += looked and not hit
        if was_trusted and not self.is_trusted:
            self.misses, self.hits, self.distrusted = 1, 0, DISTRUST_FRAMES

    @property
    def is_trusted(self) -> bool:
        """Whether it is more likely a ball than not."""
        return not self.distrusted and evidence_of_looks(self.hits, self.misses) > 0.0


class StaticSpheres:
    """Knows the places where something that stands still was found to be a sphere.

    A part of something larger may fit one in every other frame: where it was taken for an object,
    the next frame separates it from the rest, and it fits no more. So what is found first where an
    earlier frame has shown something already was missed there.
    """

    def __init__(self) -> None:
        self._pose = RigidTransform()
        self._places: list[StaticSphere] = []
        self._has_looked = False

    def look_from(self, pose: RigidTransform) -> None:
        """Take the pose of the sensor in a frame that stands still."""
        self._pose = pose

    @property
    def spheres(self) -> NDArray[np.float64]:
        """The sphere (n, 4) m of each place, in the sensor's frame."""
        if not self._places:
            return np.zeros((0, 4))
        spheres = np.array([place.sphere for place in self._places])
        return np.column_stack([self._pose.inverse.points(spheres[:, :3]), spheres[:, 3]])

    def take(self, looked: NDArray[np.bool_], spheres: Sequence[DetectedSphere]) -> None:
        """Count a frame.

        `looked` (n,) which of the places were searched; `spheres`: all that were found.
        """
        found = [self._place_of(sphere) for sphere in spheres]
        for place, was_searched in zip(self._places, looked, strict=True):
            hit = any(other is place for other in found)
            place.take(looked=hit or bool(was_searched), hit=hit)
        for sphere, known_place in zip(spheres, found, strict=True):
            outline = sphere.outline
            if known_place is None and outline is not None and outline.has_not_come:
                numbers = np.append(self._pose.points(sphere.center), sphere.radius)
                was_missed = self._has_looked and outline.was_there
                self._places.append(StaticSphere(numbers, int(was_missed)))
        self._has_looked = True

    def is_trusted(self, sphere: DetectedSphere) -> bool:
        """Return whether a sphere of the last frame may be a ball."""
        place = self._place_of(sphere)
        return place is None or place.is_trusted

    def _place_of(self, sphere: DetectedSphere) -> StaticSphere | None:
        """The place that a sphere's centre lies in."""
        center = self._pose.points(sphere.center)
        inside = (
            place
            for place in self._places
            if np.linalg.norm(center - place.sphere[:3]) < place.sphere[3]
        )
        return next(inside, None)
