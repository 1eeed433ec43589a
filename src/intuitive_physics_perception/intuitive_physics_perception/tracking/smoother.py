"""Fixed-interval smoothing of a track: its states given all frames.

Rauch, Tung, Striebel, "Maximum likelihood estimates of linear dynamic systems" (1965).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_perception.detection.detections import Detection
from intuitive_physics_perception.tracking.attitude import Attitude
from intuitive_physics_perception.tracking.motion import Prediction

RIDGE = 1e-12
"""Term added to a correlation matrix's diagonal so that it can be inverted: numerical."""


@dataclass(frozen=True, eq=False)
class FilterStep:
    """State of the filters at one frame.

    Parameters
    ----------
    time : s
    prediction : from the frame before
    mean, covariance : (7,) and (7, 7) once the frame was taken into account
    detection : of it in this frame, in the environment's frame; None where it was not detected
    attitude : how it lies and turns; None of a sphere
    """

    time: float
    prediction: Prediction
    mean: NDArray[np.float64]
    covariance: NDArray[np.float64]
    detection: Detection | None
    attitude: Attitude | None = None


@dataclass(frozen=True, eq=False)
class SmoothedPath:
    """States of an object at every frame from when it was first to when it was last seen.

    Parameters
    ----------
    times : (n,) s
    means : (n, 7) of position, velocity and radius
    covariances : (n, 7, 7)
    """

    times: NDArray[np.float64]
    means: NDArray[np.float64]
    covariances: NDArray[np.float64]


def smooth(steps: Sequence[FilterStep]) -> SmoothedPath:
    """Go back over the steps of a filter, from the last in which something was seen."""
    last = max(k for k, step in enumerate(steps) if step.detection is not None)
    means = np.stack([step.mean for step in steps[: last + 1]])
    covariances = np.stack([step.covariance for step in steps[: last + 1]])
    for k in range(last - 1, -1, -1):
        later = steps[k + 1].prediction
        gain = _divided(covariances[k] @ later.transition.T, later.covariance)
        means[k] += gain @ (means[k + 1] - later.mean)
        covariances[k] += gain @ (covariances[k + 1] - later.covariance) @ gain.T
    times = np.array([step.time for step in steps[: last + 1]])
    return SmoothedPath(times, means, 0.5 * (covariances + covariances.swapaxes(1, 2)))


def _divided(left: NDArray[np.float64], covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return left · covariance⁻¹; metres and metres a second differ by orders, so it is scaled."""
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-30))
    # A radius that is known exactly makes rows nearly dependent.
    correlation = covariance / np.outer(scale, scale) + RIDGE * np.eye(len(scale))
    return np.linalg.solve(correlation, (left / scale).T).T / scale
