"""What a new observation costs the more of them are stored: CPU time, and memory."""

from __future__ import annotations

import itertools
import multiprocessing
import resource
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.command import Outcome, report_progress
from benchmarks.learning.online import learn_what_is_stored
from benchmarks.learning.paper_sets import ball_throws, learn_by_default
from benchmarks.learning.stream_start import Start, measure_start
from benchmarks.results.result import Column, Table
from intuitive_physics.simulation import make_simulator
from intuitive_physics_learner import ObservationStore
from intuitive_physics_learner.online.options import OnlineOptions

# Numbers of stored observations at which the next ones are measured
STORED, QUICK_STORED = (100, 1000, 10000), (10, 40)
MEASURED, QUICK_MEASURED = 5, 2  # observations whose mean cost counts
# s of wall time after which a number of stored observations counts as not measured
PATIENCE = 240.0
WORKERS = 2  # processes side by side, each with one thread; their CPU time is measured
START_STORED, QUICK_START_STORED = 100_000, 2000  # observations in the database it starts on
START_BAR = 2.0  # s within which it is to be ready, issue 17
COST_BAR = 1.5  # largest CPU time at the largest number over that at the smallest, issue 17
BATCH = 1000  # observations that are stored at once
SEARCHED = 20  # observations that are learned from at once in the beginning
# Observations that are learned from on-line, one by one, before those that are measured: more
# than are fitted jointly, and none of those measured is one at which all that is kept is fitted
RECENT, QUICK_RECENT = 32, 4


@dataclass(frozen=True)
class StreamCost:
    """Cost of new observations beside a number of stored ones."""

    stored: int
    cpu_seconds: tuple[float, ...]  # of each new one, from storing it until all is learned
    recent_seconds: float  # mean CPU time of those before
    rss_megabytes: float  # largest resident memory of the process

    @property
    def mean(self) -> float:
        """Mean CPU time of a new observation in s."""
        return float(np.mean(self.cpu_seconds))


# By the number of stored observations; None where it was not measured in time
Costs = dict[int, StreamCost | None]


def measure_cost(stored: int, recent: int, measured: int, seed: int, folder: Path) -> StreamCost:
    """Learn on-line in a store of many observations, and measure the last `measured` ones.

    The store is that of a user who has asked for a search over what was stored before the recent
    ones. That search was over a few only, which does not change what a new observation costs.
    """
    stream = ball_throws(seed)
    simulator, options = make_simulator("auto", threads=1), OnlineOptions()
    with ObservationStore(folder / "learner.sqlite3") as store:
        first = list(itertools.islice(stream, min(SEARCHED, stored - recent)))
        store.add_all(first)
        searched = [observation.id for observation in first]
        while len(searched) < stored - recent:
            batch = list(itertools.islice(stream, min(BATCH, stored - recent - len(searched))))
            store.add_all(batch)
            searched += [observation.id for observation in batch]
        learned = learn_by_default(first, threads=1).parameters
        # As after a search over all of them: on-line learning goes on with what came since.
        learned = replace(learned, observation_count=len(searched))
        store.add_improvement(learned, on=store.newest_version(), learned_from=searched)
        seconds = []
        for observation in itertools.islice(stream, recent + measured):
            began = time.process_time()
            store.add(observation)
            learn_what_is_stored(store, simulator, options)
            seconds.append(time.process_time() - began)
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    return StreamCost(stored, tuple(seconds[recent:]), float(np.mean(seconds[:recent])), memory)


def _measured_apart(stored: int, recent: int, measured: int, seed: int) -> StreamCost | None:
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


def measure(quick: bool, first_seed: int) -> Outcome:
    """Measure at all numbers of stored observations."""
    numbers = QUICK_STORED if quick else STORED
    recent, measured = (QUICK_RECENT, QUICK_MEASURED) if quick else (RECENT, MEASURED)
    report_progress(f"streams with {', '.join(map(str, numbers))} observations stored")
    with ThreadPoolExecutor(WORKERS) as pool:
        costs = dict(
            zip(
                numbers,
                pool.map(lambda n: _measured_apart(n, recent, measured, first_seed), numbers),
                strict=True,
            )
        )
    start_stored = QUICK_START_STORED if quick else START_STORED
    report_progress(f"start with {start_stored} observations stored")
    start = measure_start(start_stored)
    return Outcome(
        tables=[_cost_table(costs), _start_table([measure_start(1), start])],
        key_figures={"stream": figures(costs, start)},
        complaints=_complaints(costs, start),
    )


def figures(costs: Costs, start: Start) -> dict[str, Any]:
    """Return the entry of the last line; null for what was not measured in time."""
    memory = [cost.rss_megabytes for cost in costs.values() if cost is not None]
    return {
        "cpu_s_at": {
            str(stored): None if cost is None else round(cost.mean, 4)
            for stored, cost in costs.items()
        },
        f"start_s_at_{start.stored}": round(start.process_seconds, 3),
        "rss_mb": round(max(memory), 1) if memory else None,
    }


def growth(costs: Costs) -> float | None:
    """Cost at the largest number of stored observations over that at the smallest."""
    first, last = costs[min(costs)], costs[max(costs)]
    return None if first is None or last is None else last.mean / first.mean


def _cost_table(costs: Costs) -> Table:
    smallest = costs[min(costs)]

    def measured(cell: Callable[[StreamCost], float | None]) -> Callable[[int], float | None]:
        """Return a function of the number of stored observations; None where not measured."""
        return lambda stored: None if (cost := costs[stored]) is None else cell(cost)

    return Table.of(
        "A stream: what a new observation costs on-line",
        costs,
        [
            (Column("stored"), lambda stored: stored),
            (Column("measured"), measured(lambda c: len(c.cpu_seconds))),
            (Column("CPU time of each, mean", "s", ".3f"), measured(lambda c: c.mean)),
            (Column("worst", "s", ".3f"), measured(lambda c: max(c.cpu_seconds))),
            (
                Column(f"mean over that at {min(costs)}", "", ".2f"),
                measured(lambda c: None if smallest is None else c.mean / smallest.mean),
            ),
            (Column("bar of that at the largest", "", "g"), lambda stored: COST_BAR),
            (Column("those before, mean", "s", ".3f"), measured(lambda c: c.recent_seconds)),
            (Column("largest resident memory", "MB", ".0f"), measured(lambda c: c.rss_megabytes)),
        ],
        note=(
            f"Throws of a ball, each number in a process of its own with one thread; – where it "
            f"took more than {PATIENCE:g} s. The defaults cost nothing and learn nothing."
        ),
    )


def _start_table(starts: Sequence[Start]) -> Table:
    return Table.of(
        "A fresh process that opens a database, and finds θ_s and all materials in it",
        starts,
        [
            (Column("stored"), lambda s: s.stored),
            (Column("with all imports", "s", ".2f"), lambda s: s.process_seconds),
            (Column("bar", "s", "g"), lambda s: START_BAR),
            (Column("opening alone", "s", ".3f"), lambda s: s.seconds),
            (Column("its CPU time", "s", ".3f"), lambda s: s.cpu_seconds),
            (Column("resident memory", "MB", ".0f"), lambda s: s.rss_megabytes),
            (Column("file", "MB", ".0f"), lambda s: s.file_megabytes),
        ],
        note="`start_s_at_…` is with all imports, but for those of ROS.",
    )


def _complaints(costs: Costs, start: Start) -> list[str]:
    complaints = [
        f"stream: not measured at {stored} stored observations within {PATIENCE:g} s"
        for stored, cost in costs.items()
        if cost is None
    ]
    grown = growth(costs)
    if grown is not None and grown > COST_BAR:
        complaints.append(
            f"stream: CPU time at {max(costs)} is {grown:.2f} of that at {min(costs)}, "
            f"bar {COST_BAR:g}"
        )
    if start.process_seconds > START_BAR:
        complaints.append(
            f"stream: start_s_at_{start.stored} {start.process_seconds:.2f}, bar {START_BAR:g}"
        )
    return complaints
