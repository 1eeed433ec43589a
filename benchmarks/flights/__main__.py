"""`make bench-flights`: recorded table-tennis flights, beside an extended Kalman filter.

README.md in the folder above says what is measured and how.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.command import Outcome, report_progress, run_benchmark
from benchmarks.peers.table_tennis_filter import FilterParameters, filter_prediction, fit_filter
from benchmarks.results.result import Cell, Column, Table
from intuitive_physics_experiments.recorded_sets.flight_evaluation import (
    SMOOTHED,
    SPINLESS,
    FlightEvaluation,
    FlightScore,
    bounces_well,
    evaluate_flights,
    predicted_errors,
    test_half,
    training_half,
)
from intuitive_physics_experiments.recorded_sets.flight_tables import labelled_well
from intuitive_physics_experiments.recorded_sets.recorded_data import load_spin_flights
from intuitive_physics_experiments.recorded_sets.spin_flights import SpinFlight

# Recordings of others, beside the clone
REAL_DATA = Path(__file__).resolve().parents[3] / "shared" / "data" / "real"
# Evaluations of the cost that a filter is tuned by, from parameters of an earlier tuning
EVALUATIONS, QUICK_EVALUATIONS = 120, 20
LARGEST_ERROR = 0.2  # m; a larger error counts as that when a filter is tuned
# Bars: relative error of the spin across the flight, error beyond the bounce over a filter's
MOST_SPIN_ERROR, MOST_OVER_FILTER = 0.25, 0.7


@dataclass(frozen=True)
class Peer:
    """A filter to tune."""

    name: str
    start: FilterParameters  # of the tuning
    stamped: bool = False  # whether it takes the times as stamped instead of those of the frames


SLIPS_OR_ROLLS = FilterParameters(
    drag=0.565,
    magnus=0.314,
    restitution=0.970,
    share=0.187,
    friction=0.228,
    noise=0.0006,
    noise_along=0.0018,
    acceleration=0.275,
    bounce_noise=0.144,
    spin_deviation=114.0,
)
"""Where the tuning of a filter with a bounce that slips or rolls starts."""

LINEAR = Peer("filter, linear bounce", FilterParameters())
PEERS = (
    LINEAR,
    Peer("filter, bounce slips or rolls", SLIPS_OR_ROLLS),
    Peer("filter, linear bounce, times as stamped", FilterParameters(), stamped=True),
)
"""Filters, all tuned on the flights that ours learns from."""

# Median errors in m beyond the bounce, of training and test, then beyond the last row seen
Errors = tuple[float, float, float, float]


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the tables, and print the line of JSON last."""
    return run_benchmark("flights", __doc__, run, arguments, _add_options)


def _add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--set",
        type=Path,
        default=REAL_DATA / "table_tennis_spin.npz",
        help="recorded flights with measured spin (default: %(default)s)",
    )


def run(options: argparse.Namespace) -> Outcome:
    """Evaluate ours, tune and evaluate the filters."""
    flights = load_spin_flights(options.set)
    evaluation = evaluate_flights(flights, lambda done, total: None)
    errors = {way: _own_errors(evaluation, way) for way in (SMOOTHED, SPINLESS)}
    for peer in PEERS:
        report_progress(f"tuning the {peer.name}")
        evaluations = QUICK_EVALUATIONS if options.quick else EVALUATIONS
        errors[peer.name] = _filter_errors(peer, flights, evaluations)
    spin_error = _spin_error(evaluation.test)
    over_filter = errors[SMOOTHED][1] / errors[LINEAR.name][1]
    complaints = []
    if spin_error > MOST_SPIN_ERROR:
        complaints.append(
            f"spin across the flight is off by {spin_error:.0%}; expected {MOST_SPIN_ERROR:.0%}"
        )
    if over_filter > MOST_OVER_FILTER:
        complaints.append(
            f"error over the filter's is {over_filter:.2f}; expected {MOST_OVER_FILTER:g}"
        )
    figures = {
        "spin_relative_error": {
            "all": spin_error,
            "not_contradicted": _spin_error(labelled_well(evaluation.test)),
        },
        "beyond_bounce_over_filter": over_filter,
        "beyond_bounce_over_no_spin": errors[SMOOTHED][1] / errors[SPINLESS][1],
        "beyond_seen_over_filter": errors[SMOOTHED][3] / errors[LINEAR.name][3],
        "median_error_m": {way: list(values) for way, values in errors.items()},
        "test_flights": len(evaluation.test),
    }
    return Outcome([_table(errors, evaluation)], figures, complaints=complaints)


def _spin_error(scores: Sequence[FlightScore]) -> float:
    return float(np.median([score.relative_error for score in scores]))


def _own_errors(evaluation: FlightEvaluation, way: str) -> Errors:
    training, test = (
        np.nanmedian([(score.beyond_bounce[way], score.beyond_seen[way]) for score in half], axis=0)
        for half in (evaluation.training, evaluation.test)
    )
    return float(training[0]), float(test[0]), float(training[1]), float(test[1])


def _filter_errors(peer: Peer, flights: Sequence[SpinFlight], evaluations: int) -> Errors:
    """Tune on the training half, then predict both."""
    timed = [replace(flight, times=flight.stamps) if peer.stamped else flight for flight in flights]
    halves = [
        [flight for flight in half if bounces_well(flight)]
        for half in (training_half(timed), test_half(timed))
    ]

    def cost(parameters: FilterParameters) -> float:
        errors = np.minimum(_errors_with(parameters, halves[0]), LARGEST_ERROR)
        return float(np.nanmean(errors, axis=0).sum())

    tuned = fit_filter(peer.start, cost, evaluations)
    training, test = (np.nanmedian(_errors_with(tuned, half), axis=0) for half in halves)
    return float(training[0]), float(test[0]), float(training[1]), float(test[1])


def _errors_with(parameters: FilterParameters, flights: Sequence[SpinFlight]) -> np.ndarray:
    """Errors (n, 2) m beyond the bounce and beyond what was seen."""
    predictors = {"": lambda *rows: filter_prediction(parameters, *rows)}
    with np.errstate(all="ignore"):
        pairs = [predicted_errors(predictors, flight) for flight in flights]
    return np.array([[bounce[""], seen[""]] for bounce, seen in pairs])


def _table(errors: Mapping[str, Errors], evaluation: FlightEvaluation) -> Table:
    columns = [
        Column("way to predict"),
        Column("beyond the bounce, training", "mm", ".1f"),
        Column("test", "mm", ".1f"),
        Column("beyond what was seen after it, training", "mm", ".1f"),
        Column("test", "mm", ".1f"),
    ]
    rows: list[list[Cell]] = [
        [way, *(1000.0 * value for value in values)] for way, values in errors.items()
    ]
    note = (
        f"Median errors over {len(evaluation.training)} flights that were learned from and "
        f"{len(evaluation.test)} that were not."
    )
    return Table("Flights with measured spin", columns, rows, note)


if __name__ == "__main__":
    sys.exit(main())
