"""`calibrate`: are the predicted probabilities true?"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from intuitive_physics.settings import add_options, settings_from_options
from intuitive_physics_cli.commands.observation_source import (
    PATH_HELP,
    progress_to,
    read_observations,
)
from intuitive_physics_experiments.calibration.options import (
    HORIZONS,
    OBSERVED_HORIZONS,
    CalibrationOptions,
)

if TYPE_CHECKING:
    from intuitive_physics.learned_parameters import LearnedParameters
    from intuitive_physics.observation import Observation


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
    parser.add_argument("--horizons", type=float, nargs="+", metavar="T", help="s")
    parser.add_argument(
        "--kinds", nargs="+", metavar="KIND", help="of synthetic objects: sphere, box, capsule"
    )
    add_options(parser, CalibrationOptions)
    parser.add_argument(
        "--drag", type=float, default=0.0, help="drag coefficient of table-tennis balls"
    )
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    """Calibrate, write the folder and print its page."""
    synthetic = options.observations is None
    horizons = options.horizons or (HORIZONS if synthetic else OBSERVED_HORIZONS)
    kinds = tuple(options.kinds or ())
    settings = settings_from_options(
        CalibrationOptions, options, horizons=tuple(horizons), kinds=kinds
    )
    calibrate = _calibrate_on_paper_set if synthetic else _calibrate_on_observations
    calibrate(options, settings)
    print((options.output / "README.md").read_text(encoding="utf-8"), end="")


def _calibrate_on_paper_set(options: argparse.Namespace, settings: CalibrationOptions) -> None:
    from intuitive_physics_cli.terminal import ProgressBar
    from intuitive_physics_experiments.calibration.paper_calibration import calibrate_on_paper_set
    from intuitive_physics_experiments.calibration.report import write_calibration

    with ProgressBar("learning") as bar:
        result = calibrate_on_paper_set(settings, _progress(bar, settings))
    write_calibration(
        options.output,
        f"Calibration on the paper's set, predicted from {settings.points} points",
        result.calibration,
        result.learned,
        result.by_points,
    )


def _calibrate_on_observations(options: argparse.Namespace, settings: CalibrationOptions) -> None:
    from intuitive_physics_cli.terminal import ProgressBar
    from intuitive_physics_experiments.calibration.observed_calibration import (
        calibrate_on_observations,
    )
    from intuitive_physics_experiments.calibration.report import write_calibration
    from intuitive_physics_experiments.recorded_sets.recorded_data import LAUNCHES

    title, observations, start = _read(options.observations, options.drag)
    with ProgressBar("learning") as bar:
        result = calibrate_on_observations(
            observations,
            settings,
            same_settings=title.startswith(LAUNCHES.title),
            start=start,
            on_progress=_progress(bar, settings),
        )
    write_calibration(
        options.output,
        f"Calibration on {options.observations.name} ({title}), from {settings.points} points",
        result.calibration,
        result.learned,
        more=result.notes,
    )


def _progress(bar: Any, settings: CalibrationOptions) -> Any:
    return progress_to(bar, argparse.Namespace(iterations=settings.iterations))


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
