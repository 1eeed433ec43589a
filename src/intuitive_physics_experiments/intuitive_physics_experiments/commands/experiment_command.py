"""`experiment`: make the paper's experiments."""

from __future__ import annotations

import argparse
import shlex
import sys
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from intuitive_physics.errors import InvalidInputError


@dataclass(frozen=True)
class NumberOption:
    """A setting of an experiment that is a whole number above zero, or some of them.

    Parameters
    ----------
    name : of the settings' field, and of the option
    help : what the number is of
    several : whether more than one may be given
    """

    name: str
    help: str
    several: bool = False


@dataclass(frozen=True)
class Experiment:
    """A subcommand that makes one experiment.

    Parameters
    ----------
    name : of the subcommand
    help, description : as argparse shows them
    module : that makes it; imported only when it is asked for, since that takes seconds
    run : name of the module's function of folder, settings, command, cores and progress
    settings : name of the module's class of settings; its `QUICK` has the reduced ones
    label : of the progress bar
    numbers : options that are numbers
    has_engine, has_method : whether simulator and update rule can be chosen
    """

    name: str
    help: str
    description: str
    module: str
    run: str
    settings: str
    label: str
    numbers: tuple[NumberOption, ...]
    has_engine: bool = False
    has_method: bool = False


EXPERIMENTS = (
    Experiment(
        "learning-curve",
        "training and test error over numbers of objects and samples (Fig. 4)",
        "Learn from sets of 1, 5, 10 objects with 10, 50, 100 samples of each, ten times, and "
        "predict a fifth of the runs that is not learned from.",
        "intuitive_physics_experiments.paper.learning_curve",
        "run_learning_curve",
        "LearningCurveSettings",
        "learning",
        (
            NumberOption("objects", "sizes of the pool", several=True),
            NumberOption("samples", "trajectories of each object", several=True),
            NumberOption("repetitions", "sets of each kind"),
            NumberOption("iterations", "evaluations of J for each learning"),
        ),
        has_engine=True,
        has_method=True,
    ),
    Experiment(
        "search-methods",
        "J over iterations of the nine update rules (Fig. 6, Table I)",
        "Search the static parameters of sets of 1, 10, 20 objects with 1, 10, 50 samples of each "
        "by all nine update rules, ten times each.",
        "intuitive_physics_experiments.paper.search_methods",
        "run_search_methods",
        "SearchMethodsSettings",
        "searching",
        (
            NumberOption("objects", "sizes of the pool", several=True),
            NumberOption("samples", "trajectories of each object", several=True),
            NumberOption("runs", "searches by each rule on each set"),
            NumberOption("iterations", "evaluations of J in each search"),
        ),
    ),
    Experiment(
        "prediction",
        "noisy-Newton predictions of test runs (Figs. 1 and 5)",
        "Learn from runs of random objects and predict others for 5 s from their first three "
        "points.",
        "intuitive_physics_experiments.paper.prediction",
        "run_prediction",
        "PredictionExperimentSettings",
        "learning",
        (
            NumberOption("objects", "in the pool"),
            NumberOption("samples", "trajectories of each object"),
            NumberOption("iterations", "evaluations of J for the learning"),
        ),
    ),
    Experiment(
        "rgbd",
        "thrown balls, rendered, perceived, learned, predicted (Sec. VI, Figs. 7 to 9)",
        "Render throws of balls of 3, 5 and 7 cm radius, run the whole perception pipeline over "
        "them, learn each ball alone and predict throws that were not learned from.",
        "intuitive_physics_experiments.paper.rgbd",
        "run_rgbd",
        "RgbdSettings",
        "working",
        (
            NumberOption("throws", "of each ball"),
            NumberOption("iterations", "evaluations of J for each learning"),
        ),
    ),
)
"""The paper's experiments, in the order of the help."""


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
    parser.add_argument("--objects", type=int, default=1, help="in the pool (default: 1)")
    parser.add_argument(
        "--samples", type=int, default=10, help="trajectories of each object (default: 10)"
    )
    _add_engine(parser)
    parser.add_argument(
        "--first-states",
        dest="initial_states",
        default="three_points",
        help="three_points, as in the paper, flight, or true (default: three_points)",
    )
    parser.add_argument("--seed", type=int, default=0, help="of all randomness (default: 0)")
    parser.set_defaults(run=_run_dataset)


def _run_dataset(options: argparse.Namespace) -> None:
    import numpy as np

    from intuitive_physics_cli.terminal import ProgressBar
    from intuitive_physics_experiments.paper.paper_dataset import (
        make_paper_dataset,
        save_paper_dataset,
    )

    _check_seed(options.seed)
    with ProgressBar("simulating") as bar:
        dataset = make_paper_dataset(
            options.objects,
            options.samples,
            np.random.default_rng(options.seed),
            engine=options.engine,
            initial_states=options.initial_states,
            on_progress=bar.update,
        )
    save_paper_dataset(dataset, options.output)
    print(
        f"{options.output}: {len(dataset.training)} runs to learn from, {len(dataset.test)} to "
        f"test, {options.objects} objects, {options.samples} trajectories of each"
    )


def _add_experiment(experiments: Any, experiment: Experiment) -> None:
    parser = experiments.add_parser(
        experiment.name, help=experiment.help, description=experiment.description
    )
    parser.add_argument("output", type=Path, help="folder of tables and figures; goes on there")
    parser.add_argument("--quick", action="store_true", help="reduced settings: about two minutes")
    parser.add_argument("--cores", type=int, default=1, help="of this machine (default: 1)")
    parser.add_argument("--seed", type=int, default=0, help="of all randomness (default: 0)")
    if experiment.has_engine:
        _add_engine(parser)
    for number in experiment.numbers:
        if number.several:
            parser.add_argument(
                f"--{number.name}",
                type=int,
                nargs="+",
                metavar="N",
                help=f"{number.help}, one or more",
            )
        else:
            parser.add_argument(f"--{number.name}", type=int, help=number.help)
    if experiment.has_method:
        parser.add_argument("--method", help="update rule (default: cma_es)")
    parser.set_defaults(run=lambda options: _run_experiment(experiment, options))


def _run_experiment(experiment: Experiment, options: argparse.Namespace) -> None:
    from intuitive_physics_cli.terminal import ProgressBar

    module = import_module(experiment.module)
    settings = getattr(module, experiment.settings)(**_given(experiment, options, module.QUICK))
    with ProgressBar(experiment.label) as bar:
        getattr(module, experiment.run)(
            options.output,
            settings,
            shlex.join(["intuitive-physics", *sys.argv[1:]]),
            options.cores,
            lambda done, total, name: bar.update(done, total, name.replace("_", " ")),
        )
    print((options.output / "README.md").read_text(encoding="utf-8"), end="")


def _given(
    experiment: Experiment, options: argparse.Namespace, quick: dict[str, Any]
) -> dict[str, Any]:
    """Settings of the command line, over the reduced ones where they are asked for."""
    _check_seed(options.seed)
    if options.cores < 1:
        raise InvalidInputError(f"cores is {options.cores}; expected 1 or more")
    chosen = {**(quick if options.quick else {}), "seed": options.seed}
    for number in experiment.numbers:
        value = getattr(options, number.name)
        if value is not None:
            chosen[number.name] = tuple(value) if number.several else value
            if min(value if number.several else [value]) < 1:
                raise InvalidInputError(f"--{number.name} is {value}; expected 1 or more")
    if experiment.has_engine:
        chosen["engine"] = options.engine
    if experiment.has_method and options.method is not None:
        chosen["method"] = options.method
    return chosen


def _add_engine(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--engine",
        default="auto",
        help="that moves the objects: auto, stepped, bullet or mujoco; another one than learns "
        "shows what model error costs (default: auto)",
    )


def _check_seed(seed: int) -> None:
    if seed < 0:
        raise InvalidInputError(f"seed is {seed}; expected 0 or more")
