"""A run that is cut off at any instant leaves nothing: no process, no mount, no shared memory.

`python -m test.test_cut_off NUMBER` cuts off more runs than `make test` does.
"""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
import uuid
from dataclasses import dataclass
from pathlib import Path

import pytest

pytestmark = pytest.mark.long

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

MOMENT = 2.0
"""s after which nothing may be left."""


@dataclass(frozen=True)
class Remains:
    """What a run has left behind.

    Parameters
    ----------
    was_running : whether it had not ended when it was cut off
    processes : command lines
    mounts : folders
    segments : files of shared memory that belong to no process, MB in all
    """

    was_running: bool
    processes: list[str]
    mounts: list[str]
    segments: float


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


def segments() -> dict[str, int]:
    """Return the sizes of the segments of shared memory that DDS has made."""
    return {
        file.name: file.stat().st_size
        for file in Path("/dev/shm").glob("fastrtps_*")
        if not file.name.startswith("fastrtps_port")
    }


def mapped() -> str:
    """Return what all processes have mapped."""
    maps = []
    for file in Path("/proc").glob("[0-9]*/maps"):
        try:
            maps.append(file.read_text())
        except OSError:  # it has ended, or belongs to another user
            continue
    return "".join(maps)


def mounts() -> set[str]:
    return {line.split()[1] for line in Path("/proc/mounts").read_text().splitlines()}


def cut_off(kind: str, number: int, rng: random.Random, folder: Path) -> Remains:
    """Start a run, end it by a signal at a random instant, and return what it has left."""
    arguments, longest = RUNS[kind]
    mark = uuid.uuid4().hex
    before, mounted = set(segments()), mounts()
    run = subprocess.Popen(
        [sys.executable, *arguments],
        cwd=folder if kind == "demo" else ROOT,
        env={**os.environ, "CUT_OFF": mark, "ROS_DOMAIN_ID": str(rng.randint(1, 100))},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        time.sleep(rng.uniform(0.3, longest))
        was_running = run.poll() is None
        run.send_signal(number)
        time.sleep(MOMENT)
        ended = run.poll() is not None
        left = processes_of(mark)
        own = {name: size for name, size in segments().items() if name not in before}
        held = mapped()
        return Remains(
            was_running,
            list(left.values()) if ended else ["the run itself", *left.values()],
            sorted(mounts() - mounted),
            sum(size for name, size in own.items() if name not in held) / 1e6,
        )
    finally:
        for pid in processes_of(mark):
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
    assert left == Remains(True, [], [], 0.0), f"seed {seed}"


def main() -> None:
    """Cut off so many runs of each kind by each signal, and print what they leave."""
    rng = random.Random(19)
    for kind in RUNS:
        for number in SIGNALS * int(sys.argv[1]):
            left = cut_off(kind, number, rng, Path("/tmp"))
            print(
                f"{kind} {number.name} {'' if left.was_running else '(it had ended)'}: "
                f"{len(left.processes)} processes, "
                f"{len(left.mounts)} mounts, "
                f"{left.segments:.0f} MB of shared memory; {left.processes}",
                flush=True,
            )


if __name__ == "__main__":
    main()
