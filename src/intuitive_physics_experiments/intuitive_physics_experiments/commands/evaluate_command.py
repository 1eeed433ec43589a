"""`evaluate`: learn on a part of recorded observations and predict the rest."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.simulation import ENGINE_GUIDE
from intuitive_physics_experiments.commands.observation_source import (
    ENGINE,
    ITERATIONS,
    PATH_HELP,
    add_learning_options,
    learning_options,
    progress_to,
    read_observations,
)

BALL_DEFAULTS = {"engine": [ENGINE], "iterations": ITERATIONS, "train_fraction": 0.8}
TOSS_DEFAULTS = {"engine": ["stepped"], "iterations": 120, "train_fraction": 0.25}


def add_to(commands: Any) -> None:
    """Add the subcommand to a parser."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "evaluate",
        help="learn on a part of recorded observations, predict the rest",
        description="Learn the static parameters from a part of the observations, predict the "
        "others from their first states, and compare with default parameters and free flight. "
        "For cube tosses friction and restitution are fitted, errors count rotation too and stand "
        "beside those that others have published.",
    )
    parser.add_argument("path", type=Path, help=PATH_HELP)
    add_learning_options(parser, None, f"{ITERATIONS}; 120 for cube tosses")
    parser.add_argument(
        "--train-fraction",
        type=float,
        help="share of the observations that is learned from (default: 0.8; 0.25 for cube tosses)",
    )
    parser.add_argument(
        "--engine",
        action="append",
        help="simulator to learn and predict with, may be given more than once "
        f"(default: {ENGINE}; stepped for cube tosses). {ENGINE_GUIDE}",
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
        type=float,
        default=0.0,
        metavar="C",
        help="drag coefficient of table-tennis balls, such as 0.47; needs an engine with air "
        "(default: 0, no air)",
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
    from intuitive_physics_experiments.recorded_data import holds_cube_tosses

    path = options.path
    tosses = path.suffix == ".npz" and path.is_file() and holds_cube_tosses(path)
    for name, value in (TOSS_DEFAULTS if tosses else BALL_DEFAULTS).items():
        if getattr(options, name) is None:
            setattr(options, name, value)
    if tosses:
        _evaluate_tosses(options)
    else:
        _evaluate_balls(options)


def _evaluate_tosses(options: argparse.Namespace) -> None:
    if options.drag or options.magnus:
        raise InvalidInputError(
            f"drag or Magnus coefficient is given for {options.path}; expected them for table "
            "tennis only"
        )
    from intuitive_physics_experiments.recorded_data import load_cube_tosses
    from intuitive_physics_experiments.terminal import ProgressBar
    from intuitive_physics_experiments.toss_evaluation import evaluate_tosses
    from intuitive_physics_experiments.toss_table import toss_table

    how = learning_options(options)
    factor = 1.0 if options.length_correction is None else options.length_correction
    tosses = load_cube_tosses(options.path, factor)
    with ProgressBar("fitting") as bar:
        evaluation = evaluate_tosses(
            tosses, options.engine, how, options.train_fraction, progress_to(bar, options)
        )
    lengths = "" if factor == 1.0 else f", lengths times {factor:g}"
    print(
        f"{options.path}: cube tosses{lengths}\n"
        f"{len(tosses)} tosses, {len(evaluation.training)} to fit to, "
        f"{len(evaluation.test)} to test\n"
    )
    print(toss_table(evaluation))


def _evaluate_balls(options: argparse.Namespace) -> None:
    if options.length_correction is not None:
        raise InvalidInputError(
            f"length correction is given for {options.path}; expected it for cube tosses only"
        )
    how = learning_options(options)
    start = None
    if options.drag or options.magnus:
        from intuitive_physics_experiments.recorded_data import load_table_tennis
        from intuitive_physics_experiments.table_tennis import AirCoefficients, ball_parameters

        air = AirCoefficients(options.drag, options.magnus)
        title, observations = load_table_tennis(options.path, air)
        title += f", in air with drag {air.drag:g} and Magnus coefficient {air.magnus:g}"
        start = ball_parameters()
    else:
        title, observations = read_observations(options.path)
    print(f"{options.path}: {title}")
    for engine in options.engine:
        _evaluate_balls_with(engine, observations, how, start, options)


def _evaluate_balls_with(
    engine: str, observations: Any, how: Any, start: Any, options: argparse.Namespace
) -> None:
    from intuitive_physics_experiments.evaluation import evaluate
    from intuitive_physics_experiments.parameter_table import parameter_table
    from intuitive_physics_experiments.terminal import ProgressBar, format_table

    with ProgressBar("learning") as bar:
        evaluation = evaluate(
            observations, how, options.train_fraction, engine, progress_to(bar, options), start
        )
    search = evaluation.result.search
    print(
        f"{len(observations)} observations, {len(evaluation.training)} to learn from, "
        f"{len(evaluation.test)} to test\n"
        f"{options.method}, {engine}: {search.iterations} iterations in {search.seconds:.1f} s\n"
    )
    print(parameter_table(evaluation.result.learned))
    rows = [
        [
            name,
            f"{training.mean:.4f}",
            f"{test.mean:.4f}",
            f"{training.last:.4f}",
            f"{test.last:.4f}",
        ]
        for name, (training, test) in evaluation.errors.items()
    ]
    header = ["error (m)", "J training", "J test", "last point training", "last point test"]
    print("\n" + format_table(header, rows))
