"""`observations`: list what a learner's database holds, exclude, include, delete, export, check."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

from intuitive_physics.errors import InvalidInputError
from intuitive_physics_cli.commands.observation_source import add_database, open_database
from intuitive_physics_cli.terminal import format_table

SHOWN = 50
"""Observations that are listed unless more are asked for: about one screen."""

HEADER = ("id", "received", "start s", "materials", "points", "status", "weight", "reason")
"""Columns of the list."""


def add_to(commands: Any) -> None:
    """Add the subcommand and its own subcommands to a parser."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "observations",
        help="list, exclude, include, delete, export or check the observations of a database",
        description="What a learner's database holds, with the status of each observation: used, "
        "excluded by the user, doubtful (set aside by the learner), unreadable. A learner that "
        "runs on the database follows every change.",
    )
    actions = parser.add_subparsers(title="actions", required=True, metavar="ACTION")
    listing = _action(actions, "list", _list, "list observations, the newest first")
    listing.add_argument("--status", action="append", default=[], help="list only these; repeat it")
    listing.add_argument(
        "--limit", type=int, default=SHOWN, help=f"at most; 0: all (default: {SHOWN})"
    )
    excluding = _action(actions, "exclude", _exclude, "leave observations out of learning")
    _add_ids(excluding)
    excluding.add_argument("--reason", help="text that lists show (default: excluded by the user)")
    including = _action(
        actions, "include", _include, "learn again from what was excluded or set aside"
    )
    _add_ids(including)
    _add_ids(_action(actions, "delete", _delete, "delete observations for good"))
    exporting = _action(actions, "export", _export, "write observations to a folder or MCAP file")
    exporting.add_argument("output", type=Path, help="folder of JSON files, or a new .mcap file")
    _add_ids(exporting, "*", "of the observations (default: all that are used)")
    _action(actions, "check", _check, "read the whole file and every observation")


def _action(
    actions: Any, name: str, run: Callable[[argparse.Namespace], None], summary: str
) -> argparse.ArgumentParser:
    description = f"{summary[0].upper()}{summary[1:]}."
    parser: argparse.ArgumentParser = actions.add_parser(
        name, help=summary, description=description
    )
    add_database(parser)
    parser.add_argument("--json", action="store_true", help="print JSON for other programs")
    parser.set_defaults(run=run)
    return parser


def _add_ids(
    parser: argparse.ArgumentParser, count: str = "+", meaning: str = "of the observations"
) -> None:
    parser.add_argument("ids", nargs=count, metavar="ID", help=meaning)


def _list(options: argparse.Namespace) -> None:
    if options.limit < 0:
        raise InvalidInputError(f"limit is {options.limit}; expected 0 or more")
    with open_database(options.database) as store:
        entries = store.entries(statuses=options.status, limit=options.limit or -1, newest=True)
        counts = store.counts()
    if options.json:
        _print_entries(counts, "observations", entries)
        return
    if entries:
        print(format_table(HEADER, [_row(entry) for entry in entries]))
    print(f"{len(entries)} of {sum(counts.values())} observations: {_counted(counts)}")


def _print_entries(counts: dict[str, int], name: str, entries: Sequence[Any]) -> None:
    data = {"counts": counts, name: [entry.to_dict() for entry in entries]}
    print(json.dumps(data, indent=2, ensure_ascii=False))


def _row(entry: Any) -> tuple[str, ...]:
    return (
        entry.id,
        datetime.fromtimestamp(entry.received_at).strftime("%Y-%m-%d %H:%M:%S"),
        "" if entry.start_time is None else f"{entry.start_time:.3f}",
        ", ".join(entry.materials),
        str(entry.point_count),
        entry.status,
        f"{entry.weight:.2f}",
        entry.reason,
    )


def _counted(counts: dict[str, int]) -> str:
    return ", ".join(f"{count} {status}" for status, count in counts.items())


def _exclude(options: argparse.Namespace) -> None:
    reason = {} if options.reason is None else {"reason": options.reason}
    with open_database(options.database) as store:
        _report(options, "excluded", store.exclude(options.ids, **reason), store)


def _include(options: argparse.Namespace) -> None:
    with open_database(options.database) as store:
        _report(options, "included", store.include(options.ids), store)


def _delete(options: argparse.Namespace) -> None:
    with open_database(options.database) as store:
        _report(options, "deleted", store.delete(options.ids), store)


def _report(options: argparse.Namespace, done: str, count: int, store: Any) -> None:
    counts = store.counts()
    if options.json:
        print(json.dumps({done: count, "counts": counts}))
    else:
        print(f"{count} {done}; {options.database} holds {_counted(counts)}")


def _export(options: argparse.Namespace) -> None:
    from intuitive_physics_recordings.observation_bag import SUFFIX, write_observation_bag

    with open_database(options.database) as store:
        if options.output.suffix == SUFFIX:
            observations = store.observations(options.ids)
            write_observation_bag(observations, options.output)
            count = len(observations)
        else:
            count = store.export(options.output, options.ids)
    if options.json:
        print(json.dumps({"exported": count, "output": str(options.output)}))
    else:
        print(f"{count} observations in {options.output}")


def _check(options: argparse.Namespace) -> None:
    with open_database(options.database) as store:
        unreadable, counts = store.check(), store.counts()
    if options.json:
        _print_entries(counts, "unreadable", unreadable)
        return
    for entry in unreadable:
        print(f"{entry.id} cannot be read: {entry.reason}")
    print(f"{options.database} is not damaged and holds {_counted(counts)}")
