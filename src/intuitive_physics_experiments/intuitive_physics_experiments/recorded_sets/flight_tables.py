"""Tables of what was estimated and predicted of flights with measured spin."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.linalg import norm

from intuitive_physics_cli.terminal import format_table
from intuitive_physics_experiments.recorded_sets.flight_estimation import COEFFICIENTS
from intuitive_physics_experiments.recorded_sets.flight_evaluation import (
    SEEN_BEYOND,
    SMOOTHED,
    SPINLESS,
    WINDOW,
    FlightEvaluation,
    FlightScore,
)

# Log odds by the flight before the bounce below which a measured spin is not of this flight.
UNLIKELY_LABEL = -3.0


def flight_tables(evaluation: FlightEvaluation) -> str:
    """Coefficients that were learned, errors of the spin, and of predictions."""
    halves = (evaluation.training, evaluation.test)
    counts = ", ".join(
        f"{count} of {parity} number ({len(half)} with a bounce that is scored)"
        for count, parity, half in zip(evaluation.counts, ("even", "odd"), halves, strict=True)
    )
    return "\n\n".join(
        [
            f"flights: {counts}; learned from those of even number",
            _coefficient_table(evaluation),
            _spin_table(evaluation),
            _prediction_table(evaluation),
        ]
    )


def labelled_well(scores: Sequence[FlightScore]) -> list[FlightScore]:
    """Scores whose measured spin the flight before the bounce does not contradict."""
    return [score for score in scores if score.label_odds > UNLIKELY_LABEL]


def _coefficient_table(evaluation: FlightEvaluation) -> str:
    prior = evaluation.prior
    deviations = np.sqrt(np.diag(prior.coefficient_covariance))
    rows = [
        [name.replace("_", " "), f"{mean:.4f}", f"{deviation:.4f}"]
        for name, mean, deviation in zip(COEFFICIENTS, prior.coefficients, deviations, strict=True)
    ]
    return format_table(["coefficient", "mean", "σ of flights"], rows)


def _spin_table(evaluation: FlightEvaluation) -> str:
    rows = []
    for name, all_scores in (("training", evaluation.training), ("test", evaluation.test)):
        for which, scores in (("all", all_scores), ("not contradicted", labelled_well(all_scores))):
            rows.append([f"{name}, {which}", str(len(scores)), *_spin_cells(scores)])
    header = [
        "spin across the flight, medians",
        "flights",
        "relative error before",
        "after bounce",
        "of the level part",
        "σ of the level part (rad/s)",
    ]
    return format_table(header, rows)


def _spin_cells(scores: Sequence[FlightScore]) -> list[str]:
    before = [float(norm(score.before - score.measured) / norm(score.measured)) for score in scores]
    level = [abs(float(score.after[0] / score.measured[0]) - 1.0) for score in scores]
    return [
        f"{_median(before):.0%}",
        f"{_median([score.relative_error for score in scores]):.0%}",
        f"{_median(level):.0%}",
        f"{_median([float(score.deviation[0]) for score in scores]):.0f}",
    ]


def _prediction_table(evaluation: FlightEvaluation) -> str:
    halves = (evaluation.training, evaluation.test)
    rows = []
    for way in (SMOOTHED, SPINLESS):
        errors = [[score.beyond_bounce[way] for score in half] for half in halves]
        errors += [[score.beyond_seen[way] for score in half] for half in halves]
        rows.append([way, *(f"{_median(values):.4f}" for values in errors)])
    header = ["median error (m)", "before, training", "test", "after, training", "test"]
    note = (
        f"{WINDOW[0]:g} to {WINDOW[1]:g} s beyond the bounce, seen before it, and beyond the first "
        f"{SEEN_BEYOND:g} s after it, seen until then"
    )
    return f"{note}\n{format_table(header, rows)}"


def _median(values: Sequence[float]) -> float:
    return float(np.nanmedian(values)) if np.isfinite(values).any() else float("nan")
