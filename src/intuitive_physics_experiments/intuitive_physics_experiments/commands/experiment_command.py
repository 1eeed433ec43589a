"""`experiment`: make the paper's experiments."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.settings import add_options, settings_from_options
from intuitive_physics_experiments.paper.settings import (
    DatasetSettings,
    ExperimentSettings,
    LearningCurveSettings,
    PredictionExperimentSettings,
    RgbdSettings,
    SearchMethodsSettings,
)


@dataclass(frozen=True)
class Experiment:
    """A subcommand that makes one experiment, by `run` of the module of its name in `paper`."""

    name: str
    help: str
    description: str
    settings: type[ExperimentSettings]

    @property
    def module(self) -> str:
        """Name of the module; it is imported only when it is needed, since that takes seconds."""
        return f"intuitive_physics_experiments.paper.{self.name.replace('-', '_')}"


# The paper's experiments, in the order of the help
EXPERIMENTS = (
    Experiment(
        "learning-curve",
        "training and test error over numbers of objects and samples (Fig. 4)",
        "Learn from sets of 1, 5, 10 objects with 10, 50, 100 samples of each, ten times, and "
        "predict a fifth of the runs that is not learned from.",
        LearningCurveSettings,
    ),
    Experiment(
        "search-methods",
        "J over iterations of the nine update rules (Fig. 6, Table I)",
        "Search the static parameters of sets of 1, 10, 20 objects with 1, 10, 50 samples of each "
        "by all nine update rules, ten times each.",
        SearchMethodsSettings,
    ),
    Experiment(
        "prediction",
        "noisy-Newton predictions of test runs (Figs. 1 and 5)",
        "Learn from runs of random objects and predict others for 5 s from their first three "
        "points.",
        PredictionExperimentSettings,
    ),
    Experiment(
        "rgbd",
        "thrown balls, rendered, perceived, learned, predicted (Sec. VI, Figs. 7 to 9)",
        "Render throws of balls of 3, 5 and 7 cm radius, run the whole perception pipeline over "
        "them, learn each ball alone and predict throws that were not learned from.",
        RgbdSettings,
    ),
)


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
    for experiment in EXPERIMENTS:
        _add_experiment(experiments, experiment)


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


def _add_experiment(experiments: Any, experiment: Experiment) -> None:
    parser = experiments.add_parser(
        experiment.name, help=experiment.help, description=experiment.description
    )
    parser.add_argument("output", type=Path, help="folder of tables and figures; goes on there")
    parser.add_argument("--quick", action="store_true", help="reduced settings: about two minutes")
    parser.add_argument("--cores", type=int, default=1, help="of this machine (default: 1)")
    add_options(parser, experiment.settings)
    parser.set_defaults(run=lambda options: _run_experiment(experiment, options))


def _run_experiment(experiment: Experiment, options: argparse.Namespace) -> None:
    from intuitive_physics_cli.terminal import ProgressBar
    from intuitive_physics_experiments.results import run_experiment

    if options.cores < 1:
        raise InvalidInputError(f"--cores is {options.cores}; expected 1 or more")
    reduced = experiment.settings.quick if options.quick else {}
    settings = settings_from_options(experiment.settings, options, **reduced)
    with ProgressBar(experiment.name) as bar:
        run_experiment(
            import_module(experiment.module).run,
            experiment.name,
            settings,
            options.output,
            options.cores,
            lambda done, total, name: bar.update(done, total, name.replace("_", " ")),
        )
    print((options.output / "README.md").read_text(encoding="utf-8"), end="")
