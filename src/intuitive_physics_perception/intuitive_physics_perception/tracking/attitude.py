"""How a box or capsule lies, turns, and how large it is: a filter on rotations."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from intuitive_physics.shapes import Box, Capsule
from intuitive_physics.state import ANGULAR_VELOCITY, ROTATION, ObjectState
from intuitive_physics_perception.detection.detections import DetectedSolid

TURN, SPIN = slice(0, 3), slice(3, 6)
SPIN_NOISE = 20.0
"""rad/s², standard deviation of what changes a spin: torques of contacts, and precession."""

GATE = 25.0
ANGLE_SCALE, LENGTH_SCALE = 0.2, 0.02
"""rad and m, by which two ways to name a box's edges are compared."""


@dataclass(frozen=True, eq=False)
class Attitude:
    """What is believed of a solid's rotation at one time.

    Parameters
    ----------
    rotation : (3, 3), body to environment
    spin : (3,) rad/s, in the environment's frame
    covariance : (6, 6) of a rotation vector in the environment's frame, and of the spin
    shape : with the dimensions averaged so far
    count : frames that the average was taken of
    """

    rotation: NDArray[np.float64]
    spin: NDArray[np.float64]
    covariance: NDArray[np.float64]
    shape: Box | Capsule
    count: int = 1

    @staticmethod
    def of(solid: DetectedSolid, spin_deviation: float) -> Attitude:
        """Return what one frame tells, in the environment's frame; of the spin that is nothing."""
        covariance = np.zeros((6, 6))
        covariance[TURN, TURN] = solid.rotation_covariance
        covariance[SPIN, SPIN] = spin_deviation**2 * np.eye(3)
        return Attitude(solid.rotation, np.zeros(3), covariance, solid.shape)

    def after(self, duration: float) -> Attitude:
        """Return it `duration` s later, or earlier if that is negative."""
        transition = np.eye(6)
        transition[TURN, SPIN] = duration * np.eye(3)
        gain = np.vstack([0.5 * duration**2 * np.eye(3), duration * np.eye(3)])
        return replace(
            self,
            rotation=Rotation.from_rotvec(duration * self.spin).as_matrix() @ self.rotation,
            covariance=transition @ self.covariance @ transition.T + SPIN_NOISE**2 * gain @ gain.T,
        )

    def stopped(self, spin_deviation: float) -> Attitude:
        """Return it at rest."""
        covariance = np.zeros((6, 6))
        covariance[TURN, TURN] = self.covariance[TURN, TURN]
        covariance[SPIN, SPIN] = spin_deviation**2 * np.eye(3)
        return replace(self, spin=np.zeros(3), covariance=covariance)

    def corrected(self, solid: DetectedSolid, spin_deviation: float) -> Attitude:
        """Return it once a frame, in the environment's frame, was taken into account.

        A box looks the same when its axes are named otherwise, a capsule however it turned about
        its axis: the rotation nearest to what was expected is meant.
        """
        turned, lengths = self._nearest(solid)
        innovation = Rotation.from_matrix(turned @ self.rotation.T).as_rotvec()
        covariance = self.covariance
        spread = covariance[TURN, TURN] + solid.rotation_covariance
        if innovation @ np.linalg.solve(spread, innovation) > GATE:
            # An impact turned it another way: what was believed of its spin is void.
            covariance = covariance.copy()
            covariance[TURN, TURN] += np.outer(innovation, innovation)
            covariance[SPIN, SPIN] += spin_deviation**2 * np.eye(3)
            spread = covariance[TURN, TURN] + solid.rotation_covariance
        gain = np.linalg.solve(spread, covariance[TURN]).T
        change = gain @ innovation
        keep = np.eye(6)
        keep[:, TURN] -= gain
        return Attitude(
            Rotation.from_rotvec(change[TURN]).as_matrix() @ self.rotation,
            self.spin + change[SPIN],
            keep @ covariance @ keep.T + gain @ solid.rotation_covariance @ gain.T,
            self._averaged(lengths),
            self.count + 1,
        )

    def reach(self, direction: NDArray[np.float64]) -> float:
        """m from the centre to the farthest point in a direction (3,), a unit vector."""
        own = self.rotation.T @ direction
        if isinstance(self.shape, Box):
            return 0.5 * float(np.abs(own) @ self.shape.edge_lengths)
        return self.shape.radius + 0.5 * self.shape.length * abs(float(own[2]))

    def _nearest(self, solid: DetectedSolid) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The rotation (3, 3) and the dimensions of a detection, named as they are here."""
        lengths = _lengths(solid.shape)
        if isinstance(solid.shape, Capsule):
            axis, seen = self.rotation[:, 2], solid.rotation[:, 2]
            seen = seen if seen @ axis >= 0.0 else -seen
            return Rotation.align_vectors([seen], [axis])[0].as_matrix() @ self.rotation, lengths
        own = _lengths(self.shape)
        best, nearest = np.inf, (solid.rotation, lengths)
        for naming in BOX_NAMINGS:
            turned, named = solid.rotation @ naming, np.abs(naming).T @ lengths
            cosine = 0.5 * (float((turned * self.rotation).sum()) - 1.0)
            angle = np.arccos(np.clip(cosine, -1.0, 1.0)) / ANGLE_SCALE
            away = angle**2 + float(np.square((named - own) / LENGTH_SCALE).sum())
            if away < best:
                best, nearest = away, (turned, named)
        return nearest

    def _averaged(self, lengths: NDArray[np.float64]) -> Box | Capsule:
        mean = _lengths(self.shape) + (lengths - _lengths(self.shape)) / (self.count + 1)
        if isinstance(self.shape, Box):
            return Box((float(mean[0]), float(mean[1]), float(mean[2])))
        return Capsule(float(mean[0]), float(mean[1]))


def with_attitude(
    position: NDArray[np.float64],
    velocity: NDArray[np.float64],
    covariance: NDArray[np.float64],
    attitude: Attitude,
) -> ObjectState:
    """Return θ_d of a solid from its translation and its attitude.

    Parameters
    ----------
    covariance : (12, 12) of which the parts of rotation and spin are filled in
    """
    whole = covariance.copy()
    own = ((ROTATION, TURN), (ANGULAR_VELOCITY, SPIN))
    for rows, own_rows in own:
        for columns, own_columns in own:
            whole[rows, columns] = attitude.covariance[own_rows, own_columns]
    return ObjectState(
        position, Rotation.from_matrix(attitude.rotation).as_quat(), velocity, attitude.spin, whole
    )


def _lengths(shape: Box | Capsule) -> NDArray[np.float64]:
    if isinstance(shape, Box):
        return np.array(shape.edge_lengths)
    return np.array([shape.radius, shape.length])


def _box_namings() -> list[NDArray[np.float64]]:
    """The 24 rotations (3, 3) that carry a box's axes onto one another."""
    found = []
    for order in permutations(range(3)):
        for signs in product((-1.0, 1.0), repeat=3):
            naming = np.eye(3)[:, order] * signs
            if np.linalg.det(naming) > 0.0:
                found.append(naming)
    return found


BOX_NAMINGS = _box_namings()
