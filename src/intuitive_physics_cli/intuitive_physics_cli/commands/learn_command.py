"""`learn`: learn static parameters and keep them in a file."""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

from intuitive_physics.trajectory import DISTANCE_GUIDE, DISTANCES, MEAN_DISTANCE
from intuitive_physics_cli.commands.observation_source import (
    DATABASE_SUFFIX,
    ENGINE,
    METHOD,
    PATH_HELP,
    add_learning_options,
    learning_options,
    open_database,
    progress_to,
    read_observations,
    warn_of_unreadable,
)
from intuitive_physics_cli.terminal import ProgressBar


def add_to(commands: Any) -> None:
    """Add the subcommand to a parser."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "learn",
        help="learn static parameters from observations and save them",
        description="Learn the static parameters that make simulations reproduce observations. "
        "What is learned from a learner's database becomes its next version, and a search on it "
        "that was interrupted, even killed, goes on when the same is asked for again.",
    )
    parser.add_argument("path", type=Path, help=PATH_HELP)
    parser.add_argument("output", type=Path, help="YAML or JSON file for the parameters")
    add_learning_options(parser)
    parser.add_argument(
        "--distance",
        choices=tuple(DISTANCES),
        default=MEAN_DISTANCE,
        help=f"{DISTANCE_GUIDE}; {METHOD} has none to choose (default: {MEAN_DISTANCE})",
    )
    parser.add_argument(
        "--time-limit", type=float, metavar="S", help="s to search at most (default: no limit)"
    )
    parser.add_argument(
        "--cluster",
        default="",
        metavar="WHERE",
        help="what evaluates J: local:N, N processes of this machine, or ADDRESS:PORT, the workers "
        "of that Dask scheduler, such as tls://192.168.1.2:8786 (default: this process)",
    )
    parser.add_argument(
        "--cluster-certificates",
        default="",
        metavar="FOLDER",
        help="folder with ca.pem, certificate.pem and key.pem for TLS with the cluster (default: "
        "what Dask's own configuration says)",
    )
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    """Learn, print and save."""
    from intuitive_physics.simulation import make_simulator
    from intuitive_physics_cli.parameter_table import parameter_table
    from intuitive_physics_learner.cost.cluster import CostMaker
    from intuitive_physics_recordings.parameter_files import check_suffix, save_parameters

    check_suffix(options.output)
    how = learning_options(options)
    criteria = replace(how.criteria, time_limit=options.time_limit)
    how = replace(how, criteria=criteria, distance=options.distance)
    with (
        CostMaker(options.cluster, options.cluster_certificates) as make_cost,
        ProgressBar("learning") as bar,
    ):
        if make_cost.warning:
            print(f"warning: {make_cost.warning}", file=sys.stderr)
        learned = _learn(
            options.path,
            make_simulator(ENGINE),
            how,
            on_progress=progress_to(bar, options),
            make_cost=make_cost,
        )
    save_parameters(learned, options.output)
    print(parameter_table(learned))
    print(
        f"J ({how.distance} distance) is {learned.cost:.4f} m over "
        f"{learned.observation_count} observations; saved in {options.output}"
    )


def _learn(path: Path, simulator: Any, how: Any, **watching: Any) -> Any:
    """Learn from a database, which keeps what is learned, or from other observations."""
    from intuitive_physics_learner.learning_session import learn
    from intuitive_physics_learner.stored_learning import learn_from_store

    if path.suffix == DATABASE_SUFFIX:
        with open_database(path) as store:
            learned = learn_from_store(store, simulator, how, **watching).learned
            warn_of_unreadable(store)
            return learned
    _, observations = read_observations(path)
    return learn(observations, simulator, how, **watching).learned
