"""Options that commands share: the source of observations, learning, and the seed."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.observation import Observation

DATABASE_SUFFIX = ".sqlite3"
"""Ending of a learner's database, an SQLite file."""


def add_database(parser: argparse.ArgumentParser, *, new: bool = False) -> None:
    """Add the argument `database`; `new`: it may be made."""
    made = "; made where it does not exist" if new else ""
    parser.add_argument(
        "database",
        type=Path,
        help=f"of a learner, such as ~/.local/share/intuitive_physics/learner{DATABASE_SUFFIX}"
        f"{made}",
    )


def open_database(path: Path, *, new: bool = False) -> Any:
    """Open a learner's database; `new`: make it where there is none."""
    from intuitive_physics_learner.store import ObservationStore

    if not new and not path.expanduser().is_file():
        raise InvalidInputError(f"there is no database {path}; expected a file of a learner")
    store = ObservationStore(path)
    _warn_of_room(store)
    return store


def _warn_of_room(store: Any) -> None:
    """Say on standard error when a database or its disk is nearly full."""
    from intuitive_physics_learner.store.room import RoomSettings

    if warning := store.room().warning(RoomSettings().least_free_space):
        print(f"intuitive-physics: warning: {warning}", file=sys.stderr)


def warn_of_unreadable(store: Any) -> None:
    """Say on standard error how many observations of a database cannot be read, if there are."""
    if count := store.count("unreadable"):
        print(
            f"intuitive-physics: warning: observations of {store.path} that cannot be read and are "
            f"passed over: {count}; see `intuitive-physics observations list`",
            file=sys.stderr,
        )


PATH_HELP = (
    "a folder of saved observations, an .mcap file or bag with observations, a learner's database "
    "(.sqlite3), or a recorded set (.npz)"
)
"""Kinds of paths to observations, for the help."""

RECORDED_SET_SUFFIX = ".npz"
"""Ending of motions recorded by others, which an added package reads."""

ENGINE = "auto"
"""The default engine."""

ITERATIONS = 2000
"""The default number of evaluations of J."""

METHOD = "levenberg_marquardt"
"""The library's `DEFAULT_METHOD`, which would take a second to import."""


def add_learning_options(
    parser: argparse.ArgumentParser, method_note: str = "", iterations_note: str = ""
) -> None:
    """Add the options that say how to learn; the help has the notes after the defaults."""
    parser.add_argument(
        "--method",
        default=METHOD,
        help=f"of the search, such as cma_es (default: {METHOD}{method_note})",
    )
    parser.add_argument(
        "--iterations",
        type=int,
        default=ITERATIONS,
        help=f"evaluations of J at most (default: {ITERATIONS}{iterations_note})",
    )
    add_seed(parser)


def add_seed(parser: argparse.ArgumentParser, meaning: str = "of all randomness") -> None:
    """Add the option `--seed`, which `checked_seed` reads."""
    parser.add_argument("--seed", type=int, default=0, help=f"{meaning} (default: 0)")


def checked_seed(options: argparse.Namespace) -> int:
    """Return the seed; refuse one below zero, which NumPy does not take."""
    seed: int = options.seed
    if seed < 0:
        raise InvalidInputError(f"seed is {seed}; expected 0 or more")
    return seed


def read_observations(path: Path) -> tuple[str, list[Observation]]:
    """Return title and observations of what `PATH_HELP` names."""
    from intuitive_physics_cli.plugins import observation_reader
    from intuitive_physics_recordings.bag_reader import METADATA_FILE
    from intuitive_physics_recordings.observation_bag import SUFFIX, read_observation_bag
    from intuitive_physics_recordings.observation_files import load_observations

    if path.suffix == SUFFIX or (path / METADATA_FILE).exists():
        return "recorded observations", read_observation_bag(path)
    if path.is_dir():
        return "saved observations", load_observations(path)
    if not path.exists():
        raise InvalidInputError(f"there is no {path}; expected {PATH_HELP}")
    if path.suffix == DATABASE_SUFFIX:
        with open_database(path) as store:
            observations = store.observations()
            warn_of_unreadable(store)
            return "stored observations", observations
    read = observation_reader(path.suffix)
    if read is None and path.suffix == RECORDED_SET_SUFFIX:
        raise InvalidInputError(
            f"{path} is a recorded set, which the package intuitive_physics_experiments reads; "
            "install it"
        )
    if read is None:
        raise InvalidInputError(f"{path} is no {RECORDED_SET_SUFFIX} file; expected {PATH_HELP}")
    return read(path)


def learning_options(options: argparse.Namespace) -> Any:
    """Return the library's options."""
    from intuitive_physics_learner.learning_session import LearningOptions
    from intuitive_physics_learner.search.convergence import ConvergenceCriteria

    criteria = ConvergenceCriteria(max_iterations=options.iterations)
    return LearningOptions(method=options.method, criteria=criteria, seed=checked_seed(options))


def progress_to(bar: Any, options: argparse.Namespace) -> Callable[[Any], None]:
    """Return what shows the search's progress on a bar."""

    def show(progress: Any) -> None:
        left = progress.seconds_left
        soon = f", {left:.0f} s left" if math.isfinite(left) else ""
        note = f"J {progress.best_cost:.4f} m{soon}"
        bar.update(progress.iteration, options.iterations, note)

    return show
