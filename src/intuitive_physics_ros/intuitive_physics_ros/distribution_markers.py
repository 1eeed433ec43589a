"""RViz markers of predicted distributions, as in the paper's Fig. 1."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from intuitive_physics_ros.conversions.geometry import pose_to_message, vector_to_message
from intuitive_physics_ros.markers import clearing_marker, trajectory_marker

SAMPLE_COLOR = ColorRGBA(r=0.15, g=0.45, b=0.85, a=0.35)
MEAN_COLOR = ColorRGBA(r=0.95, g=0.55, b=0.10, a=1.0)
ELLIPSOID_COLOR = ColorRGBA(r=0.95, g=0.55, b=0.10, a=0.20)
SAMPLE_WIDTH, MEAN_WIDTH = 0.002, 0.006
"""m"""
ELLIPSOIDS = 8
"""Covariance ellipsoids an object, evenly over the horizon."""
MAX_SAMPLES = 50
"""Sample lines an object: more are a blur, and a load on RViz."""


def distribution_markers(
    header: Header,
    object_ids: Sequence[str],
    positions: NDArray[np.float64],
    mean: NDArray[np.float64],
    covariance: NDArray[np.float64],
) -> MarkerArray:
    """Return thin lines for the samples, a line for the mean, 2 σ ellipsoids for the covariance.

    Parameters
    ----------
    positions : (n_samples, n_objects, n_times, 3) m
    mean : (n_objects, n_times, 3) m
    covariance : (n_objects, n_times, 3, 3) m²; an ellipsoid is left out where one is not finite
    """
    markers = [clearing_marker()]
    for i in range(len(object_ids)):
        samples, middle = positions[:MAX_SAMPLES, i], mean[i : i + 1]
        markers += [
            trajectory_marker(
                samples, header, SAMPLE_COLOR, namespace="samples", id=i, width=SAMPLE_WIDTH
            ),
            trajectory_marker(middle, header, MEAN_COLOR, namespace="mean", id=i, width=MEAN_WIDTH),
        ]
        shown = np.linspace(0, mean.shape[1] - 1, ELLIPSOIDS + 1).round().astype(int)[1:]
        finite = np.isfinite(mean[i]).all(axis=1) & np.isfinite(covariance[i]).all(axis=(1, 2))
        for k in np.unique(shown[finite[shown]]):
            marker = _ellipsoid(mean[i, k], covariance[i, k])
            marker.header, marker.id = header, i * ELLIPSOIDS + len(markers)
            markers.append(marker)
    return MarkerArray(markers=markers)


def _ellipsoid(center: NDArray[np.float64], covariance: NDArray[np.float64]) -> Marker:
    """Return the ellipsoid of two standard deviations to each side."""
    variances, axes = np.linalg.eigh(covariance)
    if np.linalg.det(axes) < 0.0:
        axes[:, 0] = -axes[:, 0]
    size = 4.0 * np.sqrt(np.maximum(variances, 1e-8))
    return Marker(
        ns="covariance",
        type=Marker.SPHERE,
        pose=pose_to_message(center, _quaternion(axes)),
        scale=vector_to_message(size),
        color=ELLIPSOID_COLOR,
    )


def _quaternion(rotation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the unit quaternion (x, y, z, w) of a rotation matrix (3, 3)."""
    # The eigenvector of this symmetric matrix to its largest eigenvalue (Bar-Itzhack 2000).
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = rotation
    matrix = np.array(
        [
            [xx - yy - zz, yx + xy, zx + xz, zy - yz],
            [yx + xy, yy - xx - zz, zy + yz, xz - zx],
            [zx + xz, zy + yz, zz - xx - yy, yx - xy],
            [zy - yz, xz - zx, yx - xy, xx + yy + zz],
        ]
    )
    return np.asarray(np.linalg.eigh(matrix)[1][:, -1])
