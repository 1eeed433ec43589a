"""The command line that all benchmarks share."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from benchmarks.peers.engine import MissingPeerError
from benchmarks.results.markdown import tables_text, write_page
from benchmarks.results.provenance import started_run
from benchmarks.results.result import FOLDER, Result, Table, write_result
from intuitive_physics.errors import IntuitivePhysicsError
from intuitive_physics.processes import guard_run


@dataclass(frozen=True)
class Outcome:
    """What a benchmark found.

    Parameters
    ----------
    tables : all that was measured
    key_figures : the last line that is printed, as JSON
    note : what was measured, above all tables
    complaints : bars that were missed, and what else speaks against the result
    valid : False where a complaint means that the result must not be used
    draw : writes the figure of the result to a path; None where there is no figure
    part : name of the only part that was measured, whose result is kept apart; empty: all
    """

    tables: Sequence[Table]
    key_figures: Mapping[str, Any]
    note: str = ""
    complaints: Sequence[str] = ()
    valid: bool = True
    draw: Callable[[Path], None] | None = None
    part: str = ""


def run_benchmark(
    name: str,
    description: str,
    measure: Callable[[argparse.Namespace], Outcome],
    arguments: Sequence[str] | None,
    add_options: Callable[[argparse.ArgumentParser], None] | None = None,
) -> int:
    """Measure, print the tables, write the result if asked to, and print the line of JSON last.

    Parameters
    ----------
    name : of the benchmark, its package and its result
    description : first lines of its help
    measure : called with the options, of which `quick` is whether little is to be measured, for a
        first look
    arguments : of the command line; None for those of the process
    add_options : adds the benchmark's own options; None: it has none

    Returns
    -------
    exit status : 1 where the benchmark could not run or its result is not valid
    """
    guard_run()
    parser = argparse.ArgumentParser(prog=f"python -m benchmarks.{name}", description=description)
    parser.add_argument("--quick", action="store_true", help="measure little, for a first look")
    parser.add_argument(
        "--write", action="store_true", help=f"write benchmarks/results/{name}.json and .md too"
    )
    if add_options is not None:
        add_options(parser)
    given = list(sys.argv[1:] if arguments is None else arguments)
    options = parser.parse_args(given)
    run = started_run(name, given)
    start = time.perf_counter()
    try:
        outcome = measure(options)
    except (MissingPeerError, IntuitivePhysicsError) as error:
        print(f"bench-{name}: {error}", file=sys.stderr)
        return 1
    seconds = time.perf_counter() - start
    stem = "_".join(filter(None, (name, outcome.part)))
    part = f", {outcome.part.replace('_', ' ')}" if outcome.part else ""
    title = f"{name.capitalize()} benchmark{part}"
    print(f"# {title}\n\n{tables_text(outcome.note, outcome.tables)}\n")
    print(f"Measured in {seconds:.0f} s.")
    if outcome.draw is not None:
        figure = (FOLDER if options.write else Path("build")) / f"{stem}.svg"
        figure.parent.mkdir(parents=True, exist_ok=True)
        outcome.draw(figure)
        print(f"figure: {figure}")
    if options.write:
        run = replace(run, seconds=round(seconds, 1))
        path = FOLDER / f"{stem}.json"
        write_result(path, Result(title, run, outcome.tables, outcome.note, outcome.key_figures))
        write_page(path)
    for complaint in outcome.complaints:
        print(f"bench-{name}: {complaint}", file=sys.stderr)
    print(json.dumps(outcome.key_figures))
    return 0 if outcome.valid else 1


def verdict(missed: Sequence[str]) -> str:
    """Return the sentence with which a page says whether all bars were kept."""
    return f"**Bars missed**: {'; '.join(missed)}." if missed else "All bars were kept."


def report_progress(what: str) -> None:
    """Say on standard error what is measured next."""
    print(f"── {what}", file=sys.stderr)
