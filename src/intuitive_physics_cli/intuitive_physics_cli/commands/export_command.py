"""`export`: take parameters or observations out of a learner's database."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from intuitive_physics.errors import InvalidInputError
from intuitive_physics_cli.commands.observation_source import add_database, open_database


def add_to(commands: Any) -> None:
    """Add the subcommand to a parser."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "export",
        help="write parameters (YAML) or observations (MCAP) of a learner's database",
        description="Write the newest static parameters of a learner's database as YAML or JSON, "
        "or its observations as an MCAP file that `ros2 bag play` and Foxglove open.",
    )
    add_database(parser)
    parser.add_argument("output", type=Path, help="file: .yaml, .json, or .mcap for observations")
    parser.add_argument("--version", type=int, help="of the parameters (default: the newest)")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    """Export and say what."""
    from intuitive_physics_recordings.observation_bag import SUFFIX, write_observation_bag
    from intuitive_physics_recordings.parameter_files import save_parameters

    with open_database(options.database) as store:
        if options.output.suffix == SUFFIX:
            if options.version is not None:
                raise InvalidInputError("observations have no version; expected none with .mcap")
            observations = store.observations()
            write_observation_bag(observations, options.output)
            print(f"{len(observations)} observations in {options.output}")
            return
        version = store.newest_version() if options.version is None else options.version
        learned = store.parameters(version)
    save_parameters(learned, options.output)
    print(f"version {learned.version} of the static parameters in {options.output}")
