"""`experiment`: make the paper's experiments."""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from intuitive_physics.errors import InvalidInputError


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


def _add_learning_curve(experiments: Any) -> None:
    parser = experiments.add_parser(
        "learning-curve",
        help="training and test error over numbers of objects and samples (Fig. 4)",
        description="Learn from sets of 1, 5, 10 objects with 10, 50, 100 samples of each, ten "
        "times, and predict a fifth of the runs that is not learned from.",
    )
    _add_common(parser)
    _add_engine(parser)
    _add_counts(parser, "--objects", "sizes of the pool")
    _add_counts(parser, "--samples", "trajectories of each object")
    parser.add_argument("--repetitions", type=int, help="sets of each kind")
    parser.add_argument("--iterations", type=int, help="evaluations of J for each learning")
    parser.add_argument("--method", help="update rule (default: cma_es)")
    parser.set_defaults(run=_run_learning_curve)


def _run_learning_curve(options: argparse.Namespace) -> None:
    from intuitive_physics_experiments.paper.learning_curve import (
        QUICK,
        LearningCurveSettings,
        run_learning_curve,
    )

    given = _given(options, ("objects", "samples", "repetitions", "iterations"), QUICK)
    if options.method is not None:
        given["method"] = options.method
    settings = LearningCurveSettings(**given, engine=options.engine, seed=options.seed)
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
    _add_counts(parser, "--objects", "sizes of the pool")
    _add_counts(parser, "--samples", "trajectories of each object")
    parser.add_argument("--runs", type=int, help="searches by each rule on each set")
    parser.add_argument("--iterations", type=int, help="evaluations of J in each search")
    parser.set_defaults(run=_run_search_methods)


def _run_search_methods(options: argparse.Namespace) -> None:
    from intuitive_physics_experiments.paper.search_methods import (
        QUICK,
        SearchMethodsSettings,
        run_search_methods,
    )

    given = _given(options, ("objects", "samples", "runs", "iterations"), QUICK)
    settings = SearchMethodsSettings(**given, seed=options.seed)
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
    parser.add_argument("--objects", type=int, help="in the pool")
    parser.add_argument("--samples", type=int, help="trajectories of each object")
    parser.add_argument("--iterations", type=int, help="evaluations of J for the learning")
    parser.set_defaults(run=_run_prediction)


def _run_prediction(options: argparse.Namespace) -> None:
    from intuitive_physics_experiments.paper.prediction import (
        QUICK,
        PredictionExperimentSettings,
        run_prediction,
    )

    given = _given(options, ("objects", "samples", "iterations"), QUICK)
    settings = PredictionExperimentSettings(**given, seed=options.seed)
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
    parser.add_argument("--throws", type=int, help="of each ball")
    parser.add_argument("--iterations", type=int, help="evaluations of J for each learning")
    parser.set_defaults(run=_run_rgbd)


def _run_rgbd(options: argparse.Namespace) -> None:
    from intuitive_physics_experiments.paper.rgbd import QUICK, RgbdSettings, run_rgbd

    given = _given(options, ("throws", "iterations"), QUICK)
    settings = RgbdSettings(**given, seed=options.seed)
    with _bar("working") as bar:
        run_rgbd(options.output, settings, _command(), options.cores, _told(bar))
    _print_page(options.output)


def _add_common(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("output", type=Path, help="folder of tables and figures; goes on there")
    parser.add_argument("--quick", action="store_true", help="reduced settings: about two minutes")
    parser.add_argument("--cores", type=int, default=1, help="of this machine (default: 1)")
    parser.add_argument("--seed", type=int, default=0, help="of all randomness (default: 0)")


def _add_engine(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--engine",
        default="auto",
        help="that moves the objects: auto, stepped, bullet or mujoco; another one than learns "
        "shows what model error costs (default: auto)",
    )


def _add_counts(parser: argparse.ArgumentParser, name: str, what: str) -> None:
    parser.add_argument(name, type=int, nargs="+", metavar="N", help=f"{what}, one or more")


def _given(
    options: argparse.Namespace, names: Sequence[str], quick: dict[str, Any]
) -> dict[str, Any]:
    """Settings of the command line, over the reduced ones where they are asked for."""
    _check_seed(options.seed)
    if options.cores < 1:
        raise InvalidInputError(f"cores is {options.cores}; expected 1 or more")
    chosen = dict(quick) if options.quick else {}
    for name in names:
        value = getattr(options, name)
        if value is not None:
            chosen[name] = tuple(value) if isinstance(value, list) else value
            if min(value if isinstance(value, list) else [value]) < 1:
                raise InvalidInputError(f"--{name} is {value}; expected 1 or more")
    return chosen


def _check_seed(seed: int) -> None:
    if seed < 0:
        raise InvalidInputError(f"seed is {seed}; expected 0 or more")


def _command() -> str:
    return shlex.join(["intuitive-physics", *sys.argv[1:]])


def _bar(label: str) -> Any:
    from intuitive_physics_cli.terminal import ProgressBar

    return ProgressBar(label)


def _told(bar: Any) -> Any:
    return lambda done, total, name: bar.update(done, total, name.replace("_", " "))


def _print_page(folder: Path) -> None:
    print((folder / "README.md").read_text(encoding="utf-8"), end="")
