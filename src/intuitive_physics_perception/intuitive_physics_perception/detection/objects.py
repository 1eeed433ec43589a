"""All objects of a frame: spheres, and the boxes and capsules in what spheres do not explain."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_perception.detection.detected_sphere import without_doubles
from intuitive_physics_perception.detection.detection import Detection
from intuitive_physics_perception.detection.solids import SolidFinder
from intuitive_physics_perception.detection.spheres import ClusterSpheres
from intuitive_physics_perception.input.colors import with_color

EXPLAINED = 0.1
"""Part of a cluster that spheres may leave: noise, a shadow's edge, a finger."""


def all_objects(
    points: NDArray[np.float32],
    found: Sequence[ClusterSpheres],
    solids: SolidFinder | None,
    colors: NDArray[np.uint8] | None = None,
) -> list[Detection]:
    """Return the objects of a frame of points (height, width, 3), in the sensor's frame.

    One solid that explains a whole cluster is likelier than a sphere that explains a part of it:
    the near end of a capsule is one.

    Parameters
    ----------
    found : the spheres of each cluster
    solids : finds boxes and capsules; None to leave them out
    colors : (height, width, 3) of the points, where they are known
    """
    unexplained = [part for part in found if part.rest > EXPLAINED] if solids else []
    by_cluster = solids.find(points, [part.cluster for part in unexplained]) if solids else []
    replaced = [
        part for part, solid in zip(unexplained, by_cluster, strict=True) if solid is not None
    ]
    spheres = [
        sphere
        for part in found
        if all(part is not other for other in replaced)
        for sphere in part.spheres
    ]
    detections: list[Detection] = [
        *without_doubles(spheres),
        *(solid for solid in by_cluster if solid is not None),
    ]
    if colors is None:
        return detections
    clusters = {id(sphere): part.cluster for part in found for sphere in part.spheres}
    clusters |= {
        id(solid): part.cluster for part, solid in zip(unexplained, by_cluster, strict=True)
    }
    return [
        _colored(detection, clusters[id(detection)], points, colors) for detection in detections
    ]


def _colored(
    detection: Detection,
    cluster: NDArray[np.int64],
    points: NDArray[np.float32],
    colors: NDArray[np.uint8],
) -> Detection:
    # Colours may be a view of a message, so only those asked for are copied.
    rows, columns = np.divmod(cluster, points.shape[1])
    return with_color(detection, points[rows, columns], colors[rows, columns])
