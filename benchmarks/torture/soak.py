"""The suite at full rate for a long time: memory, threads, files and rate have to stay constant."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from matplotlib.figure import Figure

from benchmarks.command import Outcome, report_progress
from benchmarks.results.result import Column, Table
from benchmarks.running_nodes import prediction_rate
from benchmarks.torture.bars import bars
from benchmarks.torture.early_end import EarlyEndError, noted
from benchmarks.torture.nodes import blamed_on_death, last_words, megabytes
from benchmarks.torture.part import (
    MOST_MEGABYTES,
    SEED,
    Stops,
    missed_stops,
    slowest_stop,
)
from benchmarks.torture.suite import Suite, running_suite
from intuitive_physics.processes.child_process import LONGEST

MINUTE = 60.0  # s
SAMPLE = 5.0  # s between two samples of the processes
REPORTED = 5  # minutes between two lines of progress
MOST_GROWTH = 5.0  # MB by which a node may grow after its first minute; of the bars


@dataclass
class Watched:
    """The most of each minute of a node's memory, threads and open files."""

    memory: list[float] = field(default_factory=list)  # MB resident, with the node's children
    threads: list[int] = field(default_factory=list)  # of the node alone
    files: list[int] = field(default_factory=list)  # of the node alone

    def note(self, minute: int, memory: float, threads: int, files: int) -> None:
        """Add a sample of a minute."""
        self.memory[minute:] = [max([memory, *self.memory[minute:]])]
        self.threads[minute:] = [max([threads, *self.threads[minute:]])]
        self.files[minute:] = [max([files, *self.files[minute:]])]

    def growth(self) -> float | None:
        """Return the MB from the second minute to the last; None where it did not live so long.

        Memory that goes up and down with each search and comes back within a minute is no growth.
        """
        return round(self.memory[-1] - self.memory[1], 1) if len(self.memory) > 2 else None


@dataclass
class Soak:
    """The course of a soak of some minutes."""

    minutes: float
    frames: int = 0  # images that the camera published
    nodes: dict[str, Watched] = field(default_factory=dict)
    # Predictions a second of each whole minute, while an object was tracked
    rates: list[float] = field(default_factory=list)
    slowest: float = 0.0  # s, of a ping of any node, one a minute each
    stops: Stops = field(default_factory=dict)
    failures: list[str] = field(default_factory=list)  # early ends


def soak(folder: Path, minutes: float) -> Outcome:
    """Run the suite for some minutes, at least 3, or until a node dies, and sample it."""
    course = Soak(minutes)
    longest = 2.0 * minutes * MINUTE + LONGEST
    with noted(course.failures), running_suite(folder, SEED, longest=longest) as suite:
        first = suite.camera.frames
        with noted(course.failures):
            _watch(suite, course)
        course.frames = suite.camera.frames - first
        course.stops = suite.nodes.stop()
    return Outcome(
        [_table(course)],
        {"soak": _figures(course)},
        complaints=_missed(course),
        draw=partial(draw_memory, course) if course.nodes else None,
    )


def _watch(suite: Suite, course: Soak) -> None:
    begin = time.monotonic()
    end = begin + course.minutes * MINUTE
    while (now := time.monotonic()) < end:
        try:
            _watch_minute(suite, course, min(MINUTE, end - now))
        except EarlyEndError as error:
            passed = (time.monotonic() - begin) / MINUTE
            raise EarlyEndError(
                f"{error} (after {passed:.1f} of {course.minutes:g} minutes)"
            ) from None
        if len(course.rates) % REPORTED == 0:
            report_progress(f"soak: {len(course.rates)} of {course.minutes:g} minutes")


def _watch_minute(suite: Suite, course: Soak, seconds: float) -> None:
    minute, end = len(course.rates), time.monotonic() + seconds
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
            watched = course.nodes.setdefault(name, Watched())
            watched.note(minute, megabytes(process.pid), threads, files)
    course.rates.append(prediction_rate(arrivals))
    course.slowest = max(course.slowest, *map(suite.nodes.ping, suite.nodes.processes))


def _figures(course: Soak) -> dict[str, object]:
    nodes = course.nodes
    return {
        "minutes": course.minutes,
        "frames": course.frames,
        "rss_growth_mb": {name: node.growth() for name, node in nodes.items()},
        "rss_mb_each_minute": {
            name: [round(value, 1) for value in node.memory] for name, node in nodes.items()
        },
        "threads": {name: node.threads[-1] for name, node in nodes.items()},
        "fds": {name: node.files[-1] for name, node in nodes.items()},
        "prediction_hz_min": round(min(course.rates, default=0.0), 1),
        "answer_s_worst": round(course.slowest, 2),
        "stop_s_worst": round(slowest_stop(course.stops), 2),
    }


def _missed(course: Soak) -> list[str]:
    missed = [*course.failures, *missed_stops(course.stops)]
    for name, node in course.nodes.items():
        grown, largest = node.growth(), max(node.memory)
        if grown is not None and grown > MOST_GROWTH:
            missed.append(f"{name} grew by {grown:.1f} MB; expected at most {MOST_GROWTH:g}")
        if largest > MOST_MEGABYTES:
            missed.append(f"{name} had {largest:.0f} MB; expected at most {MOST_MEGABYTES:.0f}")
    least, most = min(course.rates, default=0.0), max(course.rates, default=0.0)
    if least < bars().kept_rate * most:
        missed.append(f"{least:.0f} predictions a second in one minute, {most:.0f} in another")
    if course.slowest > bars().answer:
        missed.append(f"a ping was answered after {course.slowest:.1f} s")
    return missed


def _table(course: Soak) -> Table:
    return Table(
        title=f"{course.minutes:g} minutes at full rate",
        note="Memory is of a node with what it started, the most of each minute. Growth: that of "
        "the last minute less that of the second. Threads and files are of the node alone.",
        columns=[
            Column("node"),
            Column("growth", "MB", ".1f"),
            Column("memory, last minute", "MB", ".0f"),
            Column("threads, 2nd minute and last"),
            Column("files, 2nd minute and last"),
        ],
        rows=[
            [
                name,
                node.growth(),
                node.memory[-1],
                *(f"{counts[:2][-1]}, {counts[-1]}" for counts in (node.threads, node.files)),
            ]
            for name, node in course.nodes.items()
        ],
        remarks=course.failures,
    )


def draw_memory(course: Soak, path: Path) -> None:
    """Draw the growth of each node since the second minute, so that a slow leak is seen."""
    figure = Figure(figsize=(7.0, 3.0), layout="constrained")
    axes = figure.subplots()
    for name, node in course.nodes.items():
        later = node.memory[1:]
        axes.plot(range(2, 2 + len(later)), [value - later[0] for value in later], ".-", label=name)
    axes.set_xlabel("minute")
    axes.set_ylabel("growth since the second minute (MB)")
    axes.legend()
    figure.savefig(path)
