"""Errors of simulated tosses as a table, beside those that others have published."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_experiments.cube_tosses import CUBE_MATERIAL, TABLE_MATERIAL
from intuitive_physics_experiments.terminal import format_table
from intuitive_physics_experiments.toss_errors import TossErrors
from intuitive_physics_experiments.toss_evaluation import TossEvaluation, TossFit

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
    return f"{_coefficients(evaluation.fits)}\n\n{format_table(header, rows)}"


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
