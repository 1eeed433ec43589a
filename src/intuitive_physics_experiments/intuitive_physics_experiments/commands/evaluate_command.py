"""`evaluate`: learn on a part of recorded observations and predict the rest."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from intuitive_physics.simulation import ENGINE_GUIDE
from intuitive_physics_cli.commands.observation_source import (
    ENGINE,
    ITERATIONS,
    METHOD,
    PATH_HELP,
    add_learning_options,
)

LEARN = "learn"
"""In place of a drag coefficient."""


BALL_DEFAULTS = {
    "engine": [ENGINE],
    "method": METHOD,
    "iterations": ITERATIONS,
    "train_fraction": 0.8,
}
TOSS_DEFAULTS = {
    "engine": ["stepped"],
    "method": "cma_es",
    "iterations": 120,
    "train_fraction": 0.25,
}


def add_to(commands: Any) -> None:
    """Add the subcommand to a parser."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "evaluate",
        help="learn on a part of recorded observations, predict the rest",
        description="Learn the static parameters from a part of the observations, predict the "
        "others from their initial states, and compare with default parameters and free flight. "
        "For cube tosses friction and restitution are fitted, errors count rotation too and stand "
        "beside those that others have published.",
    )
    parser.add_argument("path", type=Path, help=PATH_HELP)
    add_learning_options(
        parser,
        None,
        f"{ITERATIONS}; 120 for cube tosses",
        None,
        f"{METHOD}; cma_es for cube tosses",
    )
    parser.add_argument(
        "--train-fraction",
        type=float,
        help="share of the observations that is learned from (default: 0.8; 0.25 for cube tosses)",
    )
    parser.add_argument(
        "--engine",
        action="append",
        help="simulator to learn and predict with, may be given more than once "
        f"(default: {ENGINE}; stepped for cube tosses). {ENGINE_GUIDE}; mujoco: MuJoCo, likewise",
    )
    parser.add_argument(
        "--train-counts",
        type=int,
        nargs="+",
        metavar="N",
        help="numbers of cube tosses to learn from, one after the other, instead of a share",
    )
    parser.add_argument(
        "--measured-inertia",
        action="store_true",
        help="turn the tossed cube as the recording says that the real one turns, not as a solid",
    )
    parser.add_argument(
        "--learn-mass-centre",
        action="store_true",
        help="learn where the tossed cube's centre of mass is from its flights",
    )
    parser.add_argument(
        "--length-correction",
        type=float,
        metavar="FACTOR",
        help="factor on the recorded lengths of cube tosses, which are about 2 %% short "
        "(default: 1, as recorded)",
    )
    parser.add_argument(
        "--drag",
        type=_drag,
        default=0.0,
        metavar="C",
        help="drag coefficient of table-tennis balls, such as 0.47, or `learn`; needs an engine "
        "with air (default: 0, no air)",
    )
    parser.add_argument(
        "--magnus",
        type=float,
        default=0.0,
        metavar="C",
        help="Magnus coefficient of table-tennis balls, such as 1; their spin is fitted to their "
        "flight then (default: 0)",
    )
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    """Evaluate and print the tables."""
    from intuitive_physics_experiments.commands.evaluate_balls import evaluate_balls
    from intuitive_physics_experiments.commands.evaluate_cube_tosses import evaluate_cube_tosses
    from intuitive_physics_experiments.recorded_sets.recorded_data import holds_cube_tosses

    path = options.path
    tosses = path.suffix == ".npz" and path.is_file() and holds_cube_tosses(path)
    for name, value in (TOSS_DEFAULTS if tosses else BALL_DEFAULTS).items():
        if getattr(options, name) is None:
            setattr(options, name, value)
    if tosses:
        evaluate_cube_tosses(options)
    else:
        evaluate_balls(options)


def _drag(text: str) -> float | None:
    if text == LEARN:
        return None
    try:
        return float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"is {text!r}; expected a number or {LEARN!r}") from None
