"""`evaluate`: learn on a part of recorded observations and predict the rest."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.simulation import ENGINE_GUIDE
from intuitive_physics_cli.commands.observation_source import (
    ENGINE,
    ITERATIONS,
    METHOD,
    PATH_HELP,
    add_learning_options,
    learning_options,
    progress_to,
    read_observations,
)

LEARN = "learn"  # In place of a drag coefficient

# Options of cube tosses only.
TOSS_OPTIONS = (
    "length_correction",
    "train_counts",
    "save",
    "learn_mass_centre",
    "measured_inertia",
)

AIR_OPTIONS = ("drag", "magnus")  # Options of table tennis only

# Options that are not given, for everything but cube tosses.
BALL_DEFAULTS = {
    "engine": [ENGINE],
    "method": METHOD,
    "iterations": ITERATIONS,
    "train_fraction": 0.8,
}

# Options that are not given, for cube tosses.
TOSS_DEFAULTS = {
    "engine": ["stepped"],
    "method": "cma_es",
    "iterations": 120,
    "train_fraction": 0.25,
}


def add_to(commands: Any) -> None:
    """Add the subcommand to a parser."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "evaluate",
        help="learn on a part of recorded observations, predict the rest",
        description="Learn the static parameters from a part of the observations, predict the "
        "others from their initial states, and compare with default parameters and free flight. "
        "For cube tosses friction and restitution are fitted, errors count rotation too and stand "
        "beside those that others have published. For flights with measured spin, state and spin "
        "are estimated from flight and bounce, and both halves of the set are predicted.",
    )
    parser.add_argument("path", type=Path, help=PATH_HELP)
    add_learning_options(parser, "; cma_es for cube tosses", "; 120 for cube tosses")
    parser.set_defaults(method=None, iterations=None)
    parser.add_argument(
        "--train-fraction",
        type=float,
        help="share of the observations that is learned from (default: 0.8; 0.25 for cube tosses)",
    )
    parser.add_argument(
        "--engine",
        action="append",
        help="simulator to learn and predict with, may be given more than once "
        f"(default: {ENGINE}; stepped for cube tosses). {ENGINE_GUIDE}; mujoco: MuJoCo, likewise",
    )
    _add_toss_options(parser)
    parser.add_argument(
        "--drag",
        type=_drag,
        default=0.0,
        metavar="C",
        help="drag coefficient of table-tennis balls, such as 0.47, or `learn`; needs an engine "
        "with air (default: 0, no air)",
    )
    parser.add_argument(
        "--magnus",
        type=float,
        default=0.0,
        metavar="C",
        help="Magnus coefficient of table-tennis balls, such as 1; their spin is fitted to their "
        "flight then (default: 0)",
    )
    parser.set_defaults(run=run)


def _drag(text: str) -> float | str:
    if text == LEARN:
        return text
    try:
        return float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"is {text!r}; expected a number or {LEARN!r}") from None


def _add_toss_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--train-counts",
        type=int,
        nargs="+",
        metavar="N",
        help="numbers of cube tosses to learn from, one after the other, instead of a share",
    )
    parser.add_argument(
        "--measured-inertia",
        action="store_true",
        help="turn the tossed cube as the recording says that the real one turns, not as a solid",
    )
    parser.add_argument(
        "--learn-mass-centre",
        action="store_true",
        help="learn where the tossed cube's centre of mass is from its flights",
    )
    parser.add_argument(
        "--length-correction",
        type=float,
        metavar="FACTOR",
        help="factor on the recorded lengths of cube tosses, which are about 2 %% short "
        "(default: 1, as recorded)",
    )
    parser.add_argument(
        "--save",
        type=Path,
        metavar="FOLDER",
        help="keep the tables of cube tosses there: errors.csv, and README.md with the command",
    )


def run(options: argparse.Namespace) -> None:
    """Evaluate and print the tables."""
    from intuitive_physics_experiments.recorded_sets.recorded_data import (
        CUBE_TOSSES,
        SPIN_FLIGHTS,
        kind_of_set,
    )

    path = options.path
    kind = kind_of_set(path) if path.suffix == ".npz" and path.is_file() else None
    if kind is SPIN_FLIGHTS:
        _evaluate_spin_flights(options)
        return
    tosses = kind is CUBE_TOSSES
    for name, value in (TOSS_DEFAULTS if tosses else BALL_DEFAULTS).items():
        if getattr(options, name) is None:
            setattr(options, name, value)
    if tosses:
        _evaluate_cube_tosses(options)
    else:
        _evaluate_balls(options)


def _refuse(options: argparse.Namespace, names: Sequence[str], expected: str) -> None:
    """Refuse those of the options that are given."""
    for name in names:
        if getattr(options, name) not in (None, False, 0.0):
            raise InvalidInputError(
                f"{name.replace('_', ' ')} is given for {options.path}; expected {expected}"
            )


def _evaluate_balls(options: argparse.Namespace) -> None:
    """Learn with each engine from some of the observations, predict the others, print errors."""
    _refuse(options, TOSS_OPTIONS, "it for cube tosses only")
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


def _evaluate_spin_flights(options: argparse.Namespace) -> None:
    """Estimate and predict flights with measured spin, print errors of both halves."""
    from intuitive_physics_cli.terminal import ProgressBar
    from intuitive_physics_experiments.recorded_sets.flight_evaluation import evaluate_flights
    from intuitive_physics_experiments.recorded_sets.flight_tables import flight_tables
    from intuitive_physics_experiments.recorded_sets.recorded_data import load_spin_flights

    _refuse(options, TOSS_OPTIONS, "it for cube tosses only")
    _refuse(options, AIR_OPTIONS, "none, both are learned with the spin")
    learning = "none, flights of even number are learned from by expectation maximisation"
    _refuse(options, tuple(BALL_DEFAULTS), learning)
    flights = load_spin_flights(options.path)
    with ProgressBar("estimating") as bar:
        evaluation = evaluate_flights(flights, bar.update)
    print(f"{options.path}: table-tennis flights with measured spin")
    print(flight_tables(evaluation))


def _table_tennis(options: argparse.Namespace) -> tuple[str, Any]:
    from intuitive_physics_experiments.recorded_sets.recorded_data import load_table_tennis
    from intuitive_physics_experiments.recorded_sets.table_tennis import AirCoefficients
    from intuitive_physics_experiments.recorded_sets.table_tennis_evaluation import learn_drag

    def load(air: AirCoefficients) -> list[Any]:
        return load_table_tennis(options.path, air)[1]

    drag, how = options.drag, ""
    if drag == LEARN:
        drag = learn_drag(load, options.magnus, options.train_fraction, options.seed)
        how = "learned "
    air = AirCoefficients(drag, options.magnus)
    title, observations = load_table_tennis(options.path, air)
    air_note = f"in air with {how}drag {air.drag:.3g} and Magnus coefficient {air.magnus:g}"
    return f"{title}, {air_note}", observations


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


def _evaluate_cube_tosses(options: argparse.Namespace) -> None:
    """Fit each engine to some of the tosses, simulate the others, print errors."""
    from intuitive_physics_cli.terminal import ProgressBar
    from intuitive_physics_experiments.recorded_sets.recorded_data import load_cube_tosses
    from intuitive_physics_experiments.recorded_sets.toss_evaluation import evaluate_tosses
    from intuitive_physics_experiments.recorded_sets.toss_tables import (
        toss_table,
        write_toss_evaluations,
    )

    _refuse(options, AIR_OPTIONS, "it for table tennis only")
    how = learning_options(options)
    factor = 1.0 if options.length_correction is None else options.length_correction
    tosses = load_cube_tosses(options.path, factor, options.measured_inertia)
    title = f"{options.path}: cube tosses"
    title += "" if factor == 1.0 else f", lengths times {factor:g}"
    title += ", moment of inertia as measured" if options.measured_inertia else ""
    print(title)
    evaluations = []
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
        print(toss_table(evaluation), end="\n\n")
        evaluations.append(evaluation)
    if options.save is not None:
        write_toss_evaluations(options.save, title, evaluations)


def _fractions(options: argparse.Namespace, count: int) -> list[float]:
    if options.train_counts is None:
        return [options.train_fraction]
    for n in options.train_counts:
        if not 0 < n < count:
            raise InvalidInputError(
                f"train count is {n} of {count} tosses; expected at least 1, and some to test"
            )
    return [n / count for n in options.train_counts]
