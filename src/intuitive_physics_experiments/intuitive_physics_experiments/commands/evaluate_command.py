"""`evaluate`: learn on a part of recorded observations and predict the rest."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from intuitive_physics_experiments.commands.observation_source import (
    ENGINE,
    PATH_HELP,
    add_learning_options,
    learning_options,
    progress_to,
    read_observations,
)


def add_to(commands: Any) -> None:
    """Add the subcommand to a parser."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "evaluate",
        help="learn on a part of recorded observations, predict the rest",
        description="Learn the static parameters from a part of the observations, predict the "
        "others from their first states, and compare with default parameters and free flight.",
    )
    parser.add_argument("path", type=Path, help=PATH_HELP)
    add_learning_options(parser)
    parser.add_argument(
        "--train-fraction",
        type=float,
        default=0.8,
        help="share of the observations that is learned from (default: 0.8)",
    )
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    """Evaluate and print the tables."""
    from intuitive_physics_experiments.evaluation import evaluate
    from intuitive_physics_experiments.parameter_table import parameter_table
    from intuitive_physics_experiments.terminal import ProgressBar, format_table

    how = learning_options(options)
    title, observations = read_observations(options.path)
    with ProgressBar("learning") as bar:
        evaluation = evaluate(
            observations, how, options.train_fraction, ENGINE, progress_to(bar, options)
        )
    search = evaluation.result.search
    print(
        f"{options.path}: {title}\n"
        f"{len(observations)} observations, {len(evaluation.training)} to learn from, "
        f"{len(evaluation.test)} to test\n"
        f"{options.method}: {search.iterations} iterations in {search.seconds:.1f} s\n"
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
