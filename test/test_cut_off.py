"""A run that is cut off at any instant leaves nothing: no process, no mount, no shared memory."""

from __future__ import annotations

import fcntl
import os
import random
import re
import signal
import subprocess
import sys
import time
import uuid
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

PYTEST = ["-m", "pytest", "-p", "no:dash", "-q", "-x"]

RUNS = {
    "kills": (["-m", "benchmarks.torture", "--quick", "--only", "kills"], 8.0),
    "faults": (["-m", "benchmarks.torture", "--quick", "--only", "faults"], 20.0),
    "robot": (["-m", "benchmarks.robot", "--quick"], 12.0),
    "demo": (["-m", "intuitive_physics_experiments.demo", "--throws", "3"], 12.0),
    "benchmark": (["-m", "benchmarks.learning", "--quick"], 6.0),
    "tests": (
        [
            *PYTEST,
            "-n2",
            "src/intuitive_physics_learner/test/nodes",
            "src/intuitive_physics_ros/test",
        ],
        12.0,
    ),
}
"""Arguments of Python that start each kind of run, and the s within which it is cut off."""

SIGNALS = (signal.SIGTERM, signal.SIGKILL)

PATIENCE = 10.0
"""s within which everything has to be gone; it takes less than 2 on a machine that is not busy."""


@dataclass(frozen=True)
class Remains:
    """What a run has left behind.

    Parameters
    ----------
    was_running : whether it had not ended when it was cut off
    things : processes, mounts and segments of shared memory that no process holds
    """

    was_running: bool
    things: list[str]


def environment() -> dict[str, str]:
    """Return this environment without pytest's, with a ROS domain that no other test has."""
    own = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST_")}
    domain = (int(own.get("ROS_DOMAIN_ID", "0")) + 50) % 100 + 1
    return {**own, "ROS_DOMAIN_ID": str(domain)}


def processes_of(mark: str) -> dict[int, str]:
    """Return the processes that were started with this mark in their environment."""
    found = {}
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            if mark.encode() in (folder / "environ").read_bytes():
                found[int(folder.name)] = (folder / "cmdline").read_text().replace("\0", " ")
        except OSError:  # it has ended, or belongs to another user
            continue
    return {pid: command[:150] for pid, command in found.items() if command}


def segments_of(pids: Iterable[int]) -> set[Path]:
    """Return the segments of shared memory that processes have mapped."""
    found = set()
    for pid in pids:
        with suppress(OSError):  # it has ended
            maps = Path(f"/proc/{pid}/maps").read_text()
            found |= {Path(name) for name in re.findall(r"/dev/shm/fastrtps_[0-9a-f]{16}\b", maps)}
    return found


def mounts() -> set[str]:
    return {line.split()[1] for line in Path("/proc/mounts").read_text().splitlines()}


def remains(mark: str, segments: set[Path], mounted: set[str]) -> list[str]:
    """Return what there is of a run."""
    return [
        *processes_of(mark).values(),
        *sorted(mounts() - mounted),
        *(str(file) for file in sorted(segments) if file.exists() and not is_held(file)),
    ]


def is_held(segment: Path) -> bool:
    """Whether a living process holds the lock of a segment: none of the run, or it is found too.

    A process maps the segments of all participants of its domain, which another test may share.
    """
    try:
        with segment.with_name(f"{segment.name}_el").open() as lock:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except FileNotFoundError:
        return False
    return False


def cut_off(kind: str, number: int, rng: random.Random, folder: Path) -> Remains:
    """Start a run, end it by a signal at a random instant, and return what is left of it."""
    arguments, longest = RUNS[kind]
    mark = uuid.uuid4().hex
    segments: set[Path] = set()
    mounted = mounts()
    run = subprocess.Popen(
        [sys.executable, *arguments],
        cwd=folder if kind == "demo" else ROOT,
        env={**environment(), "CUT_OFF": mark},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        end = time.monotonic() + rng.uniform(0.3, longest)
        while time.monotonic() < end:
            segments |= segments_of(processes_of(mark))
            time.sleep(0.05)
        was_running = run.poll() is None
        run.send_signal(number)
        end = time.monotonic() + PATIENCE
        while (left := remains(mark, segments, mounted)) and time.monotonic() < end:
            time.sleep(0.2)
        return Remains(was_running, left)
    finally:
        for pid in processes_of(mark):
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        run.wait()
        for folder_left in mounts() - mounted:
            subprocess.run(["umount", "-l", folder_left], check=False)


@pytest.mark.parametrize("number", SIGNALS, ids=lambda number: number.name)
@pytest.mark.parametrize(
    "kind",
    [
        pytest.param(kind, marks=[pytest.mark.needs("ros2launch")] if kind == "robot" else [])
        for kind in RUNS
    ],
)
def test_a_run_that_is_cut_off_leaves_nothing(kind, number, tmp_path):
    seed = random.SystemRandom().randrange(1000)
    left = cut_off(kind, number, random.Random(seed), tmp_path)
    assert left == Remains(True, []), f"seed {seed}"


def test_a_segment_is_left_where_nobody_has_its_lock(tmp_path):
    segment = tmp_path / "fastrtps_0123456789abcdef"
    segment.touch()
    assert not is_held(segment)
    with (tmp_path / f"{segment.name}_el").open("w") as lock:
        assert not is_held(segment)
        fcntl.flock(lock, fcntl.LOCK_EX)
        assert is_held(segment)
    assert not is_held(segment)
