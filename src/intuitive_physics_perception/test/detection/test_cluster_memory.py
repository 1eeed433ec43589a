"""What is known of clusters from frame to frame."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from intuitive_physics_perception.detection.cluster_memory import ClusterMemory
from intuitive_physics_perception.detection.settings import ClusterSettings

SETTINGS = ClusterSettings()

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
    count = searched_in(ClusterMemory(STILLNESS, SETTINGS), periods * SETTINGS.search_period)
    assert SETTINGS.first_searches <= count <= SETTINGS.first_searches + periods


@given(gap=st.integers(0, 2 * SETTINGS.frames_remembered))
def test_what_was_away_for_a_short_time_is_known_again(gap: int) -> None:
    memory: ClusterMemory[str] = ClusterMemory(STILLNESS, SETTINGS)
    searched_in(memory, SETTINGS.first_searches)
    for _ in range(gap):
        memory.end_frame()
    known = memory.recall(CLUSTER)
    assert known.deserves_a_search == (gap > SETTINGS.frames_remembered)
    assert known.found == (None if gap > SETTINGS.frames_remembered else "box")


@given(waits=st.integers(0, 40))
def test_waiting_takes_no_search_away(waits: int) -> None:
    memory: ClusterMemory[str] = ClusterMemory(STILLNESS, SETTINGS)
    for _ in range(waits):
        known = memory.recall(CLUSTER)
        assert known.deserves_a_search
        memory.postpone(known)
        memory.end_frame()
    assert searched_in(memory, SETTINGS.first_searches) == SETTINGS.first_searches


def test_what_moved_or_grew_is_new() -> None:
    for other in (CLUSTER + 2.0 * STILLNESS, np.concatenate([CLUSTER, CLUSTER])):
        memory: ClusterMemory[str] = ClusterMemory(STILLNESS, SETTINGS)
        searched_in(memory, 2 * SETTINGS.first_searches)
        assert memory.recall(other).found is None
