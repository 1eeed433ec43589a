"""The suite at full rate for a long time: memory, threads, files and rate stay what they were."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks.command import report_progress
from benchmarks.torture.early_end import EarlyEndError, noted
from benchmarks.torture.nodes import blamed_on_death, last_words, megabytes
from benchmarks.torture.suite import Suite, rate_of, running_suite
from intuitive_physics.processes.child_process import LONGEST

MINUTE = 60.0  # s
SAMPLE = 5.0  # s between two looks at the processes
SPOKEN = 5  # minutes between two lines of progress


@dataclass
class Watched:
    """A node, and what it started: the most of each minute."""

    memory: list[float] = field(default_factory=list)  # MB resident
    # threads, files: of the node alone, open ones
    threads: list[int] = field(default_factory=list)
    files: list[int] = field(default_factory=list)

    def note(self, minute: int, memory: float, threads: int, files: int) -> None:
        """Take account of a look in a minute."""
        self.memory[minute:] = [max([memory, *self.memory[minute:]])]
        self.threads[minute:] = [max([threads, *self.threads[minute:]])]
        self.files[minute:] = [max([files, *self.files[minute:]])]

    def growth(self) -> float | None:
        """Return the MB from the second minute to the last; None where it did not live so long.

        What goes up and down with each search and comes back within a minute is no growth.
        """
        return round(self.memory[-1] - self.memory[1], 1) if len(self.memory) > 2 else None


@dataclass
class Soak:
    """What was seen."""

    minutes: float  # how long it was to last
    frames: int = 0  # images that the camera published
    nodes: dict[str, Watched] = field(default_factory=dict)  # by their names
    # predictions a second of each whole minute, while something was followed
    rates: list[float] = field(default_factory=list)
    slowest: float = 0.0  # s, of a ping of any node, one a minute each
    # s that each node took to stop at the end, and its exit code
    stops: dict[str, tuple[float, int]] = field(default_factory=dict)
    failures: list[str] = field(default_factory=list)  # what ended it early


def measure_soak(folder: Path, minutes: float, seed: int) -> Soak:
    """Run the suite for so long, or until a node dies, and look at it now and then."""
    found = Soak(minutes=minutes)
    longest = 2.0 * minutes * MINUTE + LONGEST
    with noted(found.failures), running_suite(folder, seed, longest=longest) as suite:
        first = suite.camera.frames
        with noted(found.failures):
            _watch(suite, found)
        found.frames = suite.camera.frames - first
        found.stops = suite.nodes.stop()
    return found


def _watch(suite: Suite, found: Soak) -> None:
    begun = time.monotonic()
    end = begun + found.minutes * MINUTE
    while (now := time.monotonic()) < end:
        try:
            _watch_minute(suite, found, min(MINUTE, end - now))
        except EarlyEndError as error:
            passed = (time.monotonic() - begun) / MINUTE
            raise EarlyEndError(
                f"{error} (after {passed:.1f} of {found.minutes:g} minutes)"
            ) from None
        if len(found.rates) % SPOKEN == 0:
            report_progress(f"soak: {len(found.rates)} of {found.minutes:g} minutes")


def _watch_minute(suite: Suite, found: Soak, seconds: float) -> None:
    minute, end = len(found.rates), time.monotonic() + seconds
    arrivals: list[float] = []
    while (left := end - time.monotonic()) > 0.0:
        time.sleep(min(SAMPLE, left))
        arrivals += [arrival for arrival, _ in suite.predictions.take()]
        for name, process in suite.nodes.processes.items():
            folder = Path(f"/proc/{process.pid}")
            with blamed_on_death(name, process):
                threads, files = (len(list((folder / of).iterdir())) for of in ("task", "fd"))
            if not process.is_running:
                raise EarlyEndError(last_words(name, process))
            watched = found.nodes.setdefault(name, Watched())
            watched.note(minute, megabytes(process.pid), threads, files)
    found.rates.append(rate_of(arrivals))
    found.slowest = max(found.slowest, *map(suite.nodes.ping, suite.nodes.processes))
