"""Calibration as rows for CSV files and for people."""

from __future__ import annotations

from typing import Any

import numpy as np

from intuitive_physics_experiments.calibration.calibrate import Calibration
from intuitive_physics_experiments.calibration.verification import REGIONS, Scores

LEVELS = np.linspace(0.05, 0.95, 19)
"""Probabilities of a reliability curve."""


def score_rows(calibration: Calibration) -> list[dict[str, Any]]:
    """Return a row for each way to predict at each horizon."""
    return [
        {"prediction": name, "horizon": float(horizon), **_row(scores, h)}
        for name, scores in calibration.scores.items()
        for h, horizon in enumerate(calibration.horizons)
    ]


def point_rows(by_points: dict[int, Scores], horizons: Any) -> list[dict[str, Any]]:
    """Return a row for each number of points that were seen, at each horizon."""
    return [
        {"points": points, "horizon": float(horizon), **_row(scores, h)}
        for points, scores in by_points.items()
        for h, horizon in enumerate(horizons)
    ]


def reliability_rows(calibration: Calibration) -> list[dict[str, Any]]:
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


def _row(scores: Scores, h: int) -> dict[str, Any]:
    return {
        "trajectories": int((~np.isnan(scores.energy[:, h])).sum()),
        **{f"coverage_{100 * p:.0f}": float(scores.coverage(p)[h]) for p in REGIONS},
        "crps": float(np.nanmean(scores.crps[:, h])),
        "energy_score": float(np.nanmean(scores.energy[:, h])),
        "error": float(np.nanmean(scores.error[:, h])),
        "spread": float(np.nanmean(scores.spread[:, h])),
    }
