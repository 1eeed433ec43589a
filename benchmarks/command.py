"""The command line that all benchmarks share."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from benchmarks.peers.engine import MissingPeerError
from benchmarks.results.markdown import tables_text, write_page
from benchmarks.results.provenance import started_run
from benchmarks.results.result import FOLDER, Result, Run, Table, write_result
from intuitive_physics.errors import IntuitivePhysicsError
from intuitive_physics.processes import guard_run


@dataclass(frozen=True)
class Outcome:
    """The result of a benchmark, or of one of its parts.

    The complaints name missed bars and all else that speaks against the result; where it must not
    be used, it is not valid. `draw` writes the figure to a path. `part` ends the name of the file
    in which the result of some parts is kept beside that of all.
    """

    tables: Sequence[Table] = ()
    key_figures: Mapping[str, Any] = field(default_factory=dict)
    note: str = ""
    complaints: Sequence[str] = ()
    valid: bool = True
    draw: Callable[[Path], None] | None = None
    part: str = ""


def run_benchmark(
    name: str,
    documentation: str,
    measure: Callable[[argparse.Namespace], Outcome],
    arguments: Sequence[str] | None,
    add_options: Callable[[argparse.ArgumentParser], None] | None = None,
    *,
    parts: Sequence[str] = (),
    first_seed: int | None = None,
) -> int:
    """Measure, print the tables, write the result if asked to, and print the line of JSON last.

    Parameters
    ----------
    name : of the benchmark, its package and its result
    documentation : its first line is the description in the help
    measure : called with the options: `quick`, and those below
    arguments : of the command line; None for those of the process
    add_options : adds the benchmark's own options
    parts : names that `--only` may have; `only` is the list of the chosen ones, or None; `--write`
        keeps the result of some under `Outcome.part`
    first_seed : default of `--first-seed`; None: the benchmark has no such option

    Returns
    -------
    exit status : 1 where the benchmark could not run or its result is not valid
    """
    guard_run()
    parser = argparse.ArgumentParser(
        prog=f"python -m benchmarks.{name}", description=documentation.splitlines()[0]
    )
    parser.add_argument("--quick", action="store_true", help="measure little, for a first look")
    parser.add_argument(
        "--write", action="store_true", help=f"write benchmarks/results/{name}.json and .md too"
    )
    if parts:
        parser.add_argument(
            "--only",
            type=lambda text: _chosen(text, parts),
            metavar="PARTS",
            help=f"measure only some of {','.join(parts)}; --write keeps their result in a file of "
            "its own",
        )
    if first_seed is not None:
        parser.add_argument(
            "--first-seed",
            type=_seed,
            default=first_seed,
            metavar="N",
            help="of the random sets, at least 0; default %(default)s",
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
    _report(name, outcome, replace(run, seconds=round(seconds, 1)), write=options.write)
    return 0 if outcome.valid else 1


def _report(name: str, outcome: Outcome, run: Run, *, write: bool) -> None:
    """Print the outcome, and write it and its figure."""
    stem = "_".join(filter(None, (name, outcome.part)))
    part = f", {outcome.part.replace('_', ' ')}" if outcome.part else ""
    title = f"{name.capitalize()} benchmark{part}"
    print(f"# {title}\n\n{tables_text(outcome.note, outcome.tables)}\n")
    print(f"Measured in {run.seconds:.0f} s.")
    if outcome.draw is not None:
        figure = (FOLDER if write else Path("build")) / f"{stem}.svg"
        figure.parent.mkdir(parents=True, exist_ok=True)
        outcome.draw(figure)
        print(f"figure: {figure}")
    if write:
        path = FOLDER / f"{stem}.json"
        write_result(path, Result(title, run, outcome.tables, outcome.note, outcome.key_figures))
        write_page(path)
    for complaint in outcome.complaints:
        print(f"bench-{name}: {complaint}", file=sys.stderr)
    print(json.dumps(outcome.key_figures))


def measure_parts(measures: Mapping[str, Callable[[], Outcome]]) -> Outcome:
    """Measure parts one after the other and put their outcomes together.

    A part that fails is a complaint and makes the result invalid; the others are measured all the
    same.
    """
    outcome = Outcome()
    for name, measure in measures.items():
        report_progress(f"part {name}")
        try:
            part = measure()
        except (MissingPeerError, IntuitivePhysicsError) as error:
            part = Outcome(complaints=[f"{name}: {error}"], valid=False)
        outcome = Outcome(
            tables=[*outcome.tables, *part.tables],
            key_figures={**outcome.key_figures, **part.key_figures},
            note=" ".join(filter(None, (outcome.note, part.note))),
            complaints=[*outcome.complaints, *part.complaints],
            valid=outcome.valid and part.valid,
            draw=outcome.draw or part.draw,
        )
    return outcome


def verdict(missed: Sequence[str]) -> str:
    """Return the sentence with which a page says whether all bars were kept."""
    return f"**Bars missed**: {'; '.join(missed)}." if missed else "All bars were kept."


def report_progress(what: str) -> None:
    """Say on standard error what is measured next."""
    print(f"── {what}", file=sys.stderr)


def _chosen(text: str, parts: Sequence[str]) -> list[str]:
    """Return the parts that are named, separated by commas, in their own order."""
    wanted = [name.strip() for name in text.split(",")]
    for name in wanted:
        if name not in parts:
            raise argparse.ArgumentTypeError(f"{name!r}; expected some of {','.join(parts)}")
    return [part for part in parts if part in wanted]


def _seed(text: str) -> int:
    seed = int(text)
    if seed < 0:
        raise argparse.ArgumentTypeError(f"{seed}; expected at least 0")
    return seed
