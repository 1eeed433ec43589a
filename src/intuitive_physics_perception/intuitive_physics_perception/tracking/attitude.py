"""How objects turn: a filter on rotation, angular velocity and dimensions of a box or capsule; the
angular velocity of a ball, known where it rolls."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation

from intuitive_physics.shapes import Box, Capsule
from intuitive_physics.state import (
    ANGULAR_VELOCITY,
    ERROR_SIZE,
    LINEAR_VELOCITY,
    POSITION,
    ROTATION,
    ObjectState,
)
from intuitive_physics_perception.detection.detections import DetectedSolid
from intuitive_physics_perception.tracking.motion import GATE, corrected, white_acceleration
from intuitive_physics_perception.tracking.motion_fits import SeenPath, fitted_acceleration

ANGULAR_ACCELERATION_NOISE = 20.0
"""Standard deviation of what changes an angular velocity, over 1/30 s, rad/s²: torques of contacts,
precession."""

NAMING_ANGLE = 0.2
"""Angle that counts as much as `NAMING_LENGTH`, rad."""

NAMING_LENGTH = 0.02
"""Difference of edges that counts as much as `NAMING_ANGLE` where two ways to name a box's edges
are compared, m."""

ROLLING_TIME = 0.2
"""Time on a surface without losing speed to friction after which a ball rolls, s: one that slides
at μ = 0.1 is 5 mm behind by then, and rolls itself 2 v / 7 μ g after it began."""

ROLLING_DECELERATION = 0.6
"""Difference from the acceleration of rolling, m/s²: more than rolling resistance and another κ
make, less than sliding friction makes; half of it must be visible."""

ROLLING_SIGMAS = 2.0
"""Standard deviations of that difference by which noise may exceed it."""

ROLLING_SLIP = 0.1
"""Standard deviation of the slip of a rolling ball, as a part of its speed."""

ENOUGH = 0.7
"""Part of a time that points of it must span, as frames do not begin and end with it."""

LONGER = 1.3
"""Factor from one time that is tried to the next longer one: noise falls by half."""

ROTATION_PART, VELOCITY_PART = slice(0, 3), slice(3, 6)
"""Places of rotation vector (rad) and angular velocity (rad/s) in an attitude's covariance."""


@dataclass(frozen=True, eq=False)
class Attitude:
    """Estimate of a solid's rotation at one time.

    Parameters
    ----------
    rotation : (3, 3), body to environment
    angular_velocity : (3,) rad/s, in the environment's frame
    covariance : (6, 6) of a rotation vector in the environment's frame, and of the
        angular velocity
    shape : with the dimensions averaged so far
    count : frames that the average was taken of
    """

    rotation: NDArray[np.float64]
    angular_velocity: NDArray[np.float64]
    covariance: NDArray[np.float64]
    shape: Box | Capsule
    count: int = 1

    @staticmethod
    def of(solid: DetectedSolid, velocity_deviation: float) -> Attitude:
        """Return the attitude that one frame shows, the angular velocity unknown.

        `solid`: in the environment's frame; `velocity_deviation`: standard deviation of an unknown
        angular velocity, rad/s.
        """
        covariance = block_diag(solid.rotation_covariance, velocity_deviation**2 * np.eye(3))
        return Attitude(solid.rotation, np.zeros(3), covariance, solid.shape)

    def after(self, duration: float) -> Attitude:
        """Return it `duration` s later, or earlier if that is negative."""
        transition = np.eye(6)
        transition[ROTATION_PART, VELOCITY_PART] = duration * np.eye(3)
        added = np.kron(white_acceleration(duration, ANGULAR_ACCELERATION_NOISE), np.eye(3))
        return replace(
            self,
            rotation=Rotation.from_rotvec(duration * self.angular_velocity).as_matrix()
            @ self.rotation,
            covariance=transition @ self.covariance @ transition.T + added,
        )

    def stopped(self, velocity_deviation: float) -> Attitude:
        """Return it at rest."""
        rotation_covariance = self.covariance[ROTATION_PART, ROTATION_PART]
        covariance = block_diag(rotation_covariance, velocity_deviation**2 * np.eye(3))
        return replace(self, angular_velocity=np.zeros(3), covariance=covariance)

    def corrected(self, solid: DetectedSolid, velocity_deviation: float) -> Attitude:
        """Return it corrected by a detection in the environment's frame.

        A box looks the same when its axes are named otherwise, a capsule however it turned about
        its axis: the rotation nearest to what was expected is meant.
        """
        turned, lengths = self._nearest(solid)
        innovation = Rotation.from_matrix(turned @ self.rotation.T).as_rotvec()
        covariance = self.covariance
        spread = covariance[ROTATION_PART, ROTATION_PART] + solid.rotation_covariance
        if innovation @ np.linalg.solve(spread, innovation) > GATE:
            # An impact turned it another way: the estimate of its angular velocity is void.
            covariance = covariance.copy()
            covariance[ROTATION_PART, ROTATION_PART] += np.outer(innovation, innovation)
            covariance[VELOCITY_PART, VELOCITY_PART] += velocity_deviation**2 * np.eye(3)
        change, covariance = corrected(
            np.zeros(6), covariance, np.arange(3), innovation, solid.rotation_covariance
        )
        return Attitude(
            Rotation.from_rotvec(change[ROTATION_PART]).as_matrix() @ self.rotation,
            self.angular_velocity + change[VELOCITY_PART],
            covariance,
            self._averaged(lengths),
            self.count + 1,
        )

    def reach(self, direction: NDArray[np.float64]) -> float:
        """Return the extent in m from the centre along `direction` (3,), a unit vector."""
        local = self.rotation.T @ direction
        if isinstance(self.shape, Box):
            return 0.5 * float(np.abs(local) @ self.shape.edge_lengths)
        return self.shape.radius + 0.5 * self.shape.length * abs(float(local[2]))

    def _nearest(self, solid: DetectedSolid) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The rotation (3, 3) and the dimensions of a detection, named as they are here."""
        lengths = _lengths(solid.shape)
        if isinstance(solid.shape, Capsule):
            axis, axis_now = self.rotation[:, 2], solid.rotation[:, 2]
            axis_now = axis_now if axis_now @ axis >= 0.0 else -axis_now
            # The shortest rotation between them; their angle is below a right one.
            sine = np.cross(axis, axis_now)
            angle = np.arctan2(np.linalg.norm(sine), axis_now @ axis)
            turn = Rotation.from_rotvec(sine / np.sinc(angle / np.pi))
            return turn.as_matrix() @ self.rotation, lengths
        present = _lengths(self.shape)
        best, nearest = np.inf, (solid.rotation, lengths)
        for naming in BOX_NAMINGS:
            turned, named = solid.rotation @ naming, np.abs(naming).T @ lengths
            cosine = 0.5 * (float((turned * self.rotation).sum()) - 1.0)
            angle = np.arccos(np.clip(cosine, -1.0, 1.0)) / NAMING_ANGLE
            away = angle**2 + float(np.square((named - present) / NAMING_LENGTH).sum())
            if away < best:
                best, nearest = away, (turned, named)
        return nearest

    def _averaged(self, lengths: NDArray[np.float64]) -> Box | Capsule:
        mean = _lengths(self.shape) + (lengths - _lengths(self.shape)) / (self.count + 1)
        if isinstance(self.shape, Box):
            return Box((float(mean[0]), float(mean[1]), float(mean[2])))
        return Capsule(float(mean[0]), float(mean[1]))


def object_state(
    motion: NDArray[np.float64],
    covariance: NDArray[np.float64],
    turning: Attitude | tuple[NDArray[np.float64], NDArray[np.float64]],
) -> ObjectState:
    """Return θ_d.

    `motion` (6,) position in m and velocity in m/s with `covariance` (6, 6); `turning` (3,) rad/s
    and (3, 3), angular velocity of a ball with its covariance, or attitude of a box or capsule.
    """
    whole = np.zeros((ERROR_SIZE, ERROR_SIZE))
    places = np.r_[POSITION, LINEAR_VELOCITY]
    whole[np.ix_(places, places)] = covariance
    orientation: ArrayLike = (0.0, 0.0, 0.0, 1.0)
    if isinstance(turning, Attitude):
        places = np.r_[ROTATION, ANGULAR_VELOCITY]
        whole[np.ix_(places, places)] = turning.covariance
        orientation = Rotation.from_matrix(turning.rotation).as_quat()
        angular_velocity = turning.angular_velocity
    else:
        angular_velocity, whole[ANGULAR_VELOCITY, ANGULAR_VELOCITY] = turning
    return ObjectState(motion[:3], orientation, motion[3:6], angular_velocity, whole)


def _lengths(shape: Box | Capsule) -> NDArray[np.float64]:
    if isinstance(shape, Box):
        return np.array(shape.edge_lengths)
    return np.array([shape.radius, shape.length])


BOX_NAMINGS = Rotation.create_group("O").as_matrix().round()
"""The 24 rotations (3, 3) that carry a box's axes onto one another."""


def unknown_angular_velocity(deviation: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return mean (3,) rad/s and covariance (3, 3) of an unknown angular velocity."""
    return np.zeros(3), deviation**2 * np.eye(3)


def rolling_angular_velocity(
    velocity: NDArray[np.float64],
    covariance: NDArray[np.float64],
    radius: float,
    normal: NDArray[np.float64],
    deviation: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return mean (3,) rad/s and covariance (3, 3) of the angular velocity of a rolling ball.

    The point of contact stands still, v - r ω × n = 0, so ω = n × v / r; the component along the
    normal stays unknown.

    `velocity` (3,) m/s; `radius` in m; `normal` (3,) unit vector of the plane; `deviation` in
    rad/s, standard deviation of an unknown angular velocity.
    """
    turn = np.cross(normal, np.eye(3)).T / radius
    slip = ROLLING_SLIP * float(np.linalg.norm(velocity)) / radius
    along = np.outer(normal, normal)
    spread = turn @ covariance @ turn.T + slip**2 * (np.eye(3) - along) + deviation**2 * along
    return turn @ velocity, spread


def rolls(path: SeenPath, expected: NDArray[np.float64]) -> bool:
    """Return whether an object on a surface rolls and does not slide.

    The shortest time up to the last point is taken in which friction would be visible.

    `path`: on the surface; `expected` (3,) m/s² of rolling there.
    """
    times = path.times
    limit, duration = ROLLING_DECELERATION, ENOUGH * ROLLING_TIME
    if len(times) < 3 or times[-1] - times[0] < duration:
        return False
    while True:
        before = int(np.searchsorted(times, times[-1] - duration, side="right")) - 1
        first = max(0, min(before, len(times) - 3))
        fitted, spread, _ = fitted_acceleration(path[first:])
        deviation = float(np.sqrt(np.linalg.eigvalsh(spread)[-1]))
        if deviation < 0.5 * limit or first == 0:
            off = float(np.linalg.norm(fitted - expected))
            return off < limit + ROLLING_SIGMAS * deviation
        duration *= LONGER
