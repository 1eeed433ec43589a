"""Whether a track is an object: what shape, motion and company say."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from intuitive_physics_perception.detection.detections import DetectedSphere, Outline
from intuitive_physics_perception.detection.sphere_inspection import (
    EDGE_PART,
    PATCH_RINGS,
    SECTORS,
    bulge_of,
)
from intuitive_physics_perception.tracking.existence import (
    APART,
    MOST_OF_MOTION,
    evidence_of_company,
    evidence_of_shape,
    log_odds,
)

RADIUS = 0.05


def patches_of(curvature: float, noise: float, rng: np.random.Generator) -> np.ndarray:
    """Patches (n, 3) of a surface by that many radii more hollow at its edge than a sphere: for a
    flat one ½."""
    ring = np.arange(PATCH_RINGS * SECTORS) // SECTORS
    sine2 = (ring + 0.5) / PATCH_RINGS * EDGE_PART**2
    # Outside of the sphere along its normal.
    errors = curvature * sine2 * RADIUS * np.sqrt(1.0 - sine2)
    errors = errors + rng.normal(0.0, noise, len(ring))
    return np.column_stack([np.ones(len(ring)), errors, np.full(len(ring), noise**2)])


def seen(
    place: Sequence[float] = (0.0, 0.0, 1.0),
    curvature: float = 0.0,
    noise: float = 0.001,
    seed: int = 0,
) -> DetectedSphere:
    """A new sphere that stands apart, with the errors of one frame."""
    rng = np.random.default_rng(seed)
    patches = patches_of(curvature, noise, rng)
    bulge = bulge_of(patches, patches[:, 2], RADIUS)
    outline = Outline(1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, bulge)
    return DetectedSphere(
        np.array(place, dtype=float), RADIUS, 1e-6 * np.eye(4), 300, 1.0, outline=outline
    )


@given(curvature=st.floats(-1.0, 1.0))
def test_a_bulge_is_what_a_surface_was_made_with(curvature: float) -> None:
    patches = patches_of(curvature, 1e-6, np.random.default_rng(0))
    bulge = bulge_of(patches, patches[:, 2], RADIUS)
    assert bulge.coefficients == pytest.approx([curvature, 0.0, 0.0], abs=1e-3)


def test_the_shape_says_nothing_for_a_ball_that_noise_hides() -> None:
    clear, hidden = (evidence_of_shape([seen(noise=noise)] * 20) for noise in (0.001, 100.0))
    # Bayes: as many are balls as are other round things, a twentieth of what is no ball.
    assert hidden == pytest.approx(-np.log(20.0), abs=0.1)
    assert -1.0 < clear <= 0.0
    assert log_odds([seen()]) > 0.0 > log_odds([seen(noise=100.0)])


def test_what_is_flat_is_no_ball() -> None:
    assert log_odds([seen(curvature=0.5)]) < 0.0


def test_many_looks_show_a_shape_that_one_does_not() -> None:
    ball, flat = (
        [seen(curvature=curvature, noise=0.02, seed=k) for k in range(200)]
        for curvature in (0.0, 0.5)
    )
    assert log_odds(ball) > 0.0 > log_odds(ball[:1])
    assert log_odds(flat) < log_odds(flat[:1])


@given(way=st.floats(-1.0, 1.0), at=st.integers(1, 5))
def test_one_jump_is_no_motion(way: float, at: int) -> None:
    places = [(0.0 if k < at else way, 0.0, 1.0) for k in range(6)]
    assert log_odds([seen(place) for place in places]) == pytest.approx(log_odds([seen()] * 6))


def test_what_moves_on_is_an_object_though_its_outline_is_none() -> None:
    places = [(0.06 * k, 0.0, 1.0) for k in range(6)]
    still, moving = log_odds([seen()] * 6), log_odds([seen(place) for place in places])
    assert moving == pytest.approx(still + MOST_OF_MOTION)


@given(balls=st.integers(0, 20), others=st.integers(0, 100))
def test_the_more_other_things_are_new_the_less_likely_is_each_a_ball(
    balls: int, others: int
) -> None:
    prior = evidence_of_company(balls, others)
    assert prior >= evidence_of_company(balls, others + 1)
    assert prior <= evidence_of_company(balls + 1, others) <= 0.0
    assert evidence_of_company(balls, balls) == 0.0


def test_what_fits_a_sphere_among_much_that_is_new_is_followed_when_it_moves() -> None:
    prior = evidence_of_company(1, 40)
    assert prior + APART < 0.0 < prior + APART + MOST_OF_MOTION
