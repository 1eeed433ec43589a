"""`evaluate` of cube tosses: friction and restitution, position and rotation."""

from __future__ import annotations

import argparse

from intuitive_physics.errors import InvalidInputError
from intuitive_physics_cli.commands.observation_source import learning_options, progress_to


def evaluate_cube_tosses(options: argparse.Namespace) -> None:
    """Fit each engine to some of the tosses, simulate the others, print errors."""
    from intuitive_physics_cli.terminal import ProgressBar
    from intuitive_physics_experiments.recorded_sets.recorded_data import load_cube_tosses
    from intuitive_physics_experiments.recorded_sets.toss_evaluation import evaluate_tosses
    from intuitive_physics_experiments.recorded_sets.toss_table import toss_table

    if options.drag != 0.0 or options.magnus:
        raise InvalidInputError(
            f"drag or Magnus coefficient is given for {options.path}; expected them for table "
            "tennis only"
        )
    how = learning_options(options)
    factor = 1.0 if options.length_correction is None else options.length_correction
    tosses = load_cube_tosses(options.path, factor, options.measured_inertia)
    print(f"{options.path}: cube tosses{_told(factor, options.measured_inertia)}")
    for fraction in _fractions(options, len(tosses)):
        with ProgressBar("fitting") as bar:
            evaluation = evaluate_tosses(
                tosses,
                options.engine,
                how,
                fraction,
                progress_to(bar, options),
                options.learn_mass_centre,
            )
        print(
            f"{len(tosses)} tosses, {len(evaluation.training)} to fit to, "
            f"{len(evaluation.test)} to test\n"
        )
        print(toss_table(evaluation), end="\n\n")


def _told(factor: float, measured_inertia: bool) -> str:
    lengths = "" if factor == 1.0 else f", lengths times {factor:g}"
    return lengths + (", moment of inertia as measured" if measured_inertia else "")


def _fractions(options: argparse.Namespace, count: int) -> list[float]:
    if options.train_counts is None:
        return [options.train_fraction]
    for n in options.train_counts:
        if not 0 < n < count:
            raise InvalidInputError(
                f"train count is {n} of {count} tosses; expected at least 1, and some to test"
            )
    return [n / count for n in options.train_counts]
