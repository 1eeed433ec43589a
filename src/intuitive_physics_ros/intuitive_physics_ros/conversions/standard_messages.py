"""What the suite knows in messages that others read: of vision_msgs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from std_msgs.msg import Header

from intuitive_physics.scene import SceneObject
from intuitive_physics.shapes import Box, Capsule, Shape
from intuitive_physics.state import ObjectState
from intuitive_physics_ros.conversions.primitives import vector_to_message
from intuitive_physics_ros.conversions.scenes import object_state_to_message


def detections_to_message(
    objects: Sequence[SceneObject], states: Sequence[ObjectState], header: Header
) -> Any:
    """Return objects as vision_msgs/Detection3DArray: box, pose with covariance, id, and class.

    The class is the material, with the score 1; the box has the object's axes. vision_msgs, which
    is optional, must be installed.
    """
    from vision_msgs.msg import Detection3D, Detection3DArray, ObjectHypothesisWithPose

    message = Detection3DArray(header=header)
    for item, state in zip(objects, states, strict=True):
        pose = object_state_to_message(item, state).pose
        result = ObjectHypothesisWithPose(pose=pose)
        result.hypothesis.class_id, result.hypothesis.score = item.material, 1.0
        detection = Detection3D(header=header, id=item.id, results=[result])
        detection.bbox.center = pose.pose
        detection.bbox.size = vector_to_message(box_around(item.shape))
        message.detections.append(detection)
    return message


def box_around(shape: Shape) -> NDArray[np.float64]:
    """Return the edge lengths (3,), m, of the box along a shape's axes that just holds it."""
    if isinstance(shape, Box):
        return np.array(shape.edge_lengths)
    if isinstance(shape, Capsule):
        return 2.0 * shape.radius + np.array([0.0, 0.0, shape.length])
    return np.full(3, 2.0 * shape.bounding_radius)
