"""A managed node as small as can be, run by `test_managed_node.py` in a process of its own."""

from __future__ import annotations

import os
import sys
import threading
import time
from pathlib import Path

from lifecycle_msgs.srv import ChangeState
from rclpy.callback_groups import ReentrantCallbackGroup
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.kernels.cache import KernelCache
from intuitive_physics_ros.background import Background
from intuitive_physics_ros.diagnostics import Level, Status
from intuitive_physics_ros.lifecycle.managed_node import ManagedNode
from intuitive_physics_ros.lifecycle.run_node import run_node
from intuitive_physics_ros.parameters import Parameter
from intuitive_physics_ros.qos import QOS_OVERRIDES

PARAMETERS = (Parameter("fails", "nowhere", "where it fails", choices=("nowhere", "ours", "bug")),)

COMPILED = os.environ.get("COMPILED", "")
"""File whose appearance ends the compilation of the kernels; empty: the cache has them all."""


def warm_up() -> None:
    """Find no kernel, and compile until the test says that it is done."""
    if COMPILED:
        KernelCache.listeners[threading.get_ident()]()
    while COMPILED and not Path(COMPILED).exists():
        time.sleep(0.01)


class SmallManagedNode(ManagedNode):
    """Adds up the numbers that it hears while it is active."""

    def __init__(self) -> None:
        super().__init__("small", PARAMETERS, warm_up)

    def configure(self) -> None:
        """Fail as the parameter says."""
        if self.values()["fails"] == "ours":
            raise InvalidInputError("the file is missing; expected one")
        if self.values()["fails"] == "bug":
            raise ZeroDivisionError("1 / 0")
        self.total = 0.0

    def activate(self) -> None:
        """Make one entity of each kind."""
        self._background = Background(self)
        self._publisher = self.create_publisher(
            Float64, "total", 10, qos_overriding_options=QOS_OVERRIDES
        )
        self.create_subscription(
            Float64, "number", self._add, 10, qos_overriding_options=QOS_OVERRIDES
        )
        self.create_service(
            Trigger, "~/sleep", self._sleep, callback_group=ReentrantCallbackGroup()
        )
        self.create_client(ChangeState, "nobody/change_state")
        self.kernels.when_loaded(lambda: self.create_timer(0.05, self._publish))
        self.kernels.when_loaded(self.create_guard_condition(self._publish).trigger)
        self.diagnostics.add("total", lambda: Status(Level.OK, f"{self.total:g}"))

    def deactivate(self) -> None:
        """Stop the thread."""
        self._background.stop()

    def cleanup(self) -> None:
        """Forget the sum."""
        del self.total

    def _add(self, message: Float64) -> None:
        self.total += message.data

    def _publish(self) -> None:
        self._publisher.publish(Float64(data=self.total))

    async def _sleep(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        def sleep(stop):
            while not stop.is_set():
                time.sleep(0.01)

        try:
            await self._background.run(sleep)
        except Exception as error:
            response.message = str(error)
        return response


if __name__ == "__main__":
    sys.exit(run_node(SmallManagedNode))
