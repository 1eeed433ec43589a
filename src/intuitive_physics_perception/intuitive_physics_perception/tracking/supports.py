"""Surfaces on which objects rest, roll and bounce: planes of any slope and faces of static
boxes."""

from __future__ import annotations

from functools import lru_cache
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.geometry.rotations import rotation_matrix
from intuitive_physics.scene import Environment, Plane, StaticBox

MODELS_KEPT = 16
"""Environments whose surfaces are kept: a revision makes one, an episode may still hold another."""

FACE_CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
"""Corners of a face in halves of its two edges, counter-clockwise."""


def faces(box: StaticBox) -> list[Plane]:
    """Return the six faces of a box as planes with an edge, their normals outward."""
    axes, half = rotation_matrix(box.orientation), 0.5 * box.edge_lengths
    planes = []
    for k in range(3):
        for side in (1.0, -1.0):
            normal = side * axes[:, k]
            first, second = (k + 1) % 3, (k + 2) % 3
            # The first edge times the second is the normal.
            across = np.column_stack(
                [side * half[first] * axes[:, first], half[second] * axes[:, second]]
            )
            middle = box.center + half[k] * normal
            planes.append(
                Plane(
                    f"{box.id}/{'+' if side > 0.0 else '-'}{'xyz'[k]}",
                    box.material,
                    normal,
                    float(normal @ middle),
                    middle + FACE_CORNERS @ across.T,
                )
            )
    return planes


class Surfaces:
    """All planes and faces of an environment, together as arrays."""

    def __init__(self, environment: Environment) -> None:
        boxes = [face for box in environment.boxes for face in faces(box)]
        self.planes: tuple[Plane, ...] = (*environment.planes, *boxes)
        self._normals = np.array([plane.normal for plane in self.planes]).reshape(-1, 3)
        self._offsets = np.array([plane.offset for plane in self.planes])
        self._bounded = np.array([plane.boundary is not None for plane in self.planes], dtype=bool)
        self._carrying = self._normals @ environment.gravity < 0.0

    def supporting(
        self, position: NDArray[np.float64], radius: float, tolerance: float
    ) -> list[Plane]:
        """Return what a ball touches within a tolerance and gravity presses it on.

        `position` (3,) m, of its centre; `radius` in m; `tolerance` in m.
        """
        gaps = self._normals @ position - self._offsets - radius
        near = np.flatnonzero((np.abs(gaps) < tolerance) & self._carrying)
        return [self.planes[k] for k in near if self.planes[k].covers(position)]

    def next_contact(
        self,
        state: NDArray[np.float64],
        acceleration: NDArray[np.float64],
        duration: float,
        support: list[Plane],
    ) -> tuple[Plane | None, float]:
        """Return what a ball meets first and when, s; (None, duration) where it meets nothing.

        `state` (7,) position (m), velocity (m/s) and radius (m); `acceleration` (3,) m/s²;
        `duration` in s.
        """
        position, velocity, radius = state[:3], state[3:6], float(state[6])
        gaps = self._normals @ position - self._offsets - radius
        speeds, pulls = self._normals @ velocity, self._normals @ acceleration
        # A ball whose centre is behind an end is below a table, in a box or beyond another face.
        possible = ~(self._bounded & (gaps < -radius))
        possible &= gaps - duration * (np.abs(speeds) + 0.5 * duration * np.abs(pulls)) <= 0.0
        first, until = None, duration
        for k in np.flatnonzero(possible):
            plane = self.planes[k]
            if plane in support:
                continue
            time = falls_to_zero(float(gaps[k]), float(speeds[k]), float(pulls[k]))
            if time < until and plane.covers(
                position + time * (velocity + 0.5 * time * acceleration)
            ):
                first, until = plane, time
        return first, until

    def touches(self, position: NDArray[np.float64], reach: float) -> bool:
        """Return whether a place is nearer to any surface than a distance, or behind it.

        `position` (3,) m; `reach` in m.
        """
        away = self._normals @ position - self._offsets
        return any(
            not self._bounded[k] or bool(self.planes[k].covers(position))
            for k in np.flatnonzero(away < reach)
            if not self._bounded[k] or away[k] > -reach
        )


@lru_cache(maxsize=MODELS_KEPT)
def surfaces_of(environment: Environment) -> Surfaces:
    """Return the surfaces of an environment, found once."""
    return Surfaces(environment)


def time_on(support: Plane, state: NDArray[np.float64], acceleration: NDArray[np.float64]) -> float:
    """Return the time in s until a ball's centre is beyond the edge of what carries it, else inf.

    `state` (7,) position (m), velocity (m/s) and radius (m); `acceleration` (3,) m/s².
    """
    if support.boundary is None:
        return np.inf
    outward = np.cross(np.roll(support.boundary, -1, axis=0) - support.boundary, support.normal)
    outward /= np.linalg.norm(outward, axis=1)[:, None]
    inside = np.einsum("ni,ni->n", outward, support.boundary - state[:3])
    speeds, pulls = outward @ state[3:6], outward @ acceleration
    return min(
        falls_to_zero(max(float(gap), 0.0), -float(speed), -float(pull))
        for gap, speed, pull in zip(inside, speeds, pulls, strict=True)
    )


def falls_to_zero(gap: float, speed: float, pull: float) -> float:
    """Return the first time ≥ 0 at which gap + speed t + pull t² / 2 gets to zero from above; inf
    if never."""
    if gap <= 0.0:
        return 0.0 if speed < 0.0 else np.inf
    if abs(pull) < 1e-9:
        return -gap / speed if speed < 0.0 else np.inf
    root = speed * speed - 2.0 * pull * gap
    if root < 0.0 or (pull > 0.0 and speed >= 0.0):
        return np.inf
    return (-speed - sqrt(root)) / pull


def supported_acceleration(
    gravity: NDArray[np.float64], supports: list[Plane], rolling_inertia: float | None
) -> NDArray[np.float64]:
    """Return the acceleration (3,) in m/s² of what is on some supports, or flies if there are none.

    What rolls down a slope of the angle α gains g sin α / (1 + κ), as the force at its contact
    turns it; what slides without friction gains g sin α.

    `gravity` (3,) m/s²; `rolling_inertia`: κ, moment of inertia over m r² of what rolls; None of
    what slides.
    """
    acceleration = gravity.copy()
    for plane in supports:
        acceleration -= min(float(acceleration @ plane.normal), 0.0) * plane.normal
    if supports and rolling_inertia is not None:
        acceleration /= 1.0 + rolling_inertia
    return acceleration
