"""Results of an evaluation of cube tosses, as tables to read and as files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_cli.terminal import format_table
from intuitive_physics_experiments.recorded_sets.cube_tosses import CUBE_MATERIAL, TABLE_MATERIAL
from intuitive_physics_experiments.recorded_sets.toss_evaluation import (
    TossErrors,
    TossEvaluation,
    TossFit,
)
from intuitive_physics_experiments.recorded_sets.toss_mass_centre import MassCentreFit
from intuitive_physics_experiments.results import Results, Row, write_results

# Mean ± σ of the position error in % of the width, mean rotation error in degrees: Acosta, Yang and
# Posa, RA-L 2022, on tosses of this cube with parameters of their own.
PUBLISHED = (
    ("Drake, published", "13.5 ± 8.2", "16.5"),
    ("Bullet, published", "14.9", "16.5"),
    ("MuJoCo, published", "25.1", "21.7"),
)


def toss_table(evaluation: TossEvaluation) -> str:
    """Return counts and fitted coefficients, then mean ± σ over tosses of each error."""
    rows = [_row(name, errors) for name, errors in _predictions(evaluation)]
    rows += [[name, "", position, "", rotation] for name, position, rotation in PUBLISHED]
    header = [
        "mean over a toss, mean ± σ over tosses",
        "position training (% of width)",
        "position test",
        "rotation training (°)",
        "rotation test",
    ]
    training, test = len(evaluation.training), len(evaluation.test)
    return (
        f"{training + test} tosses, {training} to fit to, {test} to test\n\n"
        f"{_mass_centre(evaluation.mass_centre)}{_coefficients(evaluation.fits)}\n\n"
        f"{format_table(header, rows)}"
    )


def write_toss_evaluations(folder: Path, title: str, evaluations: Sequence[TossEvaluation]) -> None:
    """Write `errors.csv`, and `README.md` with the tables and the command of this process."""
    rows = [
        _record(evaluation, name, errors)
        for evaluation in evaluations
        for name, errors in _predictions(evaluation)
    ]
    tables = "\n\n".join(toss_table(evaluation) for evaluation in evaluations)
    write_results(folder, Results(title, f"```\n{tables}\n```", {"errors.csv": rows}))


def _predictions(
    evaluation: TossEvaluation,
) -> Iterator[tuple[str, tuple[TossErrors, TossErrors]]]:
    """Yield what predicted, with its errors in training and in the test."""
    for engine, fit in evaluation.fits.items():
        yield f"{engine}, fitted", fit.fitted
        yield f"{engine}, default parameters", fit.default
    yield "free flight to the first touch", evaluation.free_flight


def _record(evaluation: TossEvaluation, name: str, errors: tuple[TossErrors, TossErrors]) -> Row:
    """Return a row of the file: positions over the cube's width, rotations in rad."""
    record: Row = {
        "training": len(evaluation.training),
        "test": len(evaluation.test),
        "prediction": name,
    }
    for part, part_errors in zip(("training", "test"), errors, strict=True):
        for quantity in ("position", "rotation"):
            values = getattr(part_errors, quantity)
            record[f"{quantity}_{part}"] = float(values.mean())
            record[f"{quantity}_{part}_deviation"] = float(values.std())
    return record


def _mass_centre(fit: MassCentreFit | None) -> str:
    if fit is None:
        return ""
    values = ", ".join(
        f"{1e3 * value:.2f} ± {1e3 * sigma:.2f}"
        for value, sigma in zip(fit.mass_centre, fit.deviation, strict=True)
    )
    return f"centre of mass from {fit.flights} flights: ({values}) mm from the cube's centre\n\n"


def _coefficients(fits: dict[str, TossFit]) -> str:
    rows = []
    for engine, fit in fits.items():
        pair = fit.search.parameters.pair(CUBE_MATERIAL, TABLE_MATERIAL)
        rows.append(
            [
                engine,
                f"{pair['static_friction']:.4f}",
                f"{pair['restitution']:.4f}",
                f"{1e3 * fit.search.cost:.2f}",
                f"{fit.search.iterations}",
                f"{fit.search.seconds:.1f}",
            ]
        )
    return format_table(
        ["engine", "friction", "restitution", "cost (mm)", "iterations", "time (s)"], rows
    )


def _row(name: str, errors: tuple[TossErrors, TossErrors]) -> list[str]:
    training, test = errors
    return [
        name,
        _spread(100.0 * training.position),
        _spread(100.0 * test.position),
        _spread(np.degrees(training.rotation)),
        _spread(np.degrees(test.rotation)),
    ]


def _spread(values: NDArray[np.float64]) -> str:
    return f"{values.mean():.1f} ± {values.std():.1f}"
