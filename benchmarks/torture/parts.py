"""Each part of `make torture`: what it found as a table, and what speaks against it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.results.result import Column, Table
from benchmarks.torture.answers import LIMIT
from benchmarks.torture.bars import bars
from benchmarks.torture.cancels import measure_cancels
from benchmarks.torture.faults_around import measure_faults_around
from benchmarks.torture.faults_of_learner import measure_faults_of_learner
from benchmarks.torture.fuzz import measure_fuzz
from benchmarks.torture.kills import measure_kills
from benchmarks.torture.nodes import worst
from benchmarks.torture.soak import Soak, measure_soak
from benchmarks.torture.soak_figure import draw_memory

SEED = 19  # of all random choices
MOST_MEGABYTES = 1500.0  # bar of the memory of a node
MOST_GROWTH = 5.0  # MB by which a node may grow in a soak after its first minute; of the bars


@dataclass(frozen=True)
class Found:
    """What a part found."""

    figures: Mapping[str, Any]  # key figures
    table: Table  # what was measured
    missed: Sequence[str]  # bars that were missed, and what ended it early
    # writes its figure to a path; None where there is none
    draw: Callable[[Path], None] | None = None


def kill(folder: Path, count: int, rng: np.random.Generator) -> Found:
    """Kill nodes at random instants."""
    found = measure_kills(folder, count, SEED, rng)
    figures = {"kills": found.kills, "lost": found.lost, "corrupted": len(found.corrupted)}
    table = Table(
        title="Killed at random instants, under load",
        note="Four in five are of the learner while it is given observations and parameters, the "
        "others of perception and the predictor while they see and predict a camera's throws.",
        columns=[
            Column(name)
            for name in ("kills", "answered", "lost", "corrupted", "not back", "died by themselves")
        ],
        rows=[
            [
                found.kills,
                found.answered,
                found.lost,
                len(found.corrupted),
                found.not_back,
                len(found.deaths),
            ]
        ],
        remarks=[*found.corrupted, *found.deaths, *found.failures],
    )
    missed = [
        f"{value} {name}; expected none"
        for name, value in (("lost", found.lost), ("not back after a kill", found.not_back))
        if value
    ]
    missed += [f"corrupted: {one}" for one in found.corrupted]
    if found.kills < count:
        missed.append(f"{found.kills} kills; expected {count}")
    return Found(figures, table, [*missed, *found.deaths, *found.failures])


def fuzz(folder: Path, count: int, rng: np.random.Generator) -> Found:
    """Send messages and calls that nobody expects."""
    found = measure_fuzz(folder, count, rng)
    stop = slowest_stop(found.stops)
    figures = {
        "fuzzed": found.sent,
        "deaths": len(found.deaths),
        "hangs": len(found.slow) + len(found.unanswered),
        "answer_s_worst": round(found.slowest, 2),
        "memory_bound_mb": round(found.megabytes),
        "stop_s_worst": round(stop, 2),
    }
    table = Table(
        title="Messages and calls made from the interface definitions",
        note="Each node is pinged all the while; a ping that is not answered within "
        f"{bars().answer:g} s is a hang, and so is a request to a service or an action that is not "
        f"answered within {LIMIT:g} s.",
        columns=[
            Column("sent"),
            Column("deaths"),
            Column("slow pings"),
            Column("requests without an answer"),
            Column("slowest answer", "s", ".2f"),
            Column("most memory", "MB", ".0f"),
            Column("slowest stop", "s", ".2f"),
        ],
        rows=[
            [
                found.sent,
                len(found.deaths),
                len(found.slow),
                len(found.unanswered),
                found.slowest,
                found.megabytes,
                stop,
            ]
        ],
        remarks=[*found.deaths, *found.failures],
    )
    missed = [*found.deaths, *found.failures, *missed_stops(found.stops)]
    missed += [f"{name} answered a ping after {took:.1f} s" for name, took in found.slow]
    missed += [f"{what} was not answered within {LIMIT:g} s" for what in found.unanswered]
    if found.megabytes > MOST_MEGABYTES:
        missed.append(f"{found.megabytes:.0f} MB; expected at most {MOST_MEGABYTES:.0f}")
    if found.sent < count:
        missed.append(f"{found.sent} messages; expected {count}")
    return Found(figures, table, missed)


def cancel(folder: Path, count: int, rng: np.random.Generator) -> Found:
    """Cancel searches at random instants."""
    found = measure_cancels(folder, count, rng)
    longest = worst(found.took)
    table = Table(
        title="Searches cancelled at random instants",
        note="All methods; every fourth learns from boxes that tumble for minutes. Counted from "
        "the request to cancel to the result; searches that had ended before are left out.",
        columns=[
            Column("cancelled"),
            Column("median", "ms", ".0f"),
            Column("longest", "ms", ".0f"),
        ],
        rows=[
            [
                len(found.took),
                1e3 * float(np.median(found.took)) if found.took else None,
                1e3 * longest if found.took else None,
            ]
        ],
        remarks=found.failures,
    )
    missed = [*found.failures]
    if not found.took:
        missed.append("no search was cancelled")
    if longest > bars().cancel:
        missed.append(f"a search ended {longest:.2f} s after it was cancelled")
    return Found({"cancel_s_worst": round(longest, 2)}, table, missed)


def bear_faults(folder: Path, *, quick: bool) -> Found:
    """Bring about faults of the machine and of what is around."""
    faults = {
        **measure_faults_of_learner(folder),
        **measure_faults_around(folder, SEED, quick=quick),
    }
    table = Table(
        title="Faults of the machine and of what is around",
        note="README.md says what has to be true for each.",
        columns=[Column("fault"), Column("found")],
        rows=[[name, found] for name, found in faults.items()],
    )
    missed = [f"{name}: {found}" for name, found in faults.items() if found != "ok"]
    return Found({"faults": faults}, table, missed)


def soak(folder: Path, minutes: float) -> Found:
    """Run the suite at full rate for a long time."""
    found = measure_soak(folder, minutes, SEED)
    nodes = found.nodes
    least, most = min(found.rates, default=0.0), max(found.rates, default=0.0)
    figures = {
        "minutes": minutes,
        "frames": found.frames,
        "rss_growth_mb": {name: node.growth() for name, node in nodes.items()},
        "rss_mb_each_minute": {
            name: [round(value, 1) for value in node.memory] for name, node in nodes.items()
        },
        "threads": {name: node.threads[-1] for name, node in nodes.items()},
        "fds": {name: node.files[-1] for name, node in nodes.items()},
        "prediction_hz_min": round(least, 1),
        "answer_s_worst": round(found.slowest, 2),
        "stop_s_worst": round(slowest_stop(found.stops), 2),
    }
    missed = [*found.failures, *missed_stops(found.stops)]
    for name, node in nodes.items():
        grown, largest = node.growth(), max(node.memory)
        if grown is not None and grown > MOST_GROWTH:
            missed.append(f"{name} grew by {grown:.1f} MB; expected at most {MOST_GROWTH:g}")
        if largest > MOST_MEGABYTES:
            missed.append(f"{name} had {largest:.0f} MB; expected at most {MOST_MEGABYTES:.0f}")
    if least < bars().kept_rate * most:
        missed.append(f"{least:.0f} predictions a second in one minute, {most:.0f} in another")
    if found.slowest > bars().answer:
        missed.append(f"a ping was answered after {found.slowest:.1f} s")
    draw = partial(draw_memory, found) if nodes else None
    return Found({"soak": figures}, _soak_table(found), missed, draw)


def _soak_table(found: Soak) -> Table:
    return Table(
        title=f"{found.minutes:g} minutes at full rate",
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
                *(f"{one[:2][-1]}, {one[-1]}" for one in (node.threads, node.files)),
            ]
            for name, node in found.nodes.items()
        ],
        remarks=found.failures,
    )


Stops = Mapping[str, tuple[float, int]]  # time that each node took to stop, s, and its exit code


def slowest_stop(stops: Stops) -> float:
    """Return the longest time, s; zero of none."""
    return worst([seconds for seconds, _ in stops.values()])


def missed_stops(stops: Stops) -> list[str]:
    """Return what was wrong with the ends of nodes."""
    missed = [f"{name} ended with code {code}" for name, (_, code) in stops.items() if code]
    return missed + [
        f"{name} took {took:.1f} s to stop; expected at most {bars().stop:g}"
        for name, (took, _) in stops.items()
        if took > bars().stop
    ]
