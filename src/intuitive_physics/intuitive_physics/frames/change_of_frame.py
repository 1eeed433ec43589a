"""The transform between two frames, and environments, states and observations in another frame.

Nothing but the frame changes.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.geometry.rotations import quaternion_product, rotation_matrix
from intuitive_physics.observation import Detections, Observation, ObservedObject, SeenSpin
from intuitive_physics.scene import Environment, Plane, StaticBox
from intuitive_physics.state import ObjectState
from intuitive_physics.trajectory import Trajectory
from intuitive_physics.validation import finite_array, set_fields, unit_quaternion

CONJUGATE = np.array([-1.0, -1.0, -1.0, 1.0])
"""Turns a unit quaternion (x, y, z, w) into that of the inverse rotation."""


@dataclass(frozen=True, eq=False)
class RigidTransform:
    """Rotation and shift from one frame into another: p' = R(q) p + t.

    Parameters
    ----------
    translation : (3,) m, the old frame's origin in the new frame
    orientation : (4,) unit quaternion (x, y, z, w) of the old frame in the new frame
    """

    translation: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))
    orientation: NDArray[np.float64] = field(default_factory=lambda: np.array([0.0, 0.0, 0.0, 1.0]))

    def __init__(
        self,
        translation: ArrayLike = (0.0, 0.0, 0.0),
        orientation: ArrayLike = (0.0, 0.0, 0.0, 1.0),
    ) -> None:
        set_fields(
            self,
            translation=finite_array(translation, "translation of a frame", (3,)),
            orientation=unit_quaternion(orientation, "orientation of a frame"),
        )

    @property
    def matrix(self) -> NDArray[np.float64]:
        """(3, 3) rotation matrix."""
        return rotation_matrix(self.orientation)

    @property
    def inverse(self) -> RigidTransform:
        """The way back."""
        turn = self.orientation * CONJUGATE
        return RigidTransform(-rotation_matrix(turn) @ self.translation, turn)

    def after(self, first: RigidTransform) -> RigidTransform:
        """Return the transform that does `first`, and then this one."""
        return RigidTransform(self.points(first.translation), self.orientations(first.orientation))

    def points(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return points (…, 3) m in the new frame."""
        return self.directions(points) + self.translation

    def directions(self, vectors: ArrayLike) -> NDArray[np.float64]:
        """Return vectors (…, 3) that have no place, such as velocities, in the new frame."""
        return np.asarray(vectors, dtype=np.float64) @ self.matrix.T

    def orientations(self, quaternions: ArrayLike) -> NDArray[np.float64]:
        """Return orientations (…, 4), as `quaternions` (…, 4) x, y, z, w, in the new frame."""
        return quaternion_product(self.orientation, quaternions)

    def covariances(self, matrices: ArrayLike) -> NDArray[np.float64]:
        """Return covariances (…, 3n, 3n) of n stacked vectors in the new frame.

        Parameters
        ----------
        matrices : (…, 3n, 3n) in the old frame's axes, such as those of `ObjectState`, whose
            rotation vectors are in the frame's axes too
        """
        given = np.asarray(matrices, dtype=np.float64)
        turn = np.kron(np.eye(given.shape[-1] // 3), self.matrix)
        turned = turn @ given @ turn.T
        return 0.5 * (turned + np.swapaxes(turned, -1, -2))

    def difference(self, other: RigidTransform) -> tuple[float, float]:
        """Return how far another transform is from this one: shift in m, and angle in rad."""
        between = quaternion_product(self.orientation * CONJUGATE, other.orientation)
        angle = 2.0 * np.arctan2(np.linalg.norm(between[:3]), abs(between[3]))
        return float(np.linalg.norm(other.translation - self.translation)), float(angle)


def environment_in(
    environment: Environment, frame_id: str, transform: RigidTransform
) -> Environment:
    """Return an environment in another frame.

    Parameters
    ----------
    frame_id : name of the other frame
    transform : from the environment's frame to the other one
    """
    return Environment(
        [_plane(plane, transform) for plane in environment.planes],
        [_box(box, transform) for box in environment.boxes],
        transform.directions(environment.gravity),
        frame_id,
        environment.air_density,
    )


def state_in(state: ObjectState, transform: RigidTransform) -> ObjectState:
    """Return a state in another frame.

    Parameters
    ----------
    transform : from the state's frame to the other one, which do not move against each other
    """
    return ObjectState(
        transform.points(state.position),
        transform.orientations(state.orientation),
        transform.directions(state.linear_velocity),
        transform.directions(state.angular_velocity),
        transform.covariances(state.covariance),
    )


def observation_in(
    observation: Observation, frame_id: str, transform: RigidTransform
) -> Observation:
    """Return an observation in another frame, whose id is that of its new content.

    Parameters
    ----------
    frame_id : name of the other frame
    transform : from the observation's frame to the other one
    """
    return Observation(
        environment_in(observation.environment, frame_id, transform),
        tuple(_observed(item, transform) for item in observation.objects),
        observation.start_time,
    )


def detections_in(detections: Detections, transform: RigidTransform) -> Detections:
    """Return detections in another frame."""
    return Detections(
        detections.times,
        transform.points(detections.positions),
        transform.covariances(detections.covariances),
        transform.covariances(detections.bias),
        None if detections.spin is None else _spin(detections.spin, transform),
    )


def _spin(spin: SeenSpin, transform: RigidTransform) -> SeenSpin:
    return SeenSpin(
        transform.directions(spin.mean), transform.covariances(spin.covariance), spin.since
    )


def _plane(plane: Plane, transform: RigidTransform) -> Plane:
    normal = transform.directions(plane.normal)
    offset = plane.offset + float(normal @ transform.translation)
    boundary = None if plane.boundary is None else transform.points(plane.boundary)
    return Plane(plane.id, plane.material, normal, offset, boundary)


def _box(box: StaticBox, transform: RigidTransform) -> StaticBox:
    return StaticBox(
        box.id,
        box.material,
        transform.points(box.center),
        transform.orientations(box.orientation),
        box.edge_lengths,
    )


def _observed(item: ObservedObject, transform: RigidTransform) -> ObservedObject:
    trajectory, detections = item.trajectory, item.detections
    return replace(
        item,
        trajectory=Trajectory(trajectory.times, transform.points(trajectory.positions)),
        initial_state=state_in(item.initial_state, transform),
        detections=None if detections is None else detections_in(detections, transform),
    )
