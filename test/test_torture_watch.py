"""How `make torture` watches nodes: whatever belongs to a node counts as the node."""

from __future__ import annotations

import sys

import pytest
from benchmarks.torture.nodes import megabytes, peak_megabytes

from intuitive_physics.processes import ChildProcess

TAKEN = 100_000_000
"""Bytes that a grandchild of this test takes."""

GRANDCHILD = f"held = b'x' * {TAKEN}; import time; print('holds', flush=True); time.sleep(60)"

ALONE = "import time; print('runs', flush=True); time.sleep(60)"

CHILD = f"""
import subprocess, sys
subprocess.run([sys.executable, "-c", {GRANDCHILD!r}])
"""


@pytest.mark.parametrize("measured", [megabytes, peak_megabytes])
def test_memory_of_a_node_includes_that_of_its_children(measured):
    with ChildProcess(
        [sys.executable, "-c", "print('runs', flush=True); import time; time.sleep(60)"]
    ) as alone:
        alone.wait_for("runs")
        without = measured(alone.pid)
    with ChildProcess([sys.executable, "-c", CHILD]) as parent:
        parent.wait_for("holds")
        assert measured(parent.pid) > without + TAKEN / 1e6
