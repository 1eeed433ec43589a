"""Outcomes that are predicted: each has its own random numbers, and errors of what is seen."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.scene import Environment, Plane, Scene, SceneObject
from intuitive_physics.shapes import Sphere
from intuitive_physics.state import ObjectState
from intuitive_physics_predictor.scores.outcomes import Outcome, outcome_generators

SEEDS = st.integers(0, 2**63)
NUMBERS = st.integers(0, 2**31 - 1)


def beginning(generator):
    """Return the first numbers of a stream: 256 bits."""
    return tuple(generator.integers(0, 2**63, 4).tolist())


@given(seed=SEEDS, number=NUMBERS)
@settings(max_examples=50)
def test_no_stream_is_that_of_a_seed_alone_or_of_a_list_of_numbers(seed, number):
    streams = {beginning(stream) for stream in outcome_generators(seed, number)}
    others = [seed, number, [seed, number], [seed, number, 0], [seed, number, 1], [number, seed]]
    assert len(streams) == 2
    assert not streams & {beginning(np.random.default_rng(other)) for other in others}


@given(seed=SEEDS, number=NUMBERS, other_seed=SEEDS, other_number=NUMBERS)
@settings(max_examples=50)
def test_streams_of_two_outcomes_differ(seed, number, other_seed, other_number):
    first = [beginning(stream) for stream in outcome_generators(seed, number)]
    other = [beginning(stream) for stream in outcome_generators(other_seed, other_number)]
    same = (seed, number) == (other_seed, other_number)
    assert (first == other) == same
    assert same or not set(first) & set(other)


def test_outcomes_of_the_first_seeds_share_no_stream():
    streams = [
        beginning(stream)
        for seed in range(20)
        for number in range(20)
        for stream in outcome_generators(seed, number)
    ]
    alone = [beginning(np.random.default_rng(seed)) for seed in range(20)]
    assert len({*streams, *alone}) == 2 * 20 * 20 + 20


SCENE = Scene(
    Environment([Plane("floor", "floor", (0, 0, 1), 0.0)]),
    (SceneObject("ball", "ball", Sphere(0.05)),),
    (ObjectState((0, 0, 1)),),
)


def test_errors_of_detections_have_the_covariance_of_their_point():
    rng = np.random.default_rng(0)
    roots = rng.standard_normal((1, 2, 3, 3))
    covariances = roots @ roots.swapaxes(-1, -2)
    outcome = Outcome(SCENE, np.array([0.1, 0.2]), np.zeros((1, 2, 3)), covariances)
    detected = outcome.detected(np.ones((20_000, 1, 2, 3)), rng)
    for time in range(2):
        sample_covariance = np.cov(detected[:, 0, time], rowvar=False)
        # An element is off by √((σ_ii σ_jj + σ_ij²) / n), 1 % of the largest variance.
        largest = np.diag(covariances[0, time]).max()
        np.testing.assert_allclose(sample_covariance, covariances[0, time], atol=0.05 * largest)
    np.testing.assert_allclose(np.mean(detected, axis=0), 1.0, atol=0.1)


def test_outcome_without_covariances_is_exact_and_wrong_shapes_are_refused():
    outcome = Outcome(SCENE, np.array([0.1]), np.zeros((1, 1, 3)))
    samples = np.ones((5, 1, 1, 3))
    assert outcome.detected(samples, np.random.default_rng(0)) is samples
    with pytest.raises(InvalidInputError, match="covariances have the shape"):
        Outcome(SCENE, np.array([0.1]), np.zeros((1, 1, 3)), np.eye(3))
