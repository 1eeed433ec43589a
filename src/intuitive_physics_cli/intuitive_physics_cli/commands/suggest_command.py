"""`suggest`: the throws that would be most informative."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.observation import load_observation
from intuitive_physics_cli.commands.observation_source import (
    ENGINE,
    add_database,
    add_seed,
    checked_seed,
    open_database,
)
from intuitive_physics_cli.terminal import format_table

RANGES = {
    "position": ("position", "m"),
    "velocity": ("linear_velocity", "m/s"),
    "spin": ("angular_velocity", "rad/s"),
}
"""Field of a request and unit of each option that gives a range."""


def add_to(commands: Any) -> None:
    """Add the subcommand to a parser."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "suggest",
        help="say which throw would tell most about parameters or the answer to a query",
        description="Compare throws of the objects seen so far, within the ranges of initial "
        "states seen so far or given, by the information that they are expected to bring about "
        "what is asked: static parameters, or where an object will be, or whether it enters a "
        "region.",
    )
    add_database(parser)
    parser.add_argument(
        "--about",
        nargs="+",
        default=[],
        metavar="NAME",
        help="parameters, such as restitution[ball,floor] (default: all that throws depend on)",
    )
    parser.add_argument(
        "--query",
        type=Path,
        metavar="FILE",
        help="saved observation with the scene of a query: where will its object be?",
    )
    parser.add_argument(
        "--at", type=float, default=1.0, metavar="S", help="time of the query (default: 1)"
    )
    parser.add_argument(
        "--of", metavar="ID", help="object of the query (default: the first of its scene)"
    )
    parser.add_argument(
        "--enters",
        nargs=4,
        type=float,
        metavar=("X", "Y", "Z", "RADIUS"),
        help="ask whether the object enters this ball (m) by that time instead",
    )
    parser.add_argument(
        "--object", metavar="NAME", help="id or material of what is to be thrown (default: any)"
    )
    for name, (_, unit) in RANGES.items():
        parser.add_argument(
            f"--{name}",
            nargs=6,
            type=float,
            metavar=("X0", "X1", "Y0", "Y1", "Z0", "Z1"),
            help=f"lowest and highest {name} on each axis, {unit} (default: as seen so far)",
        )
    parser.add_argument("--count", type=int, default=5, help="throws to suggest (default: 5)")
    add_seed(parser)
    parser.add_argument("--json", action="store_true", help="print JSON instead of tables")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    """Judge throws and print the best."""
    from intuitive_physics.simulation import make_simulator
    from intuitive_physics_learner.design import SuggestionRequest, suggest_from_store

    if options.count < 1:
        raise InvalidInputError(f"count is {options.count}; expected 1 or more")
    if options.about and options.query is not None:
        raise InvalidInputError("--about and --query are given; expected one of them")
    ranges: dict[str, Any] = {
        field: np.reshape(getattr(options, name), (3, 2))
        for name, (field, _) in RANGES.items()
        if getattr(options, name) is not None
    }
    request = SuggestionRequest(
        about=tuple(options.about),
        query=_query(options),
        object=options.object,
        count=options.count,
        seed=checked_seed(options),
        **ranges,
    )
    with open_database(options.database) as store:
        suggestions = suggest_from_store(store, make_simulator(ENGINE), request)
    if options.json:
        print(json.dumps([_plain(each) for each in suggestions]))
        return
    print(_throws_table(suggestions))
    print()
    print(_asked_table(suggestions))


def _query(options: argparse.Namespace) -> Any:
    """Return the query that is asked for; None when parameters are."""
    from intuitive_physics.regions import BallRegion
    from intuitive_physics_learner.design import AboutMotion

    if options.query is None:
        if options.of is not None or options.enters is not None:
            raise InvalidInputError("--of or --enters is given without --query; expected it too")
        return None
    scene = load_observation(options.query).scene()
    region = None if options.enters is None else BallRegion(options.enters[:3], options.enters[3])
    return AboutMotion(scene, options.of or scene.objects[0].id, options.at, region)


def _throws_table(suggestions: Any) -> str:
    """Return a row for each object of each throw."""
    rows = []
    for number, each in enumerate(suggestions, 1):
        for member, state in zip(each.throw.cast, each.throw.states, strict=True):
            rows.append(
                [
                    f"{number}. {member.object.id} ({member.object.material})",
                    _triple(state.position),
                    _triple(state.linear_velocity),
                    _triple(state.angular_velocity),
                    f"{each.gain:.2f}",
                ]
            )
    header = ["throw", "from (m)", "velocity (m/s)", "spin (rad/s)", "information (nat)"]
    return format_table(header, rows)


def _asked_table(suggestions: Any) -> str:
    """Return how well each thing asked about is known now and would be after each throw."""
    header = ["± σ of", "now", *(f"after {k}." for k in range(1, len(suggestions) + 1))]
    before = suggestions[0].before
    rows = [
        [name, f"{before[k]:.2g}", *(f"{each.after[k]:.2g}" for each in suggestions)]
        for k, name in enumerate(suggestions[0].asked)
    ]
    return format_table(header, rows)


def _triple(values: Any) -> str:
    return " ".join(f"{value:.2f}" for value in values)


def _plain(each: Any) -> dict[str, Any]:
    """Return a suggestion as plain data, in SI units."""
    return {
        "information": each.gain,
        "objects": [
            {
                "id": member.object.id,
                "material": member.object.material,
                "position": state.position.tolist(),
                "orientation": state.orientation.tolist(),
                "linear_velocity": state.linear_velocity.tolist(),
                "angular_velocity": state.angular_velocity.tolist(),
            }
            for member, state in zip(each.throw.cast, each.throw.states, strict=True)
        ],
        "standard_deviations": {
            name: {"now": float(each.before[k]), "after": float(each.after[k])}
            for k, name in enumerate(each.asked)
        },
    }
