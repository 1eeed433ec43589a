"""How far simulated tosses of a cube are from recorded ones, in position and in rotation.

The definition is that of Acosta, Yang and Posa, "Validating robotics simulators on real-world
impacts" (RA-L 2022): full roll-outs from the initial state, errors averaged over the steps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.materials import StaticParameters
from intuitive_physics.simulation import Simulator, pack_worlds
from intuitive_physics_experiments.recorded_sets.cube_tosses import MATERIALS, CubeToss

FAILED_DISTANCE = 1000.0
"""m; what a point counts that was not simulated, as in the learner's J."""


@dataclass(frozen=True, eq=False)
class TossErrors:
    """Errors of tosses, each the mean over the steps after the first row.

    Parameters
    ----------
    position : (..., n_tosses) distance of the centres over the cube's width
    rotation : (..., n_tosses) rad, angle of the rotation between the orientations
    """

    position: NDArray[np.float64]
    rotation: NDArray[np.float64]


class TossBatch:
    """Tosses packed once to be simulated and judged many times.

    Parameters
    ----------
    tosses : at least one, in one environment

    Attributes
    ----------
    width : m, of the cube
    """

    def __init__(self, tosses: Sequence[CubeToss]) -> None:
        self._worlds = pack_worlds(
            [toss.observation.scene() for toss in tosses], StaticParameters.uniform(MATERIALS)
        )
        self.width = tosses[0].width
        seen = [toss.observation.objects[0].trajectory for toss in tosses]
        steps = max(len(one) for one in seen) - 1
        self._times = np.full((len(tosses), steps), np.nan)
        self._positions = np.zeros((len(tosses), steps, 3))
        self._orientations = np.zeros((len(tosses), steps, 4))
        for row, (toss, one) in enumerate(zip(tosses, seen, strict=True)):
            self._times[row, : len(one) - 1] = one.times[1:] - one.times[0]
            self._positions[row, : len(one) - 1] = one.positions[1:]
            self._orientations[row, : len(one) - 1] = toss.orientations[1:]

    @property
    def times(self) -> NDArray[np.float64]:
        """Shape (n_tosses, n_steps), s after the first row; NaN after a toss's end."""
        return self._times

    def simulated(self, simulator: Simulator, candidates: Sequence[StaticParameters]) -> TossErrors:
        """Errors (n_candidates, n_tosses) of simulating every toss from its first row."""
        count = len(candidates)
        rollout = simulator.rollout_batch(
            self._worlds.crossed(candidates), np.tile(self._times, (count, 1)), orientations=True
        )
        shape = (count, *self._times.shape)
        return self.errors(
            rollout.positions[:, 0].reshape(*shape, 3),
            np.asarray(rollout.orientations)[:, 0].reshape(*shape, 4),
        )

    def errors(
        self, positions: NDArray[np.float64], orientations: NDArray[np.float64]
    ) -> TossErrors:
        """Errors of predicted poses.

        Parameters
        ----------
        positions : (..., n_tosses, n_steps, 3) m; what is not finite at a step that was recorded
            counts `FAILED_DISTANCE` and half a turn
        orientations : (..., n_tosses, n_steps, 4) unit quaternions (x, y, z, w)
        """
        recorded = np.isfinite(self._times)
        distances = np.linalg.norm(positions - self._positions, axis=-1)
        distances = np.where(np.isfinite(distances), distances, FAILED_DISTANCE)
        angles = rotation_angles(orientations, self._orientations)
        angles = np.where(np.isfinite(angles), angles, np.pi)
        steps = recorded.sum(axis=-1)
        return TossErrors(
            np.where(recorded, distances, 0.0).sum(axis=-1) / steps / self.width,
            np.where(recorded, angles, 0.0).sum(axis=-1) / steps,
        )


def rotation_angles(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Angle in rad, 0 to π, of the rotation from a to b, unit quaternions of shape (..., 4)."""
    # As 4 atan2(|a - b|, |a + b|), which is exact for small angles where acos(a · b) is not;
    # b and -b are the same rotation, the nearer one counts.
    apart, together = np.linalg.norm(a - b, axis=-1), np.linalg.norm(a + b, axis=-1)
    return 4.0 * np.arctan2(np.minimum(apart, together), np.maximum(apart, together))
