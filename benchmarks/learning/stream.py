"""What a new observation costs the more of them are stored: CPU time, and memory."""

from __future__ import annotations

import itertools
import multiprocessing
import resource
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.command import report_progress
from benchmarks.learning.online_stream import learn_what_is_stored
from benchmarks.learning.part import Findings, Part, Plan
from benchmarks.learning.public_learning import learn_by_default
from benchmarks.learning.stream_start import start_seconds
from benchmarks.results.result import Cell, Column, Table
from intuitive_physics.observation import Observation
from intuitive_physics.shapes import Sphere
from intuitive_physics.simulation import make_simulator
from intuitive_physics_experiments.paper.paper_dataset import throw_objects
from intuitive_physics_experiments.paper.paper_room import (
    dataset_simulator,
    draw_parameters,
    draw_pool,
)
from intuitive_physics_learner import ObservationStore
from intuitive_physics_learner.online.options import OnlineOptions

STORED, QUICK_STORED = (100, 1000, 10000), (20, 100)
"""Numbers of stored observations at which the next ones are measured."""

MEASURED, QUICK_MEASURED = 5, 2
"""Observations whose mean cost counts."""

PATIENCE = 240.0
"""s of wall time after which a number of stored observations counts as not measured."""

WORKERS = 2
"""Processes side by side, each with one thread; their CPU time is measured."""

START_STORED = 100_000
"""Observations in the database that a learner starts on."""

START_BAR = 2.0
"""s within which it is to be ready, issue 17."""

COST_BAR = 1.5
"""CPU time at most at the largest number over that at the smallest, issue 17."""

BATCH = 1000
"""Observations that are stored at once."""

SEARCHED = 20
"""Observations that are learned from at once in the beginning."""

RECENT, QUICK_RECENT = 30, 4
"""Observations that are learned from on-line, one by one, before those that are measured; more than
are fitted jointly."""


@dataclass(frozen=True)
class StreamCost:
    """Cost of new observations beside a number of stored ones.

    Parameters
    ----------
    stored : observations before them
    cpu_seconds : of each of the next ones, from storing it until all is learned
    recent_seconds : mean CPU time of those before
    rss_megabytes : largest resident memory of the process
    """

    stored: int
    cpu_seconds: tuple[float, ...]
    recent_seconds: float
    rss_megabytes: float

    @property
    def mean(self) -> float:
        """Mean CPU time of a new observation in s."""
        return float(np.mean(self.cpu_seconds))


def endless_stream(seed: int) -> Iterator[Observation]:
    """Yield throws of one ball through the paper's room, without end.

    The first ones of a seed are the same however many are taken.
    """
    rng = np.random.default_rng(seed)
    pool = draw_pool(1, rng, [Sphere.kind])
    simulator = dataset_simulator("auto")
    true = draw_parameters(pool, rng)
    while True:
        yield throw_objects(pool, true, simulator, "three_points", rng).observation


def measure_cost(stored: int, recent: int, measured: int, seed: int, folder: Path) -> StreamCost:
    """Learn on-line in a store that holds many observations, and measure the last ones.

    The store is that of a user who has asked for a search over what was stored before. That search
    was over a few only, which does not change what a new observation costs.

    Parameters
    ----------
    stored : observations before the measured ones
    recent : of these, those that are learned from on-line
    measured : observations whose cost is measured
    seed : of the stream
    folder : of the database
    """
    stream = endless_stream(seed)
    simulator, options = make_simulator("auto", threads=1), OnlineOptions()
    with ObservationStore(folder / "learner.sqlite3") as store:
        first = list(itertools.islice(stream, min(SEARCHED, stored - recent)))
        store.add_all(first)
        while store.count() < stored - recent:
            count = min(BATCH, stored - recent - store.count())
            store.add_all(list(itertools.islice(stream, count)))
        learned = learn_by_default(first, threads=1).parameters
        store.add_parameters(replace(learned, observation_count=store.count()))
        seconds = []
        for observation in itertools.islice(stream, recent + measured):
            began = time.process_time()
            store.add(observation)
            learn_what_is_stored(store, simulator, options)
            seconds.append(time.process_time() - began)
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    return StreamCost(stored, tuple(seconds[recent:]), float(np.mean(seconds[:recent])), memory)


def measured_apart(stored: int, recent: int, measured: int, seed: int) -> StreamCost | None:
    """Measure in a process of its own; None where that fails or takes longer than `PATIENCE`."""
    context = multiprocessing.get_context("spawn")
    receiver, sender = context.Pipe(duplex=False)
    with tempfile.TemporaryDirectory() as folder:
        process = context.Process(
            target=_send, args=(sender, stored, recent, measured, seed, Path(folder))
        )
        process.start()
        sender.close()
        try:
            return receiver.recv() if receiver.poll(PATIENCE) else None
        except EOFError:
            # It has failed, and printed why.
            return None
        finally:
            process.terminate()
            process.join()


def _send(
    sender: Connection, stored: int, recent: int, measured: int, seed: int, folder: Path
) -> None:
    sender.send(measure_cost(stored, recent, measured, seed, folder))


def measure(plan: Plan) -> Findings:
    """Measure at all numbers of stored observations."""
    numbers = QUICK_STORED if plan.quick else STORED
    recent, measured = (QUICK_RECENT, QUICK_MEASURED) if plan.quick else (RECENT, MEASURED)
    report_progress(f"streams with {', '.join(map(str, numbers))} observations stored")
    with ThreadPoolExecutor(WORKERS) as pool:
        costs = pool.map(
            lambda stored: measured_apart(stored, recent, measured, plan.first_seed), numbers
        )
        found = dict(zip(numbers, costs, strict=True))
    report_progress(f"start with {START_STORED} observations stored")
    start = start_seconds(START_STORED)
    complaints = list(_complaints(found))
    if start["process_seconds"] > START_BAR:
        complaints.append(
            f"stream: start_s_at_{START_STORED} {start['process_seconds']:.2f}, bar {START_BAR:g}"
        )
    return Findings(
        tables=[_cost_table(found), _start_table({1: start_seconds(1), START_STORED: start})],
        figures={"stream": figures(found, start["process_seconds"])},
        complaints=complaints,
    )


def figures(found: dict[int, StreamCost | None], start_seconds: float | None) -> dict[str, Any]:
    """Return the entry of the last line; null for what was not measured in time."""
    memory = [cost.rss_megabytes for cost in found.values() if cost is not None]
    return {
        "cpu_s_at": {
            str(stored): None if cost is None else round(cost.mean, 4)
            for stored, cost in found.items()
        },
        "start_s_at_100000": None if start_seconds is None else round(start_seconds, 3),
        "rss_mb": round(max(memory), 1) if memory else None,
    }


def growth(found: dict[int, StreamCost | None]) -> float | None:
    """Cost at the largest number of stored observations over that at the smallest."""
    first, last = found[min(found)], found[max(found)]
    return None if first is None or last is None else last.mean / first.mean


def _cost_table(found: dict[int, StreamCost | None]) -> Table:
    smallest = found[min(found)]
    rows: list[list[Cell]] = []
    for stored, cost in found.items():
        if cost is None:
            rows.append([stored, None, None, None, None, COST_BAR, None, None])
            continue
        rows.append(
            [
                stored,
                len(cost.cpu_seconds),
                cost.mean,
                max(cost.cpu_seconds),
                None if smallest is None else cost.mean / smallest.mean,
                COST_BAR,
                cost.recent_seconds,
                cost.rss_megabytes,
            ]
        )
    return Table(
        title="A stream: what a new observation costs on-line",
        columns=[
            Column("stored"),
            Column("measured"),
            Column("CPU time of each, mean", "s", ".3f"),
            Column("worst", "s", ".3f"),
            Column(f"mean over that at {min(found)}", "", ".2f"),
            Column("bar of that at the largest", "", "g"),
            Column("those before, mean", "s", ".3f"),
            Column("largest resident memory", "MB", ".0f"),
        ],
        rows=rows,
        note=(
            f"Throws of a ball, each number in a process of its own with one thread; – where it "
            f"took more than {PATIENCE:g} s. The defaults cost nothing and learn nothing."
        ),
    )


def _start_table(found: Mapping[int, Mapping[str, float]]) -> Table:
    rows: list[list[Cell]] = [
        [
            stored,
            start["process_seconds"],
            START_BAR,
            start["seconds"],
            start["cpu_seconds"],
            start["rss_mb"],
            start["file_mb"],
        ]
        for stored, start in found.items()
    ]
    return Table(
        title="A fresh process that opens a database, and finds θ_s and all materials in it",
        columns=[
            Column("stored"),
            Column("with all imports", "s", ".2f"),
            Column("bar", "s", "g"),
            Column("opening alone", "s", ".3f"),
            Column("its CPU time", "s", ".3f"),
            Column("resident memory", "MB", ".0f"),
            Column("file", "MB", ".0f"),
        ],
        rows=rows,
        note="`start_s_at_100000` is with all imports, but for those of ROS.",
    )


def _complaints(found: dict[int, StreamCost | None]) -> Sequence[str]:
    late = [
        f"stream: not measured at {stored} stored observations within {PATIENCE:g} s"
        for stored, cost in found.items()
        if cost is None
    ]
    grown = growth(found)
    if grown is not None and grown > COST_BAR:
        late.append(
            f"stream: CPU time at {max(found)} is {grown:.2f} of that at {min(found)}, "
            f"bar {COST_BAR:g}"
        )
    return late


STREAM = Part("stream", ("stream",), measure)
"""The part of a stream without end."""
