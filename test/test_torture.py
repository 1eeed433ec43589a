"""The quick version of `make torture`, with the patient limits of `benchmarks/torture/bars.py`."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from benchmarks.torture.bars import PATIENT

ROOT = Path(__file__).parents[1]

DISK_FULL = "disk_full"
"""The fault that only root can bring about."""

pytestmark = [pytest.mark.long, pytest.mark.timeout(1860)]


@pytest.fixture(scope="module")
def figures():
    """What the last line says, once all is through."""
    run = subprocess.run(
        [sys.executable, "-m", "benchmarks.torture", "--quick", "--patient"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=1800.0,
    )
    # Each test below has a bar of its own; that the disk could not be filled is no missed bar here.
    missed = [line for line in run.stderr.splitlines() if line.startswith("bench-torture: ")]
    assert not [line for line in missed if DISK_FULL not in line], run.stderr
    assert run.returncode == (1 if missed else 0), run.stderr
    return json.loads(run.stdout.strip().splitlines()[-1])


def test_nothing_that_was_answered_is_lost_when_a_node_is_killed(figures):
    assert figures["kills"] >= 5
    assert (figures["lost"], figures["corrupted"]) == (0, 0)


def test_no_message_kills_or_holds_a_node(figures):
    assert figures["fuzzed"] >= 1000
    assert (figures["deaths"], figures["hangs"]) == (0, 0)
    assert figures["memory_bound_mb"] < 1500


def test_stops_and_cancels_are_quick(figures):
    assert figures["stop_s_worst"] < PATIENT.stop
    assert figures["cancel_s_worst"] < PATIENT.cancel


def test_faults_of_the_machine_are_borne(figures):
    borne = {name: found for name, found in figures["faults"].items() if name != DISK_FULL}
    assert len(borne) >= 10
    assert set(borne.values()) == {"ok"}, borne


@pytest.mark.needs("root")
def test_a_full_disk_is_borne(figures):
    assert figures["faults"][DISK_FULL] == "ok"
