"""Regions hold what they claim where the spread is right, and not where it is not."""

from __future__ import annotations

import numpy as np
import pytest

from intuitive_physics_cli.evaluation.prediction_case import (
    LEVELS,
    PredictionCase,
    binomial_error,
    horizon_coverage,
    region_coverage,
)

from .bouncing_balls import CORNER

POINTS, SAMPLES, CASES = 30, 60, 40


def cases(
    claimed: float, true: float, rng: np.random.Generator, noise: float = 0.0
) -> list[PredictionCase]:
    """Samples of the deviation `claimed` m about points of the deviation `true` m.

    Parameters
    ----------
    noise : m, of what was observed, as it is stated
    """
    return [one_case(claimed, true, rng, noise) for _ in range(CASES)]


def one_case(
    claimed: float, true: float, rng: np.random.Generator, noise: float = 0.0
) -> PredictionCase:
    return PredictionCase(
        "case",
        CORNER,
        0.05,
        np.arange(POINTS) / 30.0,
        rng.normal(0.0, claimed, (SAMPLES, POINTS, 3)),
        rng.normal(0.0, true, (POINTS, 3)),
        np.broadcast_to(noise**2 * np.eye(3), (POINTS, 3, 3)),
    )


def test_right_spread_holds_what_it_claims() -> None:
    # The standard deviation of a share of 1200 points is 1.4 % at most.
    shares = region_coverage(cases(0.1, 0.1, np.random.default_rng(0)), np.random.default_rng(1))
    assert shares == pytest.approx(LEVELS, abs=0.05)


def test_noise_of_the_points_is_no_fault_of_the_prediction() -> None:
    drawn = cases(0.1, np.hypot(0.1, 0.05), np.random.default_rng(0), 0.05)
    shares = region_coverage(drawn, np.random.default_rng(1))
    assert shares == pytest.approx(LEVELS, abs=0.05)


def test_too_sure_and_too_cautious_show() -> None:
    rng = np.random.default_rng(0)
    sure = region_coverage(cases(0.05, 0.1, rng), rng)
    cautious = region_coverage(cases(0.2, 0.1, rng), rng)
    middle = (LEVELS > 0.2) & (LEVELS < 0.9)
    assert (sure < LEVELS - 0.1)[middle].all()
    assert (cautious > LEVELS + 0.05)[middle].all()


def test_what_nobody_doubts_has_a_region_too() -> None:
    certain = one_case(0.0, 0.0, np.random.default_rng(0))
    assert np.isfinite(region_coverage([certain], np.random.default_rng(1))).all()
    assert certain.error == 0.0
    assert certain.spread == pytest.approx(np.zeros(POINTS))


def test_single_points_are_judged_at_each_time_ahead() -> None:
    drawn = cases(0.1, 0.1, np.random.default_rng(2))
    found = horizon_coverage(drawn, (0.5, 0.9), np.random.default_rng(1))
    # They are seen for 0.97 s.
    assert [one.horizon for one in found] == [0.2, 0.5, 1.0]
    for one in found:
        assert one.count == CASES
        for share, claimed in zip(one.shares, (0.5, 0.9), strict=True):
            assert abs(share - claimed) < 4.0 * binomial_error(claimed, CASES)


def test_the_standard_error_is_that_of_a_share() -> None:
    shares = np.random.default_rng(0).binomial(CASES, 0.9, 100_000) / CASES
    assert shares.std() == pytest.approx(binomial_error(0.9, CASES), rel=0.02)
