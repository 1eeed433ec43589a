"""A ball whose radius is known beforehand is placed better by it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

SIGMAS = 3.0
CLEARER = 9.0
RADIUS_DEVIATION = 1e-4
"""m, of a known radius: covariances stay well away from singular."""


def with_known_radius(
    sphere: NDArray[np.float64],
    covariance: NDArray[np.float64],
    radii: Sequence[float],
    tolerance: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return sphere (4,) and covariance (4, 4) given that its radius is one of some known ones.

    A known radius is taken where the fit is compatible with it and clearly not with another; what
    else the fit says of the radius moves the centre, as both go together. Where none fits it stays
    as it is: not everything is known.

    Parameters
    ----------
    tolerance : m, by which a known object may differ
    """
    variance = float(covariance[3, 3])
    if not radii or not np.isfinite(variance) or variance <= 0.0:
        return sphere, covariance
    off = np.array(radii) - sphere[3]
    distances2 = np.square(off) / (variance + (tolerance / SIGMAS) ** 2)
    order = np.argsort(distances2)
    nearest = int(order[0])
    ambiguous = len(radii) > 1 and distances2[order[1]] < distances2[nearest] + CLEARER
    if distances2[nearest] > SIGMAS**2 or ambiguous:
        return sphere, covariance
    # Bayes' rule for a measurement of the radius alone.
    gain = covariance[:, 3] / (variance + RADIUS_DEVIATION**2)
    moved = sphere + gain * off[nearest]
    return moved, covariance - np.outer(gain, covariance[3])
