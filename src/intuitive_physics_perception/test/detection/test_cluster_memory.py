"""What is known of clusters from frame to frame."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from intuitive_physics_perception.detection.cluster_memory import (
    FIRST_SEARCHES,
    FRAMES_REMEMBERED,
    MOVEMENT,
    SEARCH_PERIOD,
    ClusterMemory,
    RememberedCluster,
)
from intuitive_physics_perception.environment.noise import RangeNoise

NOISE = RangeNoise(0.0, 0.0, 0.0, 0.0)
RADIUS = 0.05
CLUSTER = np.random.default_rng(0).normal(size=(200, 3))


def recalled(memory: ClusterMemory, points: np.ndarray = CLUSTER) -> RememberedCluster:
    """What is known of one cluster."""
    (cluster,) = memory.recall(points.mean(axis=0, keepdims=True), np.array([len(points)]))
    return cluster


def searched_in(memory: ClusterMemory, frames: int) -> int:
    """In how many of some frames a cluster that is always there is searched."""
    count = 0
    for _ in range(frames):
        cluster = recalled(memory)
        count += cluster.deserves_a_search
        memory.keep(cluster, "box")
        memory.end_frame()
    return count


@given(periods=st.integers(1, 5))
def test_what_stays_is_searched_at_first_and_once_in_a_period(periods: int) -> None:
    count = searched_in(ClusterMemory(RADIUS, NOISE), periods * SEARCH_PERIOD)
    assert FIRST_SEARCHES <= count <= FIRST_SEARCHES + periods


@given(gap=st.integers(0, 2 * FRAMES_REMEMBERED))
def test_what_was_away_for_a_short_time_is_known_again(gap: int) -> None:
    memory = ClusterMemory(RADIUS, NOISE)
    searched_in(memory, FIRST_SEARCHES)
    for _ in range(gap):
        memory.end_frame()
    cluster = recalled(memory)
    assert cluster.deserves_a_search == (gap > FRAMES_REMEMBERED)
    assert cluster.result == (None if gap > FRAMES_REMEMBERED else "box")


@given(waits=st.integers(0, 40))
def test_waiting_takes_no_search_away(waits: int) -> None:
    memory = ClusterMemory(RADIUS, NOISE)
    for _ in range(waits):
        cluster = recalled(memory)
        assert cluster.deserves_a_search
        memory.postpone(cluster)
        memory.end_frame()
    assert searched_in(memory, FIRST_SEARCHES) == FIRST_SEARCHES


def test_what_moved_or_grew_is_new() -> None:
    for other in (CLUSTER + 2.0 * MOVEMENT * RADIUS, np.concatenate([CLUSTER, CLUSTER])):
        memory = ClusterMemory(RADIUS, NOISE)
        searched_in(memory, 2 * FIRST_SEARCHES)
        assert recalled(memory, other).result is None


def test_noise_makes_no_new_cluster_of_what_is_far() -> None:
    # 200 readings that share errors of 0.03 m in groups of 8: their mean is sure to 6 mm.
    rng = np.random.default_rng(1)
    noise = RangeNoise(0.03, 0.0, 1.0, 0.0, correlated=8.0)
    memory = ClusterMemory(0.005, noise)
    new_clusters = 0
    for _ in range(200):
        errors = np.repeat(rng.normal(0.0, 0.03, size=25), 8)
        cluster = recalled(memory, CLUSTER + [0.0, 0.0, 3.0] + errors[:, None] * [0.0, 0.0, 1.0])
        new_clusters += cluster.frames == 0
        memory.keep(cluster, "box")
        memory.end_frame()
    # The first, and 0.3 % of the others by a normal distribution.
    assert new_clusters <= 4


@given(order=st.permutations([0, 1, 2, 3]))
def test_what_waits_is_counted_until_it_is_searched(order: list[int]) -> None:
    memory = ClusterMemory(RADIUS, NOISE)
    for waits in order:
        for k in range(waits):
            cluster = recalled(memory)
            assert cluster.waited == k
            memory.postpone(cluster)
            memory.end_frame()
        memory.keep(recalled(memory))
        memory.end_frame()
