"""A signal ends each real node clean, in whatever moment of its start it comes."""

from __future__ import annotations

import signal
import sys
import time

import pytest

from intuitive_physics.processes import ChildProcess

RUN = """
import sys
from intuitive_physics_ros.lifecycle.start_node import run_module
print("begins", flush=True)
sys.exit(run_module(sys.argv.pop(1)))
"""

NODES = {
    "perception": ["-p", "input:=auto"],
    "learner": ["-p", "online:=true"],
    "predictor": ["-p", "rate:=50.0"],
}


@pytest.mark.parametrize("delay", [0.02, 0.5, 1.0, 2.0])
@pytest.mark.parametrize("node", NODES)
def test_a_signal_while_it_starts(node, delay, tmp_path):
    arguments = [f"intuitive_physics_{node}.nodes.{node}_node", "--ros-args", *NODES[node]]
    if node == "learner":
        arguments += ["-p", f"database:={tmp_path}/learner.sqlite3"]
    process = ChildProcess([sys.executable, "-c", RUN, *arguments])
    process.wait_for("begins\n")
    time.sleep(delay)
    number = signal.SIGINT if delay < 1.0 else signal.SIGTERM
    assert process.stop(number, timeout=30.0) == 0, process.output
    assert "Traceback" not in process.output
