"""What the suite knows in messages that others read: of vision_msgs, nav_msgs and geometry_msgs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseArray, PoseStamped
from nav_msgs.msg import Path
from numpy.typing import NDArray
from std_msgs.msg import Header

from intuitive_physics.scene import SceneObject
from intuitive_physics.shapes import Box, Capsule, Shape
from intuitive_physics.state import ObjectState
from intuitive_physics_ros.conversions.primitives import (
    pose_to_message,
    stamp_from_seconds,
    vector_to_message,
)
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
    for one, state in zip(objects, states, strict=True):
        pose = object_state_to_message(one, state).pose
        result = ObjectHypothesisWithPose(pose=pose)
        result.hypothesis.class_id, result.hypothesis.score = one.material, 1.0
        detection = Detection3D(header=header, id=one.id, results=[result])
        detection.bbox.center = pose.pose
        detection.bbox.size = vector_to_message(box_around(one.shape))
        message.detections.append(detection)
    return message


def box_around(shape: Shape) -> NDArray[np.float64]:
    """Return the edge lengths (3,), m, of the box along a shape's axes that just holds it."""
    if isinstance(shape, Box):
        return np.array(shape.edge_lengths)
    if isinstance(shape, Capsule):
        return 2.0 * shape.radius + np.array([0.0, 0.0, shape.length])
    return np.full(3, 2.0 * shape.bounding_radius)


def path_to_message(
    frame_id: str, start: float, times: NDArray[np.float64], positions: NDArray[np.float64]
) -> Path:
    """Return a path whose poses have no turn, each with its own stamp.

    Parameters
    ----------
    frame_id : of the positions
    start : s, time at which it begins
    times : (n,) s after it
    positions : (n, 3) m
    """
    header = Header(stamp=stamp_from_seconds(start), frame_id=frame_id)
    poses = [
        PoseStamped(
            header=Header(stamp=stamp_from_seconds(start + time), frame_id=frame_id),
            pose=pose_to_message(position),
        )
        for time, position in zip(times.tolist(), positions, strict=True)
    ]
    return Path(header=header, poses=poses)


def poses_to_message(frame_id: str, time: float, positions: NDArray[np.float64]) -> PoseArray:
    """Return poses without a turn.

    Parameters
    ----------
    frame_id : of the positions
    time : s, of all of them
    positions : (n, 3) m
    """
    header = Header(stamp=stamp_from_seconds(time), frame_id=frame_id)
    return PoseArray(header=header, poses=[pose_to_message(one) for one in positions])
