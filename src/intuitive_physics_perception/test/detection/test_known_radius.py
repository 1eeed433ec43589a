"""Bayes' rule for a known radius, and no mistake where it is another ball."""

from __future__ import annotations

import numpy as np
import pytest

from intuitive_physics_perception.detection.settings import SphereDetectionSettings
from intuitive_physics_perception.detection.spheres import RADIUS_DEVIATION, with_known_radius

SETTINGS = SphereDetectionSettings()
TOLERANCE = 0.006
SPHERE = np.array([0.1, 0.2, 1.5, 0.052])
DEVIATIONS = np.array([0.001, 0.001, 0.004, 0.003])
TOGETHER = np.eye(4)
TOGETHER[2, 3] = TOGETHER[3, 2] = 0.9
COVARIANCE = TOGETHER * np.outer(DEVIATIONS, DEVIATIONS)


def test_the_centre_moves_with_the_radius_as_both_go_together() -> None:
    known, narrowed = with_known_radius(SPHERE, COVARIANCE, [0.05], TOLERANCE, SETTINGS)
    assert known[3] == pytest.approx(0.05, abs=1e-5)
    # E[z | r] = z + C_zr / C_rr (r̄ - r)
    assert known[2] == pytest.approx(1.5 - 0.9 * 4.0 / 3.0 * 0.002, rel=1e-3)
    # Var[z | r] = (1 - ρ²) Var[z]
    assert narrowed[2, 2] == pytest.approx((1 - 0.81) * 0.004**2, rel=0.01)
    assert np.sqrt(narrowed[3, 3]) <= RADIUS_DEVIATION
    assert np.linalg.eigvalsh(narrowed)[0] > 0.0
    # The posterior is what the least squares with one more equation gives.
    information = np.linalg.inv(COVARIANCE)
    information[3, 3] += 1.0 / RADIUS_DEVIATION**2
    assert narrowed == pytest.approx(np.linalg.inv(information), rel=1e-6)


@pytest.mark.parametrize("radii", [[], [0.08], [0.051, 0.054]])
def test_nothing_is_assumed_without_a_clear_match(radii) -> None:
    known, covariance = with_known_radius(SPHERE, COVARIANCE, radii, TOLERANCE, SETTINGS)
    assert known is SPHERE
    assert covariance is COVARIANCE


def test_the_clearly_nearer_of_two_is_taken() -> None:
    known, _ = with_known_radius(SPHERE, COVARIANCE, [0.07, 0.05, 0.03], TOLERANCE, SETTINGS)
    assert known[3] == pytest.approx(0.05, abs=1e-5)
