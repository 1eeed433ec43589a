"""`experiment`: make the paper's experiments."""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.settings import add_options, settings_from_options
from intuitive_physics_experiments.paper.settings import (
    QUICK_LEARNING_CURVE,
    QUICK_PREDICTION,
    QUICK_RGBD,
    QUICK_SEARCH_METHODS,
    DatasetSettings,
    LearningCurveSettings,
    PredictionExperimentSettings,
    RgbdSettings,
    SearchMethodsSettings,
)

_Settings = TypeVar("_Settings")


def add_to(commands: Any) -> None:
    """Add the subcommand, with a subcommand for each experiment, to a parser."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "experiment",
        help="make the paper's experiments",
        description="Make the experiments of the paper. Each can be interrupted and started "
        "again with the same folder: what is finished is kept.",
    )
    experiments = parser.add_subparsers(title="experiments", required=True, metavar="EXPERIMENT")
    _add_dataset(experiments)
    _add_learning_curve(experiments)
    _add_search_methods(experiments)
    _add_prediction(experiments)
    _add_rgbd(experiments)


def _add_dataset(experiments: Any) -> None:
    parser = experiments.add_parser(
        "dataset",
        help="make the synthetic set of Sec. IV-B",
        description="Throw random spheres, boxes and capsules through a room, 5 s a run, and write "
        "what was seen of them (30 Hz, noise of 2 cm) with the ground truth.",
    )
    parser.add_argument("output", type=Path, help="folder to make")
    add_options(parser, DatasetSettings)
    parser.add_argument(
        "--first-states",
        dest="initial_states",
        default="three_points",
        help="three_points, as in the paper, flight, or true (default: three_points)",
    )
    parser.set_defaults(run=_run_dataset)


def _run_dataset(options: argparse.Namespace) -> None:
    import numpy as np

    from intuitive_physics_cli.terminal import ProgressBar
    from intuitive_physics_experiments.paper.paper_dataset import (
        make_paper_dataset,
        save_paper_dataset,
    )

    settings = settings_from_options(DatasetSettings, options)
    with ProgressBar("simulating") as bar:
        dataset = make_paper_dataset(
            settings.objects,
            settings.samples,
            np.random.default_rng(settings.seed),
            engine=settings.engine,
            initial_states=options.initial_states,
            on_progress=bar.update,
        )
    save_paper_dataset(dataset, options.output)
    print(
        f"{options.output}: {len(dataset.training)} runs to learn from, {len(dataset.test)} to "
        f"test, {settings.objects} objects, {settings.samples} trajectories of each"
    )


def _add_learning_curve(experiments: Any) -> None:
    parser = experiments.add_parser(
        "learning-curve",
        help="training and test error over numbers of objects and samples (Fig. 4)",
        description="Learn from sets of 1, 5, 10 objects with 10, 50, 100 samples of each, ten "
        "times, and predict a fifth of the runs that is not learned from.",
    )
    _add_common(parser)
    add_options(
        parser,
        LearningCurveSettings,
        ("objects", "samples", "repetitions", "iterations", "method", "engine", "seed"),
    )
    parser.set_defaults(run=_run_learning_curve)


def _run_learning_curve(options: argparse.Namespace) -> None:
    from intuitive_physics_experiments.paper.learning_curve import run_learning_curve

    settings = _settings(LearningCurveSettings, options, QUICK_LEARNING_CURVE)
    with _bar("learning") as bar:
        run_learning_curve(options.output, settings, _command(), options.cores, _told(bar))
    _print_page(options.output)


def _add_search_methods(experiments: Any) -> None:
    parser = experiments.add_parser(
        "search-methods",
        help="J over iterations of the nine update rules (Fig. 6, Table I)",
        description="Search the static parameters of sets of 1, 10, 20 objects with 1, 10, 50 "
        "samples of each by all nine update rules, ten times each.",
    )
    _add_common(parser)
    add_options(parser, SearchMethodsSettings)
    parser.set_defaults(run=_run_search_methods)


def _run_search_methods(options: argparse.Namespace) -> None:
    from intuitive_physics_experiments.paper.search_methods import run_search_methods

    settings = _settings(SearchMethodsSettings, options, QUICK_SEARCH_METHODS)
    with _bar("searching") as bar:
        run_search_methods(options.output, settings, _command(), options.cores, _told(bar))
    _print_page(options.output)


def _add_prediction(experiments: Any) -> None:
    parser = experiments.add_parser(
        "prediction",
        help="noisy-Newton predictions of test runs (Figs. 1 and 5)",
        description="Learn from runs of random objects and predict others for 5 s from their "
        "first three points.",
    )
    _add_common(parser)
    add_options(parser, PredictionExperimentSettings, ("objects", "samples", "iterations", "seed"))
    parser.set_defaults(run=_run_prediction)


def _run_prediction(options: argparse.Namespace) -> None:
    from intuitive_physics_experiments.paper.prediction import run_prediction

    settings = _settings(PredictionExperimentSettings, options, QUICK_PREDICTION)
    with _bar("learning") as bar:
        run_prediction(options.output, settings, _command(), options.cores, _told(bar))
    _print_page(options.output)


def _add_rgbd(experiments: Any) -> None:
    parser = experiments.add_parser(
        "rgbd",
        help="thrown balls, rendered, perceived, learned, predicted (Sec. VI, Figs. 7 to 9)",
        description="Render throws of balls of 3, 5 and 7 cm radius, run the whole perception "
        "pipeline over them, learn each ball alone and predict throws that were not learned from.",
    )
    _add_common(parser)
    add_options(parser, RgbdSettings, ("throws", "iterations", "seed"))
    parser.set_defaults(run=_run_rgbd)


def _run_rgbd(options: argparse.Namespace) -> None:
    from intuitive_physics_experiments.paper.rgbd import run_rgbd

    settings = _settings(RgbdSettings, options, QUICK_RGBD)
    with _bar("working") as bar:
        run_rgbd(options.output, settings, _command(), options.cores, _told(bar))
    _print_page(options.output)


def _add_common(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("output", type=Path, help="folder of tables and figures; goes on there")
    parser.add_argument("--quick", action="store_true", help="reduced settings: about two minutes")
    parser.add_argument("--cores", type=int, default=1, help="of this machine (default: 1)")


def _settings(
    kind: type[_Settings], options: argparse.Namespace, quick: Mapping[str, Any]
) -> _Settings:
    """Return the settings of the command line, over the reduced ones where it asks for them."""
    if options.cores < 1:
        raise InvalidInputError(f"--cores is {options.cores}; expected 1 or more")
    return settings_from_options(kind, options, **(quick if options.quick else {}))


def _command() -> str:
    return shlex.join(["intuitive-physics", *sys.argv[1:]])


def _bar(label: str) -> Any:
    from intuitive_physics_cli.terminal import ProgressBar

    return ProgressBar(label)


def _told(bar: Any) -> Any:
    return lambda done, total, name: bar.update(done, total, name.replace("_", " "))


def _print_page(folder: Path) -> None:
    print((folder / "README.md").read_text(encoding="utf-8"), end="")
