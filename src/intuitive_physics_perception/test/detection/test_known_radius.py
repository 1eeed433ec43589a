"""Bayes' rule for a known radius, and no mistake where it is another ball."""

from __future__ import annotations

import numpy as np
import pytest

from intuitive_physics_perception.detection.fitted_sphere import RADIUS_DEVIATION, SphereFit

TOLERANCE = 0.006
SPHERE = np.array([0.1, 0.2, 1.5, 0.052])
DEVIATIONS = np.array([0.001, 0.001, 0.004, 0.003])
TOGETHER = np.eye(4)
TOGETHER[2, 3] = TOGETHER[3, 2] = 0.9
COVARIANCE = TOGETHER * np.outer(DEVIATIONS, DEVIATIONS)


SHIFT = np.array([0.0002, 0.0, 0.003, 0.002])
SYSTEMATIC = np.outer(SHIFT, SHIFT)
FIT = SphereFit(SPHERE, COVARIANCE + SYSTEMATIC, SYSTEMATIC)


def test_the_centre_moves_with_the_radius_as_both_go_together() -> None:
    fit = SphereFit(SPHERE, COVARIANCE, np.zeros((4, 4))).with_known_radius([0.05], TOLERANCE)
    assert fit.sphere[3] == pytest.approx(0.05, abs=1e-5)
    # E[z | r] = z + C_zr / C_rr (r̄ - r)
    assert fit.sphere[2] == pytest.approx(1.5 - 0.9 * 4.0 / 3.0 * 0.002, rel=1e-3)
    narrowed = fit.covariance
    # Var[z | r] = (1 - ρ²) Var[z]
    assert narrowed[2, 2] == pytest.approx((1 - 0.81) * 0.004**2, rel=0.01)
    assert np.sqrt(narrowed[3, 3]) <= RADIUS_DEVIATION
    assert np.linalg.eigvalsh(narrowed)[0] > 0.0
    # The posterior is what the least squares with one more equation gives.
    information = np.linalg.inv(COVARIANCE)
    information[3, 3] += 1.0 / RADIUS_DEVIATION**2
    assert narrowed == pytest.approx(np.linalg.inv(information), rel=1e-6)


def test_what_all_frames_share_shrinks_as_its_part_of_the_whole_does() -> None:
    fit = FIT.with_known_radius([0.05], TOLERANCE)
    # With g = P_cr / P_rr the error s of the fit becomes s - g s_r, and so does the whole one's.
    gain = FIT.covariance[:, 3] / (FIT.covariance[3, 3] + RADIUS_DEVIATION**2)
    left = SHIFT - gain * SHIFT[3]
    assert fit.systematic == pytest.approx(np.outer(left, left), abs=1e-15)
    assert fit.systematic[2, 2] < 0.2 * SYSTEMATIC[2, 2]
    frame_part = fit.covariance - fit.systematic
    assert np.linalg.eigvalsh(frame_part)[0] > 0.0


@pytest.mark.parametrize("radii", [[], [0.08], [0.051, 0.0545]])
def test_nothing_is_assumed_without_a_clear_match(radii) -> None:
    assert FIT.with_known_radius(radii, TOLERANCE) is FIT


def test_the_clearly_nearer_of_two_is_taken() -> None:
    fit = FIT.with_known_radius([0.075, 0.05, 0.025], TOLERANCE)
    assert fit.sphere[3] == pytest.approx(0.05, abs=1e-5)
