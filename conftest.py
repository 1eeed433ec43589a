"""What holds for all tests: none is timed, so a kernel that is loaded late fails nothing.

A shell that runs tests in the background has them, and the processes they start, ignore Ctrl-C;
some tests send it, so it is heard again.

Hypothesis tries the same examples in every run, so that none is red by chance; with
`--hypothesis-profile=new` it looks for new ones.

Files of tests that run side by side have a ROS domain each, of this machine only: their nodes have
the same names.

What is quickly found is found first: tests that are marked as long run last.

What tests start ends with them, however they end.
"""

import os
import signal

import pytest
from hypothesis import HealthCheck, settings

from intuitive_physics.processes import guard_run

pytest_plugins = ["tools.needs"]

settings.register_profile("new", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("same", settings.get_profile("new"), derandomize=True)
settings.load_profile("same")

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


def interrupt() -> None:
    """End the tests as Ctrl-C does, so that each fixture is torn down."""
    raise KeyboardInterrupt("SIGTERM")


if "PYTEST_XDIST_WORKER" not in os.environ:
    guard_run(interrupt)

os.environ.setdefault("ROS_DOMAIN_ID", str(os.getpid() % 100 + 1))
os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
worker = os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw")
if worker != "0":
    os.environ["ROS_DOMAIN_ID"] = str(
        (int(os.environ["ROS_DOMAIN_ID"]) + 20 * int(worker)) % 100 + 1
    )


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    items.sort(key=lambda item: item.get_closest_marker("long") is not None)
