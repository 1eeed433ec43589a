"""A sphere as one frame shows it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class DetectedSphere:
    """A sphere in one frame.

    Parameters
    ----------
    center : (3,) m
    radius : m
    covariance : (4, 4) of centre and radius, m²
    points : readings on its surface
    range : m from the sensor to the centre
    color : (3,) mean red, green and blue, 0 to 1; None where it is not told
    """

    center: NDArray[np.float64]
    radius: float
    covariance: NDArray[np.float64]
    points: int
    range: float
    color: NDArray[np.float64] | None = None

    def moved(
        self, rotation: NDArray[np.float64], translation: NDArray[np.float64]
    ) -> DetectedSphere:
        """Return it in another frame, p_other = rotation p + translation."""
        turn = np.eye(4)
        turn[:3, :3] = rotation
        return replace(
            self,
            center=rotation @ self.center + translation,
            covariance=turn @ self.covariance @ turn.T,
        )


def without_doubles(spheres: list[DetectedSphere]) -> list[DetectedSphere]:
    """Of spheres that share space keep the one with more points."""
    kept: list[DetectedSphere] = []
    for sphere in sorted(spheres, key=lambda sphere: -sphere.points):
        if all(
            np.linalg.norm(sphere.center - other.center) > max(sphere.radius, other.radius)
            for other in kept
        ):
            kept.append(sphere)
    return kept
