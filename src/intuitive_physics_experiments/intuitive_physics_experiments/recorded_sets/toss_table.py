"""Errors of simulated tosses as a table, beside those that others have published."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_cli.terminal import format_table
from intuitive_physics_experiments.recorded_sets.cube_tosses import CUBE_MATERIAL, TABLE_MATERIAL
from intuitive_physics_experiments.recorded_sets.toss_errors import TossErrors
from intuitive_physics_experiments.recorded_sets.toss_evaluation import TossEvaluation, TossFit
from intuitive_physics_experiments.recorded_sets.toss_mass_centre import MassCentreFit

PUBLISHED = (
    ("Drake, published", "13.5 ± 8.2", "16.5"),
    ("Bullet, published", "14.9", "16.5"),
    ("MuJoCo, published", "25.1", "21.7"),
)
"""Mean ± σ of the position error in % of the width, mean rotation error in degrees: Acosta, Yang
and Posa, RA-L 2022, on tosses of this cube with parameters of their own."""


def toss_table(evaluation: TossEvaluation) -> str:
    """Return fitted coefficients, then mean ± σ over tosses of each error, a row for each way."""
    rows = []
    for engine, fit in evaluation.fits.items():
        rows.append(_row(f"{engine}, fitted", fit.fitted))
        rows.append(_row(f"{engine}, default parameters", fit.default))
    rows.append(_row("free flight to the first touch", evaluation.free_flight))
    rows += [[name, "", position, "", rotation] for name, position, rotation in PUBLISHED]
    header = [
        "mean over a toss, mean ± σ over tosses",
        "position training (% of width)",
        "position test",
        "rotation training (°)",
        "rotation test",
    ]
    return (
        f"{_mass_centre(evaluation.mass_centre)}{_coefficients(evaluation.fits)}\n\n"
        f"{format_table(header, rows)}"
    )


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
