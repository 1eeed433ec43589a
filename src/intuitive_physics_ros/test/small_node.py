"""A node as small as can be, run by `test_run_node.py` in a process of its own."""

import ctypes
import multiprocessing
import sys
import time

from rclpy.node import Node
from std_msgs.msg import Float64

from intuitive_physics.errors import InvalidInputError
from intuitive_physics_ros.diagnostics import Diagnostics
from intuitive_physics_ros.lifecycle.run_node import run_node
from intuitive_physics_ros.monitors import InputMonitor
from intuitive_physics_ros.parameters import Parameter, declare_parameters

PARAMETERS = (
    Parameter("rate", 30.0, "Hz of the sensor", range=(1.0, 1000.0)),
    Parameter("count", 3, "how many", range=(1, 10), read_only=False),
    Parameter("mode", "fast", "how", choices=("fast", "exact"), read_only=False),
    Parameter("limit", 1.0, "m", read_only=False),
    Parameter("names", ["a", "b"], "of things"),
    Parameter("lengths", [0.5], "m", read_only=False),
)


class SmallNode(Node):
    """Answers each positive number with its double."""

    def __init__(self) -> None:
        if "--slow-start" in sys.argv:
            print("starting", flush=True)
            time.sleep(1.0)
        if "--endless-start" in sys.argv:
            print("starting", flush=True)
            time.sleep(60.0)
        super().__init__("small")
        values = declare_parameters(self, PARAMETERS)
        if values["names"] == ["impossible"]:
            raise InvalidInputError("names are impossible; expected possible ones")
        self._input = InputMonitor(self, "~/number", timeout=1.0)
        Diagnostics(self).add("number", self._input.check)
        self._publisher = self.create_publisher(Float64, "~/double", 10)
        self.create_subscription(Float64, "~/number", self._on_number, 10)
        if "--worker" in sys.argv:
            self._end_worker()
        self.get_logger().info("ready")

    def _end_worker(self) -> None:
        worker = multiprocessing.get_context("fork").Process(target=time.sleep, args=(60.0,))
        worker.start()
        worker.terminate()
        worker.join()
        print(f"worker ended by signal {-worker.exitcode}", flush=True)

    def _on_number(self, message: Float64) -> None:
        if message.data == 13.0:
            raise ValueError("13 brings bad luck")
        if message.data == 14.0:
            print("sleeps", flush=True)
            time.sleep(60.0)
        if message.data == 0.0:
            raise InvalidInputError("number is 0; expected another")
        if message.data < 0.0:
            self._input.rejected(f"number is {message.data:g}; expected above zero")
            return
        self._input.accepted()
        self._publisher.publish(Float64(data=2.0 * message.data))

    def destroy_node(self) -> None:
        """Say that the end was reached."""
        print("closed", flush=True)
        if "--slow-end" in sys.argv:
            time.sleep(60.0)
        if "--locked-end" in sys.argv:
            # With Python's lock, as calls of the middleware are.
            ctypes.PyDLL(None).sleep(60)
        super().destroy_node()


if __name__ == "__main__":
    sys.exit(run_node(SmallNode))
