"""What is known of clusters from frame to frame."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from intuitive_physics_perception.detection.cluster_memory import (
    KEPT_UNSEEN,
    PERIOD,
    SEARCHES,
    ClusterMemory,
)

STILLNESS = 0.01
CLUSTER = np.random.default_rng(0).normal(size=(200, 3))


def searched_in(memory: ClusterMemory[str], frames: int) -> int:
    """In how many of some frames a cluster that is always there is searched."""
    count = 0
    for _ in range(frames):
        known = memory.recall(CLUSTER)
        count += known.deserves_a_search
        memory.keep(known, "box")
        memory.end_frame()
    return count


@given(periods=st.integers(1, 5))
def test_what_stays_is_searched_at_first_and_once_in_a_period(periods: int) -> None:
    count = searched_in(ClusterMemory(STILLNESS), periods * PERIOD)
    assert SEARCHES <= count <= SEARCHES + periods


@given(gap=st.integers(0, 2 * KEPT_UNSEEN))
def test_what_was_away_for_a_short_time_is_known_again(gap: int) -> None:
    memory: ClusterMemory[str] = ClusterMemory(STILLNESS)
    searched_in(memory, SEARCHES)
    for _ in range(gap):
        memory.end_frame()
    known = memory.recall(CLUSTER)
    assert known.deserves_a_search == (gap > KEPT_UNSEEN)
    assert known.found == (None if gap > KEPT_UNSEEN else "box")


@given(waits=st.integers(0, 40))
def test_waiting_takes_no_search_away(waits: int) -> None:
    memory: ClusterMemory[str] = ClusterMemory(STILLNESS)
    for _ in range(waits):
        known = memory.recall(CLUSTER)
        assert known.deserves_a_search
        memory.postpone(known)
        memory.end_frame()
    assert searched_in(memory, SEARCHES) == SEARCHES


def test_what_moved_or_grew_is_new() -> None:
    for other in (CLUSTER + 2.0 * STILLNESS, np.concatenate([CLUSTER, CLUSTER])):
        memory: ClusterMemory[str] = ClusterMemory(STILLNESS)
        searched_in(memory, 2 * SEARCHES)
        assert memory.recall(other).found is None
