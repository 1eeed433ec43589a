"""Calibration as a folder: tables, figures, a page, and the parameters with their noise scales."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics_cli.report.figure_style import (
    DEFAULT,
    GRAVITY,
    OBSERVED,
    PLANE_COLORS,
    PREDICTED,
    TRUE,
)
from intuitive_physics_experiments.calibration.calibrate import (
    BASELINES,
    FITTED,
    OURS,
    REGIONS,
    Calibration,
    Scores,
    ratios_of_means,
)
from intuitive_physics_experiments.results import (
    Figure,
    Results,
    Row,
    markdown_table,
    write_results,
    write_whole,
)
from intuitive_physics_predictor.noise_scales import NOISE_SCALES, SCALES_KEY

LEVELS = np.linspace(0.05, 0.95, 19)  # Probabilities of a reliability curve


def score_rows(calibration: Calibration) -> list[Row]:
    """Return a row for each way to predict at each horizon."""
    return [
        {"prediction": name, "horizon": float(horizon), **_row(scores, h)}
        for name, scores in calibration.scores.items()
        for h, horizon in enumerate(calibration.horizons)
    ]


def point_rows(by_points: dict[int, Scores], horizons: Any) -> list[Row]:
    """Return a row for each number of points that were seen, at each horizon."""
    return [
        {"points": points, "horizon": float(horizon), **_row(scores, h)}
        for points, scores in by_points.items()
        for h, horizon in enumerate(horizons)
    ]


def reliability_rows(calibration: Calibration) -> list[Row]:
    """Return how often regions of each probability held the outcome, by prediction and horizon."""
    return [
        {
            "prediction": name,
            "horizon": float(calibration.horizons[h]),
            "probability": round(float(level), 4),
            "covered": float(share),
        }
        for name, scores in calibration.scores.items()
        for level in LEVELS
        for h, share in enumerate(scores.coverage(level))
        if not np.isnan(share)
    ]


def _row(scores: Scores, h: int) -> Row:
    return {
        "trajectories": int((~np.isnan(scores.energy[:, h])).sum()),
        **{f"coverage_{100 * p:.0f}": float(scores.coverage(p)[h]) for p in REGIONS},
        "crps": float(np.nanmean(scores.crps[:, h])),
        "energy_score": float(np.nanmean(scores.energy[:, h])),
        "error": float(np.nanmean(scores.error[:, h])),
        "spread": float(np.nanmean(scores.spread[:, h])),
    }


# Colours of the horizons, in their order.
HORIZON_COLORS = (PREDICTED, OBSERVED, PLANE_COLORS[0], GRAVITY, PLANE_COLORS[3])

# Colours of the baselines, in their order.
BASELINE_COLORS = (DEFAULT, PLANE_COLORS[0], PLANE_COLORS[3], PLANE_COLORS[4])


def draw_reliability(axes: Any, calibration: Calibration) -> None:
    """Draw how often regions of each probability held what happened; true ones lie on the line."""
    axes.plot([0, 1], [0, 1], color=TRUE, lw=1.0, ls=":")
    scores = calibration.scores[OURS]
    covered = np.array([scores.coverage(level) for level in LEVELS])
    for h, horizon in enumerate(calibration.horizons):
        color = HORIZON_COLORS[h % len(HORIZON_COLORS)]
        axes.plot(LEVELS, covered[:, h], color=color, lw=1.6, label=f"{horizon:g} s")
    axes.set(xlabel="probability of the region", ylabel="share of outcomes inside")
    axes.set(xlim=(0, 1), ylim=(0, 1), aspect="equal")
    axes.grid()
    axes.legend(loc="upper left")


def draw_coverage(axes: Any, calibration: Calibration) -> None:
    """Draw coverage against horizon, with error bars for the number of outcomes."""
    scores = calibration.scores[OURS]
    for probability, color in zip(REGIONS, (OBSERVED, PREDICTED), strict=True):
        covered = scores.coverage(probability)
        count = (~np.isnan(scores.energy)).sum(axis=0)
        error = np.sqrt(np.maximum(covered * (1 - covered), 1e-12) / np.maximum(count, 1))
        axes.axhline(probability, color=color, lw=1.0, ls=":")
        axes.errorbar(
            calibration.horizons,
            covered,
            yerr=error,
            color=color,
            marker="o",
            ms=4,
            lw=1.6,
            label=f"{100 * probability:.0f} % region",
        )
    axes.axhspan(0.85, 0.95, color=PREDICTED, alpha=0.08, lw=0)
    axes.set(xlabel="horizon (s)", ylabel="share of outcomes inside", ylim=(0, 1.02))
    axes.grid(axis="y")
    axes.legend(loc="lower right")


def draw_scores(axes: Any, calibration: Calibration) -> None:
    """Draw energy scores against horizon, ours and the baselines'."""
    colors = iter(BASELINE_COLORS)
    for name, scores in calibration.scores.items():
        ours = name == OURS
        axes.plot(
            calibration.horizons,
            np.nanmean(scores.energy, axis=0),
            color=PREDICTED if ours else next(colors),
            marker="o",
            ms=4,
            lw=2.4 if ours else 1.3,
            label=name,
        )
    axes.set(xlabel="horizon (s)", ylabel="energy score (m)", yscale="log")
    axes.grid(axis="y", which="both")
    axes.legend(loc="lower right")


def draw_errors_by_points(axes: Any, by_points: dict[int, Scores], horizons: Any) -> None:
    """Draw the error of the mean prediction against how many points were seen."""
    points = list(by_points)
    errors = np.array([np.nanmean(scores.error, axis=0) for scores in by_points.values()])
    for h, horizon in enumerate(horizons):
        color = HORIZON_COLORS[h % len(HORIZON_COLORS)]
        axes.plot(points, errors[:, h], color=color, marker="o", ms=4, label=f"{horizon:g} s")
    axes.set(xlabel="points seen", ylabel="error of the mean (m)", yscale="log", xticks=points)
    axes.grid(axis="y", which="both")
    axes.legend(loc="upper right")


PARAMETERS_NAME = "parameters.json"  # File of the static parameters with their noise scales


def write_calibration(
    folder: Path,
    title: str,
    calibration: Calibration,
    learned: LearnedParameters,
    by_points: Mapping[int, Scores] | None = None,
    more: Sequence[str] = (),
) -> None:
    """Write tables, figure, parameters and page, with scores by points and more paragraphs."""
    points = dict(by_points or {})
    tables = {
        "scores.csv": score_rows(calibration),
        "reliability.csv": reliability_rows(calibration),
    }
    body = [_table(tables["scores.csv"]), _noise_scales(calibration)]
    if points:
        tables["points.csv"] = point_rows(points, calibration.horizons)
        body.append(_points_table(points, calibration))
    figure = Figure((11.0, 8.0), partial(_draw, calibration=calibration, by_points=points))
    page = "\n\n".join([*body, *more, "![](calibration.png)"])
    write_results(folder, Results(title, page, tables, {"calibration.png": figure}))
    parameters = {**learned.to_dict(), SCALES_KEY: calibration.scales.to_dict()}
    write_whole(folder / PARAMETERS_NAME, json.dumps(parameters, indent=1) + "\n")


def _draw(figure: Any, calibration: Calibration, by_points: dict[int, Scores]) -> None:
    axes = figure.subplots(2, 2)
    draw_reliability(axes[0, 0], calibration)
    draw_coverage(axes[0, 1], calibration)
    draw_scores(axes[1, 0], calibration)
    if by_points:
        draw_errors_by_points(axes[1, 1], by_points, calibration.horizons)
    else:
        axes[1, 1].set_axis_off()


def _table(rows: Sequence[Row]) -> str:
    header = ["prediction", "horizon (s)", "trajectories", "50 %", "90 %"]
    header += ["CRPS (m)", "energy (m)", "error (m)"]
    cells = [
        [
            str(row["prediction"]),
            f"{row['horizon']:g}",
            str(row["trajectories"]),
            *(_share(row[f"coverage_{level}"], row["trajectories"]) for level in (50, 90)),
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


def _noise_scales(calibration: Calibration) -> str:
    fits, deviations = calibration.fits, calibration.fixed_deviations
    listed = ", ".join(
        _median_and_range(name, [getattr(fit.scales, name) for fit in fits])
        for name in NOISE_SCALES
    )
    kept = ", ".join(
        f"{100 * np.median([fit.kept[name] for fit in fits]):.0f} % of {name}"
        for name in fits[0].kept
    )
    over_splits = "" if len(fits) == 1 else f", medians of {len(fits)} splits (and range)"
    ratios, errors = ratios_of_means(
        calibration.scores[OURS].energy, calibration.scores[FITTED].energy
    )
    fitted = [f"{ratio:.3f} ± {error:.3f}" for ratio, error in zip(ratios, errors, strict=True)]
    best, ideal = (
        [f"{ratio:.3f}" for ratio in ratios_by_horizon]
        for ratios_by_horizon in (
            calibration.energy_score_vs_best_baseline,
            calibration.ideal_energy_score_vs_fitted_noise,
        )
    )
    return (
        f"50 %, 90 %: share of outcomes inside the highest-density region of that probability, ± "
        f"its standard error with so many trajectories. Noise scales{over_splits}: {listed}; of "
        f"the way that the fit would have moved them, {kept} are kept, the rest may be chance. "
        f"{_median_and_range('Fixed noise that suits the past best:', deviations)}. Energy score "
        f"over that of the best of {', '.join(BASELINES)}: {_by_horizon(best, calibration)}; over "
        f"that of the fitted fixed noise: {_by_horizon(fitted, calibration)}. If what happened "
        f"were drawn from {OURS} itself, so that with what is known nothing could score better, "
        f"that ratio would be {_by_horizon(ideal, calibration)}."
    )


def _median_and_range(name: str, values: Sequence[float]) -> str:
    median, low, high = float(np.median(values)), min(values), max(values)
    shown = f"{name} {median:.3g}"
    return shown if low == high else f"{shown} ({low:.3g} to {high:.3g})"


def _by_horizon(texts: Sequence[str], calibration: Calibration) -> str:
    return ", ".join(
        f"{text} at {horizon:g} s"
        for text, horizon in zip(texts, calibration.horizons, strict=True)
    )


def _share(value: float, count: int = 0) -> str:
    """Text of a share, with its standard error where it is of `count` trajectories."""
    if np.isnan(value):
        return "–"
    if not count:
        return f"{100 * value:.1f} %"
    return f"{100 * value:.1f} ± {100 * np.sqrt(value * (1.0 - value) / count):.1f} %"
