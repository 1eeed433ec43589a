#!/usr/bin/env python3
"""Publish what is predicted of one object as a path, and where it may be at one time as poses."""

import sys

import numpy as np
from geometry_msgs.msg import Point, Pose, PoseArray, PoseStamped
from intuitive_physics_msgs.msg import TrajectoryDistribution
from nav_msgs.msg import Path
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.time import Time
from std_msgs.msg import Header

from intuitive_physics_ros.lifecycle.run_node import run_node


class PublishPath(Node):
    """Hears predictions, and publishes some of them in messages that planners read."""

    def __init__(self):
        super().__init__("publish_path")
        # Of which object; empty: the first one. At what time after its start samples are shown, s.
        self._object = self.declare_parameter("object", "").value
        self._after = self.declare_parameter("after", 0.5).value
        self._newest = None
        self.create_subscription(
            TrajectoryDistribution, "intuitive_physics/predictions", self._on_prediction, 1
        )
        self._path = self.create_publisher(Path, "intuitive_physics/path", 10)
        self._poses = self.create_publisher(PoseArray, "intuitive_physics/sample_poses", 10)
        rate = self.declare_parameter("rate", 10.0).value
        self.create_timer(1.0 / rate, self._publish)

    def _on_prediction(self, message):
        self._newest = message

    def _publish(self):
        message, self._newest = self._newest, None
        objects = [] if message is None else message.objects
        chosen = [item for item in objects if self._object in ("", item.object_id)]
        if not chosen:
            return
        times = np.array(message.times)
        mean = np.reshape(chosen[0].mean, (-1, 3))
        path = [
            PoseStamped(header=header_at(message.header, time), pose=pose_at(place))
            for time, place in zip(times, mean, strict=True)
        ]
        self._path.publish(Path(header=message.header, poses=path))
        k = int(np.abs(times - self._after).argmin())
        places = np.reshape(chosen[0].samples, (message.sample_count, -1, 3))[:, k]
        poses = [pose_at(place) for place in places]
        self._poses.publish(PoseArray(header=header_at(message.header, times[k]), poses=poses))


def header_at(start, time):
    """Return the header of what is predicted for some seconds after the start."""
    stamp = Time.from_msg(start.stamp) + Duration(seconds=float(time))
    return Header(stamp=stamp.to_msg(), frame_id=start.frame_id)


def pose_at(place):
    """Return a pose without a turn, as the orientation is not predicted."""
    x, y, z = place.tolist()
    pose = Pose(position=Point(x=x, y=y, z=z))
    pose.orientation.w = 1.0
    return pose


if __name__ == "__main__":
    # It ends cleanly on Ctrl-C whatever is under way, which is an error inside of rclpy's own spin.
    sys.exit(run_node(PublishPath))
