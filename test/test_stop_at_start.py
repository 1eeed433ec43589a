"""A signal ends each real node clean, in whatever moment of its start it comes."""

from __future__ import annotations

import signal
import subprocess
import sys
import time

import pytest

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
    process = subprocess.Popen(
        [sys.executable, "-c", RUN, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    assert process.stdout.readline() == "begins\n"
    time.sleep(delay)
    process.send_signal(signal.SIGINT if delay < 1.0 else signal.SIGTERM)
    text, _ = process.communicate(timeout=30)
    assert process.returncode == 0, text
    assert "Traceback" not in text
