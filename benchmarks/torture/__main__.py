"""`make torture`: nodes that are killed, and that are sent what nobody would send.

README.md in the folder above says what is measured and how.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.command import Outcome, run_benchmark
from benchmarks.results.result import Column, Table
from benchmarks.torture.fuzz import measure_fuzz
from benchmarks.torture.kills import measure_kills
from benchmarks.torture.nodes import Nodes, worst
from intuitive_physics.errors import InvalidInputError
from intuitive_physics_ros.scripting import Peer

SEED = 19
"""Of all random choices."""

KILLS, FUZZ = PARTS = ("kills", "fuzz")
"""Parts that `--only` may name."""

COUNTS = {KILLS: (200, 10), FUZZ: (100_000, 3_000)}
"""Kills, and messages, of a full run and of a first look."""

MOST_MEGABYTES, LONGEST_STOP = 1500.0, 2.0
"""Bars of the memory of a node, and of the time (s) that it takes to stop."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Torture the nodes, print the tables, and print the line of JSON last."""
    return run_benchmark("torture", __doc__.splitlines()[0], run, arguments, _add_options)


def _add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--only", metavar="PARTS", help=f"only some of {','.join(PARTS)}")


def run(options: argparse.Namespace) -> Outcome:
    """Do all parts, or those that were chosen."""
    wanted = PARTS if options.only is None else options.only.split(",")
    unknown = [name for name in wanted if name not in PARTS]
    if unknown:
        raise InvalidInputError(f"--only has {unknown[0]!r}; expected some of {','.join(PARTS)}")
    figures: dict[str, Any] = {}
    tables: list[Table] = []
    complaints: list[str] = []
    with tempfile.TemporaryDirectory(prefix="torture-") as folder:
        for name, measure in ((KILLS, _kill), (FUZZ, _fuzz)):
            if name in wanted:
                count = COUNTS[name][options.quick]
                rng = np.random.default_rng([SEED, PARTS.index(name)])
                found, table, missed = measure(Path(folder), count, rng)
                figures.update(found)
                tables.append(table)
                complaints += missed
    return Outcome(tables, figures, complaints=complaints)


def _kill(
    folder: Path, count: int, rng: np.random.Generator
) -> tuple[dict[str, Any], Table, list[str]]:
    found = measure_kills(folder, count, rng)
    figures = {"kills": found.kills, "lost": found.lost, "corrupted": found.corrupted}
    table = Table(
        title="Killed at random instants, under load",
        note="Every fifth kill is of perception or the predictor, the others of the learner while "
        "it is given observations and parameters.",
        columns=[Column(name) for name in ("kills", "answered", "lost", "corrupted", "not back")],
        rows=[[found.kills, found.answered, found.lost, found.corrupted, found.not_back]],
    )
    missed = [
        f"{value} {name}; expected none"
        for name, value in (
            ("lost", found.lost),
            ("corrupted", found.corrupted),
            ("not back after a kill", found.not_back),
        )
        if value
    ]
    return figures, table, missed


def _fuzz(
    folder: Path, count: int, rng: np.random.Generator
) -> tuple[dict[str, Any], Table, list[str]]:
    with Peer("torturer", timeout=60.0) as peer, Nodes(folder, peer) as nodes:
        found = measure_fuzz(nodes, peer, count, rng)
        nodes.revive()
        deaths, megabytes = nodes.deaths, nodes.most_megabytes
        stops = nodes.stop()
    stop = worst({name: seconds for name, (seconds, _) in stops.items()})
    figures = {
        "fuzzed": found.sent,
        "deaths": len(deaths),
        "hangs": len(found.slow),
        "memory_bound_mb": round(megabytes),
        "stop_s_worst": round(stop, 2),
    }
    table = Table(
        title="Messages and calls made from the interface definitions",
        note="Each node is pinged all the while; a ping that is not answered within 1 s is a hang.",
        columns=[
            Column("sent"),
            Column("deaths"),
            Column("hangs"),
            Column("slowest answer", "s", ".2f"),
            Column("most memory", "MB", ".0f"),
            Column("slowest stop", "s", ".2f"),
        ],
        rows=[[found.sent, len(deaths), len(found.slow), found.slowest, megabytes, stop]],
        remarks=deaths,
    )
    missed = [f"death: {one}" for one in deaths]
    missed += [f"{name} ended with code {code}" for name, (_, code) in stops.items() if code]
    missed += [f"{name} answered a ping after {took:.1f} s" for name, took in found.slow]
    if megabytes > MOST_MEGABYTES:
        missed.append(f"{megabytes:.0f} MB; expected at most {MOST_MEGABYTES:.0f}")
    if stop > LONGEST_STOP:
        missed.append(f"a stop took {stop:.1f} s; expected at most {LONGEST_STOP:g}")
    return figures, table, missed


if __name__ == "__main__":
    sys.exit(main())
