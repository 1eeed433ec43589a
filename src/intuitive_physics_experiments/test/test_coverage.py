"""Regions hold what they claim where the spread is right, and not where it is not."""

from __future__ import annotations

import numpy as np
import pytest

from intuitive_physics_experiments.corner_room import corner_environment
from intuitive_physics_experiments.coverage import LEVELS, coverage
from intuitive_physics_experiments.prediction_case import PredictionCase

POINTS, SAMPLES = 2000, 200


def case(claimed: float, true: float, rng: np.random.Generator) -> PredictionCase:
    """Samples of the deviation `claimed` m about points of the deviation `true` m."""
    return PredictionCase(
        "case",
        corner_environment(),
        0.05,
        np.arange(POINTS) / 30.0,
        rng.normal(0.0, claimed, (SAMPLES, POINTS, 3)),
        rng.normal(0.0, true, (POINTS, 3)),
    )


def test_right_spread_holds_what_it_claims() -> None:
    # A share of 2000 points is known to 1.1 %; 200 samples know their covariance to some percent.
    shares = coverage([case(0.1, 0.1, np.random.default_rng(0))], 0.0, np.random.default_rng(1))
    assert shares == pytest.approx(LEVELS, abs=0.04)


def test_noise_of_the_points_is_no_fault_of_the_prediction() -> None:
    drawn = case(0.1, np.hypot(0.1, 0.05), np.random.default_rng(0))
    shares = coverage([drawn], 0.05, np.random.default_rng(1))
    assert shares == pytest.approx(LEVELS, abs=0.04)


def test_too_sure_and_too_cautious_show() -> None:
    rng = np.random.default_rng(0)
    sure = coverage([case(0.05, 0.1, rng)], 0.0, rng)
    cautious = coverage([case(0.2, 0.1, rng)], 0.0, rng)
    assert (sure < LEVELS - 0.02).all()
    assert (cautious > LEVELS + 0.02).all()


def test_what_nobody_doubts_has_a_region_too() -> None:
    certain = case(0.0, 0.0, np.random.default_rng(0))
    assert np.isfinite(coverage([certain], 0.0, np.random.default_rng(1))).all()
    assert certain.error == 0.0
    assert certain.spread == pytest.approx(np.zeros(POINTS))
