"""The suite at full rate for a long time: memory, threads, files and rate stay what they were."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks.command import report_progress
from benchmarks.torture.nodes import megabytes
from benchmarks.torture.suite import Suite, rate_of, running_suite
from intuitive_physics.processes.child_process import LONGEST

MINUTE = 60.0
"""s."""

SAMPLE = 5.0
"""s between two looks at the processes."""

LOOKS = round(MINUTE / SAMPLE)
"""In a minute."""

SPOKEN = 5
"""Minutes between two lines of progress."""


@dataclass
class Soak:
    """What was seen.

    Parameters
    ----------
    minutes : how long
    frames : images that the camera published
    memory : MB resident of each node, and of what it started, at each look, later ones last
    threads, files : the same of threads, and of open files
    rates : predictions a second of each minute, while something was followed
    """

    minutes: float = 0.0
    frames: int = 0
    memory: dict[str, list[float]] = field(default_factory=dict)
    threads: dict[str, list[int]] = field(default_factory=dict)
    files: dict[str, list[int]] = field(default_factory=dict)
    rates: list[float] = field(default_factory=list)

    def growth(self) -> dict[str, float]:
        """Return the MB by which the memory of each node has grown since the first minute.

        Compared are the largest of the minute after the first, and of the last minute: what goes up
        and down with each search and comes back is no growth.
        """
        return {
            name: round(max(values[-LOOKS:]) - max(values[LOOKS : 2 * LOOKS]), 1)
            for name, values in self.memory.items()
        }


def measure_soak(folder: Path, minutes: float, seed: int) -> Soak:
    """Run the suite for so long, and look at it now and then.

    Parameters
    ----------
    folder : for the database and the rendered throws
    minutes : how long, at least 3
    seed : of the throws
    """
    found = Soak(minutes=minutes)
    with running_suite(folder, seed, longest=2.0 * minutes * MINUTE + LONGEST) as suite:
        first = suite.camera.frames
        end = time.monotonic() + minutes * MINUTE
        while time.monotonic() < end:
            _watch_minute(suite, found, min(MINUTE, end - time.monotonic()))
            if len(found.rates) % SPOKEN == 0:
                report_progress(f"soak: {len(found.rates)} of {minutes:g} minutes")
        found.frames = suite.camera.frames - first
        suite.nodes.revive()
        if suite.nodes.deaths:
            raise RuntimeError(f"a node died: {suite.nodes.deaths[0]}")
    return found


def _watch_minute(suite: Suite, found: Soak, seconds: float) -> None:
    end = time.monotonic() + seconds
    arrivals: list[float] = []
    while (left := end - time.monotonic()) > 0.0:
        time.sleep(min(SAMPLE, left))
        arrivals += [arrival for arrival, _ in suite.predictions.take()]
        for name, process in suite.nodes.processes.items():
            folder = Path(f"/proc/{process.pid}")
            found.memory.setdefault(name, []).append(megabytes(process.pid))
            found.threads.setdefault(name, []).append(len(list((folder / "task").iterdir())))
            found.files.setdefault(name, []).append(len(list((folder / "fd").iterdir())))
    found.rates.append(rate_of(arrivals))
