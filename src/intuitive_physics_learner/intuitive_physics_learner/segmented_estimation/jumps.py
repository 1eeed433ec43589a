"""Jumps of position and velocity that points ask for at the start of a segment of a motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_learner.joint_estimation.normal_equations import huber_weights

JUMP_DISPLACEMENT, JUMP_VELOCITY = 0.01, 0.05
"""Standard deviations (m and m/s) of the jumps that points ask for. With 0.15 m/s what a hand
holds is followed as well; set by hand on the sets of seeds 100 to 105 and 130 to 137."""

REWEIGHTINGS = 3
"""Rounds of weighting points against outliers."""


@dataclass(frozen=True, eq=False)
class Jump:
    """Jumps that points ask for at the start of a segment, of a · K motions of O objects.

    Parameters
    ----------
    displacements : (a, K, O, 3) m
    velocities : (a, K, O, 3) m/s
    losses : (a, K) by their priors
    offsets : (a, K, O, C, 3) m, left between motions and points
    """

    displacements: NDArray[np.float64]
    velocities: NDArray[np.float64]
    losses: NDArray[np.float64]
    offsets: NDArray[np.float64]


def asked_jump(
    offsets: NDArray[np.float64],
    times: NDArray[np.float64],
    precisions: NDArray[np.float64],
    scales: NDArray[np.float64],
) -> Jump:
    """Fit jumps to offsets (a, K, O, C, 3) m, robustly, as if the motion did not depend on them.

    `times` (a, C) s since the start of the segment, NaN beyond its last; `precisions` (a, O, C)
    1/m²; `scales` (a, K, O) of the priors.
    """
    known = precisions[:, None] > 0.0
    finite = np.where(np.isfinite(offsets) & known[..., None], offsets, 0.0)
    since = np.nan_to_num(times)[:, None, None]
    prior = (JUMP_DISPLACEMENT * scales) ** -2, (JUMP_VELOCITY * scales) ** -2
    weights = np.broadcast_to(precisions[:, None], finite.shape[:-1])
    for _ in range(REWEIGHTINGS):
        zeroth, second = weights.sum(axis=3) + prior[0], (weights * since**2).sum(axis=3) + prior[1]
        first = (weights * since).sum(axis=3)
        sums = np.einsum("akoc,akoci->akoi", weights, finite)
        moments = np.einsum("akoc,akoci->akoi", weights * since, finite)
        determinant = (zeroth * second - first**2)[..., None]
        displacements = (second[..., None] * sums - first[..., None] * moments) / determinant
        velocities = (zeroth[..., None] * moments - first[..., None] * sums) / determinant
        moved = displacements[..., None, :] + velocities[..., None, :] * since[..., None]
        lengths = np.linalg.norm(finite - moved, axis=-1) * np.sqrt(precisions[:, None])
        weights = precisions[:, None] * huber_weights(lengths)
    squares = prior[0] * (displacements**2).sum(axis=3) + prior[1] * (velocities**2).sum(axis=3)
    return Jump(displacements, velocities, 0.5 * squares.sum(axis=2), offsets - moved)
