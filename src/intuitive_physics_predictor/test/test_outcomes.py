"""Random numbers of outcomes that are predicted: each has its own."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from intuitive_physics_predictor.scores.outcomes import outcome_generators

SEEDS = st.integers(0, 2**63)
NUMBERS = st.integers(0, 2**31 - 1)


def beginning(generator):
    """Return the first numbers of a stream: 256 bits."""
    return tuple(generator.integers(0, 2**63, 4).tolist())


@given(seed=SEEDS, number=NUMBERS)
@settings(max_examples=50)
def test_no_stream_is_that_of_a_seed_alone_or_of_a_list_of_numbers(seed, number):
    streams = {beginning(one) for one in outcome_generators(seed, number)}
    others = [seed, number, [seed, number], [seed, number, 0], [seed, number, 1], [number, seed]]
    assert len(streams) == 2
    assert not streams & {beginning(np.random.default_rng(other)) for other in others}


@given(seed=SEEDS, number=NUMBERS, other_seed=SEEDS, other_number=NUMBERS)
@settings(max_examples=50)
def test_streams_of_two_outcomes_differ(seed, number, other_seed, other_number):
    one = [beginning(stream) for stream in outcome_generators(seed, number)]
    other = [beginning(stream) for stream in outcome_generators(other_seed, other_number)]
    same = (seed, number) == (other_seed, other_number)
    assert (one == other) == same
    assert same or not set(one) & set(other)


def test_outcomes_of_the_first_seeds_share_no_stream():
    streams = [
        beginning(stream)
        for seed in range(20)
        for number in range(20)
        for stream in outcome_generators(seed, number)
    ]
    alone = [beginning(np.random.default_rng(seed)) for seed in range(20)]
    assert len({*streams, *alone}) == 2 * 20 * 20 + 20
