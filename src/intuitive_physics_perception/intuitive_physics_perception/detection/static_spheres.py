"""Places where what was there from the start looked like a sphere, and how often it did."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.frames.change_of_frame import RigidTransform
from intuitive_physics_perception.detection.detections import DetectedSphere

STATIC_SUCCESSES = 0.8
"""Part of the searches in which what was there when the environment was modelled must be found to
be a sphere; a ball is one in nearly all of them."""

FEWEST_LOOKS = 5
"""Searches of a place after which it is judged. Set by hand."""

DISTRUST_FRAMES = 300
"""Frames for which a place that failed counts as no ball. Then its counts start again: a hand may
have hidden a part of a ball. Set by hand."""


@dataclass(eq=False)
class StaticSphere:
    """A place where a sphere was found.

    Parameters
    ----------
    sphere : (4,) m, centre and radius as found first, in the frame that stands still
    looks, hits : in how many frames it was searched, and in how many a sphere was found there
    distrusted : frames for which it still counts as no ball
    """

    sphere: NDArray[np.float64]
    looks: int = 0
    hits: int = 0
    distrusted: int = 0

    def take(self, *, looked: bool, hit: bool) -> None:
        """Count a frame."""
        if self.distrusted:
            self.distrusted -= 1
            return
        self.looks += looked
        self.hits += hit
        if self.looks >= FEWEST_LOOKS and self.hits < STATIC_SUCCESSES * self.looks:
            self.looks, self.hits, self.distrusted = 0, 0, DISTRUST_FRAMES


class StaticSpheres:
    """Knows the places where something that was there from the start was found to be a sphere.

    A part of something larger may fit one in every other frame: where it was taken for an object,
    the next frame separates it from the rest, and it fits no more.
    """

    def __init__(self) -> None:
        self._pose = RigidTransform()
        self._places: list[StaticSphere] = []

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

    def is_trusted(self, sphere: DetectedSphere) -> bool:
        """Return whether a sphere that was there from the start may be a ball."""
        place = self._place_of(sphere)
        if place is None:
            place = StaticSphere(np.append(self._pose.points(sphere.center), sphere.radius), 1, 1)
            self._places.append(place)
        return place.distrusted == 0

    def _place_of(self, sphere: DetectedSphere) -> StaticSphere | None:
        """The place that a sphere's centre lies in."""
        center = self._pose.points(sphere.center)
        inside = (
            place
            for place in self._places
            if np.linalg.norm(center - place.sphere[:3]) < place.sphere[3]
        )
        return next(inside, None)
