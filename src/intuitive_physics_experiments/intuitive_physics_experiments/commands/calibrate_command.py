"""`calibrate`: are the predicted probabilities true?"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from intuitive_physics.errors import InvalidInputError
from intuitive_physics_cli.commands.observation_source import (
    PATH_HELP,
    progress_to,
    read_observations,
)

if TYPE_CHECKING:
    from intuitive_physics.learned_parameters import LearnedParameters
    from intuitive_physics.observation import Observation

OBSERVED_HORIZONS = (0.1, 0.2, 0.4, 0.6)
"""s ahead at which predictions of observations are scored, unless others are given."""


def add_to(commands: Any) -> None:
    """Add the subcommand to a parser."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "calibrate",
        help="fit the noise of predictions and see whether their probabilities are true",
        description="Learn from a part of the observations, fit the noise scales by the energy "
        "score, predict what was held out and write coverage of the 50 and 90 %% regions, CRPS and "
        "energy score beside those of a single rollout, fixed noise and free flight. The folder "
        "gets scores.csv, reliability.csv, calibration.png, README.md, and parameters.json: the "
        "static parameters with their noise scales.",
    )
    parser.add_argument("output", type=Path, help="folder for tables and figures")
    parser.add_argument(
        "--observations",
        type=Path,
        metavar="PATH",
        help=f"{PATH_HELP}; without it, the paper's synthetic set is made",
    )
    parser.add_argument(
        "--splits",
        type=int,
        default=1,
        help="parts that the observations fall into, each of which is held out once and predicted "
        "with what the others taught; 1: one half is held out (default: 1)",
    )
    parser.add_argument("--horizons", type=float, nargs="+", metavar="T", help="s")
    parser.add_argument("--points", type=int, default=10, help="seen of each object (default: 10)")
    parser.add_argument("--objects", type=int, default=3, help="in the synthetic set (default: 3)")
    parser.add_argument(
        "--throws",
        type=int,
        default=60,
        help="of each synthetic object, to learn from and to fit the noise to (default: 60)",
    )
    parser.add_argument(
        "--held-out",
        type=int,
        default=100,
        help="more throws of each synthetic object, to score on (default: 100)",
    )
    parser.add_argument(
        "--kinds", nargs="+", metavar="KIND", help="of synthetic objects: sphere, box, capsule"
    )
    parser.add_argument(
        "--samples", type=int, default=100, help="simulations a prediction (default: 100)"
    )
    parser.add_argument(
        "--iterations", type=int, default=2500, help="evaluations of J at most (default: 2500)"
    )
    parser.add_argument("--engine", default="auto", help="simulator (default: auto)")
    parser.add_argument(
        "--cores", type=int, default=1, help="splits that are made at the same time (default: 1)"
    )
    parser.add_argument(
        "--drag", type=float, default=0.0, help="drag coefficient of table-tennis balls"
    )
    parser.add_argument("--seed", type=int, default=0, help="of all randomness (default: 0)")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    """Calibrate, write the folder and print its page."""
    counts = ("points", "splits", "objects", "throws", "held_out", "samples", "iterations", "cores")
    for name in counts:
        lowest = {"points": 3, "samples": 4}.get(name, 1)
        if getattr(options, name) < lowest:
            raise InvalidInputError(
                f"{name} is {getattr(options, name)}; expected {lowest} or more"
            )
    if options.seed < 0:
        raise InvalidInputError(f"seed is {options.seed}; expected 0 or more")
    if options.observations is None:
        _calibrate_on_paper_set(options)
    else:
        _calibrate_on_observations(options)
    print((options.output / "README.md").read_text(encoding="utf-8"), end="")


def _calibrate_on_paper_set(options: argparse.Namespace) -> None:
    from intuitive_physics_cli.terminal import ProgressBar
    from intuitive_physics_experiments.calibration.paper_calibration import (
        HORIZONS,
        PaperCalibrationOptions,
        calibrate_on_paper_set,
    )
    from intuitive_physics_experiments.calibration.report import write_calibration
    from intuitive_physics_experiments.paper.paper_room import SHAPE_KINDS

    settings = PaperCalibrationOptions(
        objects=options.objects,
        samples=options.throws,
        held_out=options.held_out,
        kinds=tuple(options.kinds or SHAPE_KINDS),
        points=options.points,
        horizons=tuple(options.horizons or HORIZONS),
        sample_count=options.samples,
        iterations=options.iterations,
        engine=options.engine,
        seed=options.seed,
    )
    with ProgressBar("learning") as bar:
        found = calibrate_on_paper_set(settings, progress_to(bar, options))
    write_calibration(
        options.output,
        f"Calibration on the paper's set, predicted from {options.points} points",
        found.calibration,
        found.learned,
        found.by_points,
    )


def _calibrate_on_observations(options: argparse.Namespace) -> None:
    from intuitive_physics_cli.terminal import ProgressBar
    from intuitive_physics_experiments.calibration.observed_calibration import (
        ObservedCalibrationOptions,
        calibrate_on_observations,
    )
    from intuitive_physics_experiments.calibration.report import write_calibration
    from intuitive_physics_experiments.recorded_sets.recorded_data import LAUNCHES

    title, observations, start = _read(options.observations, options.drag)
    with ProgressBar("learning") as bar:
        found = calibrate_on_observations(
            observations,
            ObservedCalibrationOptions(
                options.points,
                tuple(options.horizons or OBSERVED_HORIZONS),
                splits=options.splits,
                sample_count=options.samples,
                iterations=options.iterations,
                engine=options.engine,
                seed=options.seed,
                cores=options.cores,
            ),
            same_settings=title.startswith(LAUNCHES.title),
            start=start,
            on_progress=progress_to(bar, options),
        )
    write_calibration(
        options.output,
        f"Calibration on {options.observations.name} ({title}), from {options.points} points",
        found.calibration,
        found.learned,
        more=found.notes,
    )


def _read(path: Path, drag: float) -> tuple[str, list[Observation], LearnedParameters | None]:
    """Return title and observations of a folder or a recorded set, and where learning starts."""
    from intuitive_physics_experiments.recorded_sets.recorded_data import load_table_tennis
    from intuitive_physics_experiments.recorded_sets.table_tennis import (
        AirCoefficients,
        known_ball,
    )

    if drag == 0.0:
        return *read_observations(path), None
    title, observations = load_table_tennis(path, AirCoefficients(drag))
    return f"{title}, drag {drag:g}", observations, known_ball()
