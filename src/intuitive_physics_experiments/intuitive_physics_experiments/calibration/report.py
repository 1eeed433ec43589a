"""What a calibration leaves in its folder: tables, figures, a page, θ_s with its noise scales."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics_experiments.calibration.calibrate import BASELINES, Calibration
from intuitive_physics_experiments.calibration.figures import (
    draw_coverage,
    draw_errors_by_points,
    draw_reliability,
    draw_scores,
)
from intuitive_physics_experiments.calibration.tables import (
    point_rows,
    reliability_rows,
    score_rows,
)
from intuitive_physics_experiments.calibration.verification import Scores
from intuitive_physics_experiments.paper.cells import write_whole
from intuitive_physics_experiments.paper.outcome import (
    markdown_table,
    write_csv,
    write_figure,
    write_page,
)
from intuitive_physics_predictor.noise_scales import SCALES_KEY

PARAMETERS_NAME = "parameters.json"


def write_calibration(
    folder: Path,
    title: str,
    command: str,
    calibration: Calibration,
    learned: LearnedParameters,
    by_points: Mapping[int, Scores] | None = None,
    more: Sequence[str] = (),
) -> None:
    """Write everything a calibration found.

    Parameters
    ----------
    by_points : scores by how many points were seen, where that was varied
    more : paragraphs to add to the page
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InvalidInputError(f"cannot make the folder {folder}: {error.strerror}") from None
    rows = score_rows(calibration)
    write_csv(folder / "scores.csv", rows)
    write_csv(folder / "reliability.csv", reliability_rows(calibration))
    points = dict(by_points or {})
    if points:
        write_csv(folder / "points.csv", point_rows(points, calibration.horizons))
    write_figure(
        folder / "calibration.png",
        (11.0, 8.0),
        lambda figure: _draw(figure, calibration, points),
    )
    scales = calibration.fit.scales.to_dict()
    parameters = {**learned.to_dict(), SCALES_KEY: scales}
    write_whole(folder / PARAMETERS_NAME, json.dumps(parameters, indent=1) + "\n")
    body = [_table(rows), _told(calibration)]
    if points:
        body.append(_points_table(points, calibration))
    write_page(folder, title, command, "\n\n".join([*body, *more, "![](calibration.png)"]))


def _draw(figure: Any, calibration: Calibration, by_points: dict[int, Scores]) -> None:
    axes = figure.subplots(2, 2)
    draw_reliability(axes[0, 0], calibration)
    draw_coverage(axes[0, 1], calibration)
    draw_scores(axes[1, 0], calibration)
    if by_points:
        draw_errors_by_points(axes[1, 1], by_points, calibration.horizons)
    else:
        axes[1, 1].set_axis_off()


def _table(rows: Sequence[Mapping[str, Any]]) -> str:
    header = ["prediction", "horizon (s)", "50 %", "90 %", "CRPS (m)", "energy (m)", "error (m)"]
    cells = [
        [
            str(row["prediction"]),
            f"{row['horizon']:g}",
            _share(row["coverage_50"]),
            _share(row["coverage_90"]),
            *(f"{row[name]:.4f}" for name in ("crps", "energy_score", "error")),
        ]
        for row in rows
    ]
    return markdown_table(header, cells)


def _points_table(by_points: Mapping[int, Scores], calibration: Calibration) -> str:
    header = ["points seen", *(f"error at {h:g} s (m)" for h in calibration.horizons)]
    header += [f"90 % at {h:g} s" for h in calibration.horizons]
    cells = [
        [
            str(points),
            *(f"{error:.4f}" for error in np.nanmean(scores.error, axis=0)),
            *(_share(share) for share in scores.coverage(0.9)),
        ]
        for points, scores in by_points.items()
    ]
    return (
        f"From fewer or more points, all at the same instants, s after point {max(by_points)}:\n\n"
        + markdown_table(header, cells)
    )


def _told(calibration: Calibration) -> str:
    scales = calibration.fit.scales.to_dict()
    del scales["format"]
    kept = ", ".join(
        f"{100 * share:.0f} % of {name}" for name, share in calibration.fit.kept.items()
    )
    told = ", ".join(f"{name} {value:.3g}" for name, value in scales.items())
    best, fitted = (
        ", ".join(
            f"{ratio:.3f} at {horizon:g} s"
            for ratio, horizon in zip(ratios, calibration.horizons, strict=True)
        )
        for ratios in (
            calibration.energy_score_vs_best_baseline,
            calibration.energy_score_vs_fitted_noise,
        )
    )
    return (
        f"50 %, 90 %: share of outcomes inside the highest-density region of that probability. "
        f"Noise scales: {told}; of the way that the fit would have moved them, {kept} "
        f"are kept, the rest may be chance. Fixed noise that suits the past best: "
        f"{calibration.fixed_deviation:.3g}. Energy score over that of the best of "
        f"{', '.join(BASELINES)}: {best}; over that of the fitted fixed noise: {fitted}."
    )


def _share(value: float) -> str:
    return "–" if np.isnan(value) else f"{100 * value:.1f} %"
