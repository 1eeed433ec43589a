"""Tosses of a real cube onto a table, recorded by others with motion capture.

The set and its units: ContactNets (Pfrommer, Halm, Posa, CoRL 2020). Each row has the full state,
so the first one is θ_d as it stands. The cube is taken to be solid unless it is asked for as it is:
the real one has walls and a moment of inertia that is a fifth larger.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.geometry.rotations import rotation_matrix
from intuitive_physics.observation import Observation, ObservedObject
from intuitive_physics.scene import Environment, Plane, SceneObject
from intuitive_physics.shapes import Box
from intuitive_physics.state import ObjectState
from intuitive_physics.trajectory import Trajectory
from intuitive_physics.validation import UNIT_QUATERNION_TOLERANCE, positive_float
from intuitive_physics_recordings.npz_file import Arrays, split_rows

CUBE_MATERIAL, TABLE_MATERIAL = "cube", "table"  # Names of the materials

# All materials of the set, in the order of its parameters.
MATERIALS = (CUBE_MATERIAL, TABLE_MATERIAL)

# Lengths over recorded lengths: the cubes fall with 9.62 m/s² instead of 9.81 m/s² and rest 1.2 mm
# too low for their edges.
LENGTH_CORRECTION = 1.02


@dataclass(frozen=True, eq=False)
class CubeToss:
    """One toss: an observation, and how the cube was turned at each of its points."""

    observation: Observation  # of one object, a cube; starts at its first point
    orientations: NDArray[np.float64]  # (n, 4) unit quaternions (x, y, z, w), cube to world

    @property
    def width(self) -> float:
        """Edge of the cube in m."""
        shape = self.observation.objects[0].object.shape
        if not isinstance(shape, Box):
            raise InvalidInputError(f"shape of the tossed object is {shape!r}; expected a Box")
        return shape.edge_lengths[0]


def cube_tosses(
    arrays: Arrays, length_correction: float = 1.0, measured_inertia: bool = False
) -> list[CubeToss]:
    """Tosses above the table z = 0.

    The arrays are `position` (n, 3) m, `quaternion_wxyz` (n, 4), `velocity_world` (n, 3) m/s,
    `angular_velocity_body` (n, 3) rad/s, `offsets`, `dt` s, `cube_edge` m; for the measured
    inertia, instead of that of a solid cube, `mass` kg and `inertia` kg m². The length correction
    is a factor on all recorded positions and velocities.
    """
    period = positive_float(arrays["dt"], "dt")
    edge = positive_float(arrays["cube_edge"], "cube_edge")
    inertia_factor = _inertia_factor(arrays, edge) if measured_inertia else 1.0
    factor = positive_float(length_correction, "length correction")
    cube = SceneObject(
        "cube", CUBE_MATERIAL, Box((edge, edge, edge)), inertia_factor=inertia_factor
    )
    table = Environment([Plane("table", TABLE_MATERIAL, (0.0, 0.0, 1.0), 0.0)])
    recordings = zip(
        split_rows(arrays, "position"),
        _orientations(arrays),
        split_rows(arrays, "velocity_world"),
        split_rows(arrays, "angular_velocity_body"),
        strict=True,
    )
    tosses = []
    for i, (positions, orientations, velocities, spins) in enumerate(recordings):
        state = ObjectState(
            factor * positions[0],
            orientations[0],
            factor * velocities[0],
            rotation_matrix(orientations[0]) @ spins[0],
        )
        trajectory = Trajectory(period * np.arange(len(positions)), factor * positions)
        observed = ObservedObject(cube, trajectory, state)
        tosses.append(CubeToss(Observation(table, (observed,), 0.0, f"toss_{i:03d}"), orientations))
    return tosses


def _inertia_factor(arrays: Arrays, edge: float) -> float:
    """Moment of inertia over that of a solid cube, m a² / 6."""
    for name in ("mass", "inertia"):
        if name not in arrays:
            raise InvalidInputError(f"there is no array {name}; expected it for measured inertia")
    mass = positive_float(arrays["mass"], "mass")
    return 6.0 * positive_float(arrays["inertia"], "inertia") / (mass * edge**2)


def cube_toss_observations(arrays: Arrays) -> list[Observation]:
    """Observations of the tosses: where the cube was, without how it was turned."""
    return [toss.observation for toss in cube_tosses(arrays)]


def _orientations(arrays: Arrays) -> list[NDArray[np.float64]]:
    """Unit quaternions (x, y, z, w) of each toss, of a set that writes w first."""
    recorded = split_rows(arrays, "quaternion_wxyz", columns=4)
    norms = np.linalg.norm(np.concatenate(recorded), axis=-1)
    worst = norms[np.argmax(np.abs(norms - 1.0))]
    if abs(worst - 1.0) > UNIT_QUATERNION_TOLERANCE:
        raise InvalidInputError(
            f"quaternion_wxyz has a row of norm {worst:.6g}; expected unit quaternions"
        )
    return [
        np.roll(rows, -1, axis=1) / np.linalg.norm(rows, axis=1, keepdims=True) for rows in recorded
    ]
