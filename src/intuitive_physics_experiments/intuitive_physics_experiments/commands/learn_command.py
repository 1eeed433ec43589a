"""`learn`: learn static parameters and keep them in a file."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from intuitive_physics.errors import InvalidInputError
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
        "learn",
        help="learn static parameters from observations and save them",
        description="Learn the static parameters that make simulations reproduce observations.",
    )
    parser.add_argument("path", type=Path, help=PATH_HELP)
    parser.add_argument("output", type=Path, help="JSON file to write the parameters to")
    add_learning_options(parser)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    """Learn, print and save."""
    from intuitive_physics.simulation import make_simulator
    from intuitive_physics_experiments.parameter_table import parameter_table
    from intuitive_physics_experiments.terminal import ProgressBar
    from intuitive_physics_learner.learning_session import learn

    how = learning_options(options)
    _, observations = read_observations(options.path)
    with ProgressBar("learning") as bar:
        result = learn(
            observations, make_simulator(ENGINE), how, on_progress=progress_to(bar, options)
        )
    text = json.dumps(result.learned.to_dict(), indent=2, ensure_ascii=False)
    try:
        options.output.write_text(text + "\n", encoding="utf-8")
    except OSError as error:
        raise InvalidInputError(f"cannot write {options.output}: {error.strerror}") from None
    print(parameter_table(result.learned))
    print(
        f"J is {result.learned.cost:.4f} m over {len(observations)} observations; "
        f"saved in {options.output}"
    )
