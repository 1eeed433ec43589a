"""First states of an observation as a vector of deviations from what was believed of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.observation import Observation
from intuitive_physics.shapes import Sphere
from intuitive_physics.state import LINEAR_VELOCITY, POSITION, ROTATION

PRIOR_WIDENING = 10.0
"""By what the standard deviations of position and velocity are multiplied: most of what is known of
them comes from points of the very trajectory they are to explain, which must not count twice."""


@dataclass(frozen=True, eq=False)
class FirstStateDeviations:
    """What may differ from the first states that an observation came with.

    Parameters
    ----------
    believed : (O, 13) as `ObjectState.to_vector`
    axes : d pairs (object, component), components as in an `ObjectState`'s covariance; known
        exactly, and so not among them, are those of variance zero and how a sphere is turned
    standard_deviations : (d,) of each before the trajectory was looked at, in its SI unit
    """

    believed: NDArray[np.float64]
    axes: tuple[tuple[int, int], ...]
    standard_deviations: NDArray[np.float64]

    @staticmethod
    def of(observation: Observation, free: bool = True) -> FirstStateDeviations:
        """Read them from the first states' covariances, of which only the diagonal is used.

        Parameters
        ----------
        free : False takes the first states to be exactly known
        """
        axes, deviations = [], []
        for j, seen in enumerate(observation.objects):
            spread = np.sqrt(np.diag(seen.initial_state.covariance))
            spread[POSITION] *= PRIOR_WIDENING
            spread[LINEAR_VELOCITY] *= PRIOR_WIDENING
            if isinstance(seen.object.shape, Sphere):
                spread[ROTATION] = 0.0
            spread *= free
            axes += [(j, int(k)) for k in np.flatnonzero(spread)]
            deviations += spread[spread > 0.0].tolist()
        believed = np.array([seen.initial_state.to_vector() for seen in observation.objects])
        return FirstStateDeviations(believed, tuple(axes), np.array(deviations))

    def states(self, deviations: NDArray[np.float64], objects: int) -> NDArray[np.float64]:
        """Return first states (n, objects, 13), padded with rest, for deviations (n, d)."""
        errors = np.zeros((len(deviations), len(self.believed), 12))
        for column, (j, component) in enumerate(self.axes):
            errors[:, j, component] = deviations[:, column]
        states = np.zeros((len(deviations), objects, 13))
        states[..., 6] = 1.0
        own = states[:, : len(self.believed)]
        own[..., 0:3] = self.believed[:, 0:3] + errors[..., 0:3]
        own[..., 3:7] = _turned(self.believed[:, 3:7], errors[..., 3:6])
        own[..., 7:13] = self.believed[:, 7:13] + errors[..., 6:12]
        return states


def _turned(
    quaternions: NDArray[np.float64], rotations: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Turn orientations (O, 4) by rotation vectors (n, O, 3) in the environment's frame."""
    angles = np.linalg.norm(rotations, axis=-1, keepdims=True)
    # sin(θ/2) / θ by NumPy's sinc(x) = sin(π x) / (π x), which is right at θ = 0 too.
    x1, y1, z1 = np.moveaxis(0.5 * np.sinc(angles / (2.0 * np.pi)) * rotations, -1, 0)
    w1 = np.cos(0.5 * angles[..., 0])
    x2, y2, z2, w2 = np.moveaxis(quaternions, -1, 0)
    return np.stack(
        [
            w1 * x2 + x1 * w2 + y1 * z2 - z1 * y2,
            w1 * y2 - x1 * z2 + y1 * w2 + z1 * x2,
            w1 * z2 + x1 * y2 - y1 * x2 + z1 * w2,
            w1 * w2 - x1 * x2 - y1 * y2 - z1 * z2,
        ],
        axis=-1,
    )
