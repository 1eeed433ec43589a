"""`import`: put parameters or observations into a learner's database."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from intuitive_physics_cli.commands.observation_source import PATH_HELP, add_database, open_database


def add_to(commands: Any) -> None:
    """Add the subcommand to a parser."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "import",
        help="put parameters (YAML) or observations (MCAP) into a learner's database",
        description="Store observations that are not stored yet, or static parameters as the next "
        "version. A learner that runs on the database learns from them with its next search.",
    )
    add_database(parser, new=True)
    parser.add_argument(
        "input", type=Path, help=f"parameters as .yaml or .json, or observations: {PATH_HELP}"
    )
    parser.add_argument(
        "--as",
        dest="given_as",
        default="prior",
        metavar="WHAT",
        help="what parameters are to later searches: a prior with their standard deviations "
        "(prior, the default), values that are held (fixed), or where a search starts (start); "
        "the last for what was learned from observations that are in the same database, which "
        "must not count twice",
    )
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    """Import and say what."""
    from intuitive_physics_cli.commands.observation_source import read_observations
    from intuitive_physics_learner.given_parameters import given_parameters
    from intuitive_physics_recordings.parameter_files import SUFFIXES, load_parameters

    if options.input.suffix in SUFFIXES:
        learned = load_parameters(options.input)
        with open_database(options.database, new=True) as store:
            newest = store.newest_parameters()
            stored = store.add_parameters(
                given_parameters(learned, options.given_as, newest=newest)
            )
        print(f"version {stored.version} of the static parameters in {options.database}")
        return
    _, observations = read_observations(options.input)
    with open_database(options.database, new=True) as store:
        added, count = store.add_all(observations), store.count()
    print(f"{added} of {len(observations)} observations were new; {options.database} holds {count}")
