"""Tracks prepared for tests of laws of motion: noise, and the gaps to whatever can be touched."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.geometry.gaps import Body, gap_between, gap_to_plane
from intuitive_physics.geometry.rotations import rotation_matrix
from intuitive_physics.observation import Observation, ObservedObject
from intuitive_physics.scene import Environment, StaticBox
from intuitive_physics.shapes import Box, Capsule, Shape, Sphere

UPRIGHT = 0.9
"""Cosine of the angle between a surface's normal and the vertical, from which on the surface
carries what lies on it: 26 degrees."""

NO_TURN = (0.0, 0.0, 0.0, 1.0)
"""Unit quaternion of a sphere, which has no orientation."""


@dataclass(frozen=True, eq=False)
class Track:
    """The n points of one object, with the gaps around it.

    Parameters
    ----------
    times : (n,) s
    positions : (n, 3) m
    whitening : (n, 3, 3) 1/m, makes the error of each point standard normal
    gravity : (3,) m/s²
    support_gaps : (n,) m, from the object's bounding sphere to the nearest surface that carries
    side_gaps : (n,) m, to the nearest thing beside what carries; -infinite where an object was not
        seen
    heights : (n,) m, of the centre above the nearest carrying surface; NaN where beside all of them
    resting_heights : (h,) m, at which the object can rest on a plane
    in_air : whether a force of the air acts on the object
    """

    times: NDArray[np.float64]
    positions: NDArray[np.float64]
    whitening: NDArray[np.float64]
    gravity: NDArray[np.float64]
    support_gaps: NDArray[np.float64]
    side_gaps: NDArray[np.float64]
    heights: NDArray[np.float64]
    resting_heights: NDArray[np.float64]
    in_air: bool

    @cached_property
    def noise(self) -> NDArray[np.float64]:
        """Standard deviation (n,) of a position on one axis, in m, root mean square of the axes."""
        covariances = np.linalg.inv(self.whitening.swapaxes(1, 2) @ self.whitening)
        return np.asarray(np.sqrt(np.trace(covariances, axis1=1, axis2=2) / 3.0))


def track_of(observation: Observation, number: int, whitening: NDArray[np.float64]) -> Track:
    """Prepare the track of an observation's object of that number; `whitening` (n, 3, 3) 1/m."""
    observed = observation.objects[number]
    times, positions = observed.trajectory.times, observed.trajectory.positions
    radius = observed.object.shape.bounding_radius
    gravity = observation.environment.gravity
    support, sides, heights = _environment_gaps(observation.environment, radius, positions)
    for other in observation.objects[:number] + observation.objects[number + 1 :]:
        reach = radius + other.object.shape.bounding_radius
        sides = np.minimum(sides, _distances(other, times, positions) - reach)
    return Track(
        times,
        positions,
        whitening,
        gravity,
        support,
        sides,
        heights,
        _resting_heights(observed.object.shape),
        observed.object.has_air_forces,
    )


def _environment_gaps(
    environment: Environment, radius: float, positions: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return gaps (n,) to what carries and to what does not, and heights (n,), all in m."""
    gravity = environment.gravity
    up = -gravity / max(float(np.linalg.norm(gravity)), np.finfo(float).tiny)
    body = Body(Sphere(radius), positions, np.array(NO_TURN))
    support, sides = np.full((2, len(positions)), np.inf)
    heights = np.full(len(positions), np.inf)
    for plane in environment.planes:
        gaps = gap_to_plane(body, plane)
        if plane.normal @ up < UPRIGHT:
            sides = np.minimum(sides, gaps)
            continue
        support = np.minimum(support, gaps)
        distances = plane.signed_distances(positions)
        above = plane.covers(positions) & (distances > 0.0)
        heights = np.where(above, np.minimum(heights, distances), heights)
    for box in environment.boxes:
        x, y, z = box.edge_lengths.tolist()
        gaps = gap_between(body, Body(Box((x, y, z)), box.center, box.orientation))
        distances = _heights_above(box, up, positions)
        above = np.isfinite(distances)
        support = np.where(above, np.minimum(support, gaps), support)
        sides = np.where(above, sides, np.minimum(sides, gaps))
        heights = np.where(above, np.minimum(heights, distances), heights)
    return support, sides, np.where(np.isfinite(heights), heights, np.nan)


def _heights_above(
    box: StaticBox, up: NDArray[np.float64], positions: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return heights (n,), in m, above a level face of a box; infinite where beside it."""
    axes = rotation_matrix(box.orientation)
    local = (positions - box.center) @ axes
    axis = int(np.argmax(np.abs(up @ axes)))
    side = float(np.sign(up @ axes[:, axis]))
    halves = 0.5 * box.edge_lengths
    others = [k for k in range(3) if k != axis]
    distances = side * local[:, axis] - halves[axis]
    above = (np.abs(local[:, others]) <= halves[others]).all(axis=1) & (distances > 0.0)
    level = abs(up @ axes[:, axis]) >= UPRIGHT
    return np.where(above & level, distances, np.inf)


def _resting_heights(shape: Shape) -> NDArray[np.float64]:
    match shape:
        case Box():
            return 0.5 * np.asarray(shape.edge_lengths)
        case Capsule():
            return np.array([shape.radius, shape.radius + 0.5 * shape.length])
        case Sphere():
            return np.array([shape.radius])
    raise InvalidInputError(f"shape is {shape!r}; expected a Sphere, Box or Capsule")


def _distances(
    other: ObservedObject, times: NDArray[np.float64], positions: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the distances (n,), in m, to another object; -infinite where it was not seen."""
    track = other.trajectory
    places = np.stack(
        [np.interp(times, track.times, track.positions[:, k]) for k in range(3)], axis=1
    )
    unseen = (times < track.times[0]) | (times > track.times[-1])
    return np.where(unseen, -np.inf, np.linalg.norm(positions - places, axis=1))
