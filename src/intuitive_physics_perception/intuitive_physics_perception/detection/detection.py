"""What a frame can show: a sphere, or another solid."""

from __future__ import annotations

from intuitive_physics_perception.detection.detected_solid import DetectedSolid
from intuitive_physics_perception.detection.detected_sphere import DetectedSphere

Detection = DetectedSphere | DetectedSolid


def kind_of(detection: Detection) -> str:
    """Return the name of a detection's shape."""
    return "sphere" if isinstance(detection, DetectedSphere) else detection.shape.kind
