"""A distribution is shown as the paper's Fig. 1 has it: thin samples, the mean, ellipsoids."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from std_msgs.msg import Header
from visualization_msgs.msg import Marker

from intuitive_physics.geometry.rotations import rotation_matrix
from intuitive_physics_ros.markers import (
    ELLIPSOIDS,
    MAX_SAMPLES,
    distribution_markers,
)

HEADER = Header(frame_id="lab")


def shown(covariance=None, samples=20, objects=2, times=101):
    rng = np.random.default_rng(0)
    positions = rng.normal(size=(samples, objects, times, 3))
    given = np.eye(3) * 1e-4 if covariance is None else covariance
    covariances = np.broadcast_to(given, (objects, times, 3, 3))
    names = [f"ball_{k}" for k in range(objects)]
    message = distribution_markers(HEADER, names, positions, positions.mean(axis=0), covariances)
    return message.markers


def test_earlier_markers_are_cleared_first():
    clearing, *rest = shown()
    assert clearing.action == Marker.DELETEALL
    assert all(marker.action == Marker.ADD for marker in rest)
    assert all(marker.header == HEADER for marker in rest)


def test_each_object_has_thin_samples_a_mean_and_ellipsoids():
    markers = shown(objects=3)[1:]
    by_kind = {kind: [m for m in markers if m.ns == kind] for kind in {m.ns for m in markers}}
    assert {kind: len(found) for kind, found in by_kind.items()} == {
        "samples": 3,
        "mean": 3,
        "covariance": 3 * ELLIPSOIDS,
    }
    for sample, mean in zip(by_kind["samples"], by_kind["mean"], strict=True):
        assert 0 < sample.scale.x < mean.scale.x
        assert sample.color.a < mean.color.a
    for found in by_kind.values():
        assert len({marker.id for marker in found}) == len(found)


def test_covariance_that_is_not_finite_has_no_ellipsoid():
    covariance = np.broadcast_to(np.eye(3) * 1e-4, (2, 101, 3, 3)).copy()
    covariance[1, 60:] = np.nan
    ellipsoids = [marker for marker in shown(covariance) if marker.ns == "covariance"]
    # Of the second object's eight, evenly up to point 100, the first four are before point 60.
    assert len(ellipsoids) == ELLIPSOIDS + 4
    for marker in ellipsoids:
        assert np.isfinite([marker.scale.x, marker.scale.y, marker.scale.z]).all()


def test_many_samples_are_no_load_on_rviz():
    few, many = (
        sum(len(m.points) for m in shown(samples=n, objects=1, times=501)) for n in (20, 5000)
    )
    assert many <= 2 * few
    assert MAX_SAMPLES >= 20


@given(st.integers(0, 2**31))
def test_an_ellipsoid_reaches_two_deviations_along_its_axes(seed):
    root = np.random.default_rng(seed).normal(size=(3, 3)) * 0.1 + 0.05 * np.eye(3)
    covariance = root @ root.T
    marker = next(m for m in shown(covariance) if m.ns == "covariance")
    q = marker.pose.orientation
    axes = rotation_matrix((q.x, q.y, q.z, q.w))
    size = np.array([marker.scale.x, marker.scale.y, marker.scale.z])
    # Σ = R diag((size / 4)²) R', but for variances below 0.1 mm², which would be too thin to see.
    rebuilt = axes @ np.diag((size / 4) ** 2) @ axes.T
    np.testing.assert_allclose(rebuilt, covariance, atol=1e-7 + 1e-6 * covariance.max())
    assert np.linalg.det(axes) == pytest.approx(1.0)
