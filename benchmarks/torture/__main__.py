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
from benchmarks.results.result import Table
from benchmarks.torture.bars import PATIENT, use_bars
from benchmarks.torture.cancels import cancel
from benchmarks.torture.early_end import noted
from benchmarks.torture.faults_around import bear_faults
from benchmarks.torture.fuzz import fuzz
from benchmarks.torture.kills import kill
from benchmarks.torture.part import SEED
from benchmarks.torture.soak import soak
from intuitive_physics.errors import InvalidInputError

# Parts that `--only` may name
KILLS, FUZZ, CANCELS, FAULTS, SOAK = PARTS = ("kills", "fuzz", "cancels", "faults", "soak")
# Kills, messages and cancelled searches, of a full run and of a first look
COUNTS = {KILLS: (200, 5), FUZZ: (100_000, 1_000), CANCELS: (100, 4)}
# Without `--hours`; a first look has a soak only where one is asked for
SOAK_MINUTES, QUICK_SOAK_MINUTES = 15.0, 3.0
# Ends the name of a result whose soak was longer than usual: it is kept beside the usual one
LONG = "long"


def main(arguments: Sequence[str] | None = None) -> int:
    """Torture the nodes, print the tables, and print the line of JSON last."""
    return run_benchmark("torture", __doc__, run, arguments, _add_options, parts=PARTS)


def _add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--hours",
        type=float,
        help=f"of the soak, instead of {SOAK_MINUTES:g} minutes; what is longer is kept as "
        f"torture_{LONG} or, with --only soak, torture_{SOAK}_{LONG}; with --quick there is no "
        f"soak unless --hours or --only asks for one, which lasts {QUICK_SOAK_MINUTES:g} minutes",
    )
    parser.add_argument(
        "--patient", action="store_true", help="hold limits of time that a busy machine keeps too"
    )


def run(options: argparse.Namespace) -> Outcome:
    """Do all parts, or those that were chosen, also after one that ended early."""
    if options.patient:
        use_bars(PATIENT)
    wanted = _wanted(options)
    minutes = _minutes(options)
    counts = {name: both[options.quick] for name, both in COUNTS.items()}
    figures: dict[str, Any] = {}
    tables: list[Table] = []
    complaints: list[str] = []
    draw = None
    with tempfile.TemporaryDirectory(prefix="torture-") as folder:
        measures: dict[str, Callable[[Path, np.random.Generator], Outcome]] = {
            KILLS: lambda folder, rng: kill(folder, counts[KILLS], rng),
            FUZZ: lambda folder, rng: fuzz(folder, counts[FUZZ], rng),
            CANCELS: lambda folder, rng: cancel(folder, counts[CANCELS], rng),
            FAULTS: lambda folder, rng: bear_faults(folder, quick=options.quick),
            SOAK: lambda folder, rng: soak(folder, minutes),
        }
        for name in wanted:
            report_progress(name)
            part_folder = Path(folder) / name
            part_folder.mkdir()
            failures: list[str] = []
            with noted(failures):
                rng = np.random.default_rng([SEED, PARTS.index(name)])
                result = measures[name](part_folder, rng)
                figures.update(result.key_figures)
                tables += result.tables
                failures += result.complaints
                draw = result.draw or draw
            complaints += [f"{name}: {failure}" for failure in failures]
    part = [] if options.only is None else [*wanted]
    part += [LONG] if SOAK in wanted and minutes > SOAK_MINUTES else []
    return judged(tables, figures, complaints, "_".join(part), patient=options.patient, draw=draw)


def _wanted(options: argparse.Namespace) -> list[str]:
    wanted = [*(options.only or PARTS)]
    if options.quick and options.hours is None and options.only is None:
        wanted.remove(SOAK)
    return wanted


def _minutes(options: argparse.Namespace) -> float:
    if options.hours is None:
        return QUICK_SOAK_MINUTES if options.quick else SOAK_MINUTES
    if not 0.05 <= options.hours <= 10_000.0:
        raise InvalidInputError(f"--hours is {options.hours:g}; expected 0.05 to 10,000")
    return 60.0 * float(options.hours)


def judged(
    tables: Sequence[Table],
    figures: Mapping[str, Any],
    missed: Sequence[str],
    part: str = "",
    *,
    patient: bool = False,
    draw: Callable[[Path], None] | None = None,
) -> Outcome:
    """Return the outcome, valid where every bar was kept."""
    limits = "Limits of time are those for a busy machine. " if patient else ""
    return Outcome(
        tables,
        figures,
        note=limits + verdict(missed),
        complaints=missed,
        valid=not missed,
        part=part,
        draw=draw,
    )


if __name__ == "__main__":
    sys.exit(main())
