"""`report`: learn, predict, and show it all on one page."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from intuitive_physics_cli.commands.observation_source import (
    ENGINE,
    PATH_HELP,
    add_learning_options,
    learning_options,
    progress_to,
    read_observations,
)
from intuitive_physics_cli.terminal import ProgressBar

PAUSE = 0.5
"""s between two predictions of a recording."""


def add_to(commands: Any) -> None:
    """Add the subcommand to a parser."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "report",
        help="learn from a part of observations, predict the rest, show it on one page",
        description="Learn from a part of the observations, predict the others, and write one "
        "HTML page that needs no network: what was learned, how the cost fell, predictions to "
        "turn in 3D with the worst first, and whether their spread is honest.",
    )
    parser.add_argument("path", type=Path, help=PATH_HELP)
    parser.add_argument("output", type=Path, help="HTML file to write")
    add_learning_options(parser)
    parser.add_argument(
        "--train-fraction",
        type=float,
        default=0.8,
        help="share of the observations that is learned from (default: 0.8)",
    )
    parser.add_argument(
        "--engine", default=ENGINE, help=f"simulator to learn and predict with (default: {ENGINE})"
    )
    parser.add_argument(
        "--rerun",
        type=Path,
        metavar="FILE",
        help="write the predictions also as a Rerun recording (.rrd)",
    )
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    """Write the report and say where."""
    from intuitive_physics_cli.report.learning_report import (
        make_learning_report,
        write_learning_report,
    )

    how = learning_options(options)
    title, observations = read_observations(options.path)
    with ProgressBar("learning") as bar:
        report = make_learning_report(
            f"{options.path.name}: {title}",
            observations,
            how,
            options.train_fraction,
            options.engine,
            progress_to(bar, options),
        )
    write_learning_report(report, options.output)
    if options.rerun:
        _record(report, options.rerun)
    error = report.evaluation.errors["learned parameters"][1].mean
    print(
        f"{options.output}: {len(report.evaluation.training)} observations learned from, "
        f"{len(report.evaluation.test)} predicted, {error:.4f} m off in the mean"
    )


def _record(report: Any, path: Path) -> None:
    """Write the predictions one after the other, each with what then was seen."""
    from intuitive_physics_cli.report.rerun_recording import RerunRecording

    cases = iter(report.predicted.cases)
    with RerunRecording(path) as recording:
        start = 0.0
        for observation in report.predicted.observations:
            recording.environment(observation.environment)
            for _ in observation.objects:
                recording.prediction(next(cases), start)
            recording.observation(observation, start)
            start += (
                max(t.trajectory.times[-1] for t in observation.objects)
                - observation.start_time
                + PAUSE
            )
