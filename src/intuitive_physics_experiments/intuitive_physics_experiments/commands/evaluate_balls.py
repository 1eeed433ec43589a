"""`evaluate` of balls: table tennis, billiards, and observations of one's own."""

from __future__ import annotations

import argparse
from typing import Any

from intuitive_physics.errors import InvalidInputError
from intuitive_physics_cli.commands.observation_source import (
    learning_options,
    progress_to,
    read_observations,
)


def evaluate_balls(options: argparse.Namespace) -> None:
    """Learn with each engine from some of the observations, predict the others, print errors."""
    for name in ("length_correction", "train_counts"):
        if getattr(options, name) is not None:
            raise InvalidInputError(
                f"{name.replace('_', ' ')} is given for {options.path}; "
                "expected it for cube tosses only"
            )
    if options.learn_mass_centre:
        raise InvalidInputError(
            f"mass centre is to be learned from {options.path}; expected that for cube tosses only"
        )
    if options.measured_inertia:
        raise InvalidInputError(
            f"measured inertia is asked for in {options.path}; expected it for cube tosses only"
        )
    how = learning_options(options)
    start = None
    if options.drag != 0.0 or options.magnus:
        from intuitive_physics_experiments.recorded_sets.table_tennis import ball_parameters

        title, observations = _table_tennis(options)
        start = ball_parameters()
    else:
        title, observations = read_observations(options.path)
    print(f"{options.path}: {title}")
    for engine in options.engine:
        _evaluate_with(engine, observations, how, start, options)


def _table_tennis(options: argparse.Namespace) -> tuple[str, Any]:
    from intuitive_physics_experiments.recorded_sets.recorded_data import load_table_tennis
    from intuitive_physics_experiments.recorded_sets.table_tennis import AirCoefficients
    from intuitive_physics_experiments.recorded_sets.table_tennis_evaluation import learn_drag

    def load(air: AirCoefficients) -> list[Any]:
        return load_table_tennis(options.path, air)[1]

    drag, how = options.drag, ""
    if drag is None:
        drag = learn_drag(load, options.magnus, options.train_fraction, options.seed)
        how = "learned "
    air = AirCoefficients(drag, options.magnus)
    title, observations = load_table_tennis(options.path, air)
    told = f"in air with {how}drag {air.drag:.3g} and Magnus coefficient {air.magnus:g}"
    return f"{title}, {told}", observations


def _evaluate_with(
    engine: str, observations: Any, how: Any, start: Any, options: argparse.Namespace
) -> None:
    from intuitive_physics_cli.evaluation.evaluation import evaluate
    from intuitive_physics_cli.parameter_table import parameter_table
    from intuitive_physics_cli.terminal import ProgressBar, format_table

    with ProgressBar("learning") as bar:
        evaluation = evaluate(
            observations, how, options.train_fraction, engine, progress_to(bar, options), start
        )
    search = evaluation.result.search
    print(
        f"{len(observations)} observations, {len(evaluation.training)} to learn from, "
        f"{len(evaluation.test)} to test\n"
        f"{options.method}, {engine}: {search.iterations} iterations in {search.seconds:.1f} s\n"
    )
    print(parameter_table(evaluation.result.learned))
    rows = [
        [
            name,
            f"{training.mean:.4f}",
            f"{test.mean:.4f}",
            f"{training.last:.4f}",
            f"{test.last:.4f}",
        ]
        for name, (training, test) in evaluation.errors.items()
    ]
    header = ["error (m)", "J training", "J test", "last point training", "last point test"]
    print("\n" + format_table(header, rows))
    if start is not None:
        _print_look_ahead(evaluation, start)


def _print_look_ahead(evaluation: Any, start: Any) -> None:
    import numpy as np

    from intuitive_physics_cli.terminal import format_table
    from intuitive_physics_experiments.recorded_sets.table_tennis_evaluation import (
        WATCHED,
        look_ahead,
    )

    learned = evaluation.result.learned.parameters
    ahead = look_ahead(evaluation.test, learned, start)
    if ahead is None:
        return
    rows = [
        [name, f"{errors.mean():.4f}", f"{np.median(errors):.4f}"]
        for name, errors in ahead.errors.items()
    ]
    count = len(next(iter(ahead.errors.values())))
    print(
        f"\n{ahead.ahead:.1f} s ahead, from the first {WATCHED:g} s of {count} flights of the test"
    )
    print(format_table(["error (m)", "mean", "median"], rows))
    print(f"spread of the balls themselves at that time: {ahead.spread:.4f} m")
