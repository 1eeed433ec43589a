"""`make torture`: nodes that are killed, fuzzed, cancelled, starved, cut off and never let rest.

README.md in the folder above says what is measured and how.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.command import Outcome, report_progress, run_benchmark, verdict
from benchmarks.results.result import Column, Table
from benchmarks.torture.answers import LIMIT
from benchmarks.torture.bars import PATIENT, bars, use_bars
from benchmarks.torture.cancels import measure_cancels
from benchmarks.torture.faults_around import measure_faults_around
from benchmarks.torture.faults_of_learner import measure_faults_of_learner
from benchmarks.torture.fuzz import measure_fuzz
from benchmarks.torture.interfaces import start_fuzzed
from benchmarks.torture.kills import measure_kills
from benchmarks.torture.nodes import worst
from benchmarks.torture.soak import LOOKS, measure_soak
from intuitive_physics.errors import InvalidInputError
from intuitive_physics_ros.scripting import Peer

SEED = 19
"""Of all random choices."""

KILLS, FUZZ, CANCELS, FAULTS, SOAK = PARTS = ("kills", "fuzz", "cancels", "faults", "soak")
"""Parts that `--only` may name."""

COUNTS = {KILLS: (200, 10), FUZZ: (100_000, 3_000), CANCELS: (100, 10)}
"""Kills, messages and cancelled searches, of a full run and of a first look."""

SOAK_MINUTES = 15.0
"""Of a full run that is not told how long; a first look has none."""

MOST_MEGABYTES = 1500.0
"""Bar of the memory of a node."""

MOST_GROWTH = 5.0
"""MB by which a node may grow in a soak after its first minute; of the bars."""

Found = tuple[dict[str, Any], Table, list[str]]
"""Key figures of a part, its table, and what was missed."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Torture the nodes, print the tables, and print the line of JSON last."""
    return run_benchmark("torture", __doc__.splitlines()[0], run, arguments, _add_options)


def _add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--only", metavar="PARTS", help=f"only some of {','.join(PARTS)}")
    parser.add_argument(
        "--hours",
        type=float,
        help=f"of the soak; {SOAK_MINUTES:g} minutes unless given, and none with --quick",
    )
    parser.add_argument(
        "--patient", action="store_true", help="hold limits of time that a busy machine keeps too"
    )


def run(options: argparse.Namespace) -> Outcome:
    """Do all parts, or those that were chosen."""
    if options.patient:
        use_bars(PATIENT)
    wanted = PARTS if options.only is None else options.only.split(",")
    unknown = [name for name in wanted if name not in PARTS]
    if unknown:
        raise InvalidInputError(f"--only has {unknown[0]!r}; expected some of {','.join(PARTS)}")
    if options.hours is not None and not 0.05 <= options.hours <= 10_000.0:
        raise InvalidInputError(f"--hours is {options.hours:g}; expected 0.05 to 10,000")
    minutes = SOAK_MINUTES if options.hours is None else 60.0 * options.hours
    if options.quick and options.hours is None:
        wanted = [name for name in wanted if name != SOAK]
    counts = {name: both[options.quick] for name, both in COUNTS.items()}
    figures: dict[str, Any] = {}
    tables: list[Table] = []
    complaints: list[str] = []
    with tempfile.TemporaryDirectory(prefix="torture-") as folder:
        parts: dict[str, Callable[[Path, np.random.Generator], Found]] = {
            KILLS: lambda folder, rng: _kill(folder, counts[KILLS], rng),
            FUZZ: lambda folder, rng: _fuzz(folder, counts[FUZZ], rng),
            CANCELS: lambda folder, rng: _cancel(folder, counts[CANCELS], rng),
            FAULTS: lambda folder, rng: _bear_faults(folder, quick=options.quick),
            SOAK: lambda folder, rng: _soak(folder, minutes),
        }
        for name in wanted:
            report_progress(name)
            own = Path(folder) / name
            own.mkdir()
            found, table, missed = parts[name](
                own, np.random.default_rng([SEED, PARTS.index(name)])
            )
            figures.update(found)
            tables.append(table)
            complaints += missed
    part = "" if options.only is None else "_".join(wanted)
    return judged(tables, figures, complaints, part, patient=options.patient)


def judged(
    tables: Sequence[Table],
    figures: Mapping[str, Any],
    missed: Sequence[str],
    part: str = "",
    *,
    patient: bool = False,
) -> Outcome:
    """Return what was found, as valid where every bar was kept."""
    limits = "Limits of time are those for a busy machine. " if patient else ""
    return Outcome(
        tables,
        figures,
        note=limits + verdict(missed),
        complaints=missed,
        valid=not missed,
        part=part,
    )


def _kill(folder: Path, count: int, rng: np.random.Generator) -> Found:
    found = measure_kills(folder, count, SEED, rng)
    figures = {"kills": found.kills, "lost": found.lost, "corrupted": found.corrupted}
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
                found.corrupted,
                found.not_back,
                found.died,
            ]
        ],
    )
    missed = [
        f"{value} {name}; expected none"
        for name, value in (
            ("lost", found.lost),
            ("corrupted", found.corrupted),
            ("not back after a kill", found.not_back),
            ("died without being killed", found.died),
        )
        if value
    ]
    return figures, table, missed


def _fuzz(folder: Path, count: int, rng: np.random.Generator) -> Found:
    with Peer("torturer", timeout=60.0) as peer, start_fuzzed(folder, peer) as nodes:
        found = measure_fuzz(nodes, peer, count, rng)
        nodes.revive()
        deaths, megabytes = nodes.deaths, nodes.most_megabytes
        stops = nodes.stop()
    stop = worst({name: seconds for name, (seconds, _) in stops.items()})
    figures = {
        "fuzzed": found.sent,
        "deaths": len(deaths),
        "hangs": len(found.slow) + len(found.unanswered),
        "answer_s_worst": round(found.slowest, 2),
        "memory_bound_mb": round(megabytes),
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
                len(deaths),
                len(found.slow),
                len(found.unanswered),
                found.slowest,
                megabytes,
                stop,
            ]
        ],
        remarks=deaths,
    )
    missed = [f"death: {one}" for one in deaths]
    missed += [f"{name} ended with code {code}" for name, (_, code) in stops.items() if code]
    missed += [f"{name} answered a ping after {took:.1f} s" for name, took in found.slow]
    missed += [f"{what} was not answered within {LIMIT:g} s" for what in found.unanswered]
    if megabytes > MOST_MEGABYTES:
        missed.append(f"{megabytes:.0f} MB; expected at most {MOST_MEGABYTES:.0f}")
    if stop > bars().stop:
        missed.append(f"a stop took {stop:.1f} s; expected at most {bars().stop:g}")
    return figures, table, missed


def _cancel(folder: Path, count: int, rng: np.random.Generator) -> Found:
    took = measure_cancels(folder, count, rng)
    table = Table(
        title="Searches cancelled at random instants",
        note="All methods; every fourth learns from boxes that tumble for minutes. Counted from "
        "the request to cancel to the result; searches that had ended before are left out.",
        columns=[
            Column("cancelled"),
            Column("median", "ms", ".0f"),
            Column("longest", "ms", ".0f"),
        ],
        rows=[[len(took), 1e3 * float(np.median(took)), 1e3 * worst(took)]],
    )
    missed = []
    if worst(took) > bars().cancel:
        missed.append(f"a search ended {worst(took):.2f} s after it was cancelled")
    return {"cancel_s_worst": round(worst(took), 2)}, table, missed


def _bear_faults(folder: Path, *, quick: bool) -> Found:
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
    return {"faults": faults}, table, missed


def _soak(folder: Path, minutes: float) -> Found:
    soak = measure_soak(folder, minutes, SEED)
    growth = soak.growth()
    figures = {
        "minutes": minutes,
        "frames": soak.frames,
        "rss_growth_mb": growth,
        "threads": {name: values[-1] for name, values in soak.threads.items()},
        "fds": {name: values[-1] for name, values in soak.files.items()},
        "prediction_hz_min": round(min(soak.rates), 1),
    }
    table = Table(
        title=f"{minutes:g} minutes at full rate",
        note="Growth: the most memory of the last minute less that of the second.",
        columns=[
            Column("node"),
            Column("growth", "MB", ".1f"),
            Column("memory at the end", "MB", ".0f"),
            Column("threads, 2nd minute and last"),
            Column("files, 2nd minute and last"),
        ],
        rows=[
            [
                name,
                growth[name],
                values[-1],
                *(f"{one[name][LOOKS]}, {one[name][-1]}" for one in (soak.threads, soak.files)),
            ]
            for name, values in soak.memory.items()
        ],
    )
    missed = [
        f"{name} grew by {grown:.1f} MB; expected at most {MOST_GROWTH:g}"
        for name, grown in growth.items()
        if grown > MOST_GROWTH
    ]
    return {"soak": figures}, table, missed


if __name__ == "__main__":
    sys.exit(main())
