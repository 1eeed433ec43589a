#!/usr/bin/env python3
"""Ask the predictor once a second where a hand could best catch each object, and when."""

import sys
from functools import partial

from intuitive_physics_msgs.msg import Region, ResultCode, TrajectoryDistribution
from intuitive_physics_msgs.srv import Query
from rclpy.node import Node

from intuitive_physics_ros.lifecycle.run_node import run_node


class CatchObjects(Node):
    """Hears predictions, and asks for an interception of each object in them."""

    def __init__(self):
        super().__init__("catch_objects")
        # What the hand can reach: a box in the frame of the predictions, m.
        self._center = self.declare_parameter("center", [0.0, 0.0, 0.5]).value
        self._size = self.declare_parameter("size", [2.0, 2.0, 1.0]).value
        # How far from its centre it still catches, m, and how long it takes to move, s.
        self._reach = self.declare_parameter("reach", 0.1).value
        self._earliest = self.declare_parameter("earliest", 0.2).value
        self._newest = None
        self._query = self.create_client(Query, "predictor_node/query")
        self.create_subscription(
            TrajectoryDistribution, "intuitive_physics/predictions", self._on_prediction, 1
        )
        self.create_timer(1.0, self._ask)

    def _on_prediction(self, message):
        self._newest = message

    def _ask(self):
        if self._newest is None or not self._query.service_is_ready():
            self.get_logger().info("nothing is predicted yet", once=True)
            return
        for trajectory in self._newest.objects:
            future = self._query.call_async(self._request(trajectory.object_id))
            future.add_done_callback(partial(self._on_answer, trajectory.object_id))
        self._newest = None

    def _request(self, object_id):
        box = Region(kind=Region.BOX)
        box.pose.position.x, box.pose.position.y, box.pose.position.z = self._center
        box.edge_lengths.x, box.edge_lengths.y, box.edge_lengths.z = self._size
        return Query.Request(
            event=Query.Request.INTERCEPTS,
            object_id=object_id,
            region=box,
            reach=self._reach,
            earliest=self._earliest,
        )

    def _on_answer(self, object_id, future):
        answer, place = future.result(), future.result().position
        if answer.result.value != ResultCode.OK:
            self.get_logger().warning(f"{object_id}: {answer.result.message}")
        elif answer.probability == 0.0:
            self.get_logger().info(f"{object_id} cannot be caught")
        else:
            self.get_logger().info(
                f"catch {object_id} at ({place.x:.3f}, {place.y:.3f}, {place.z:.3f}) m of "
                f"{answer.header.frame_id} in {answer.time:.3f} s: {answer.probability:.0%}"
            )


if __name__ == "__main__":
    # It ends cleanly on Ctrl-C whatever is under way, which is an error inside of rclpy's own spin.
    sys.exit(run_node(CatchObjects))
