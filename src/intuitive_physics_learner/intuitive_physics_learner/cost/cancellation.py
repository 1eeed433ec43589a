"""Work in batches, between which it can be cancelled."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from intuitive_physics.materials import StaticParameters
from intuitive_physics_learner.errors import LearningCancelledError

LARGEST_BATCH = 50
"""Candidates evaluated at once at most; between batches a search can be stopped."""


def batches(
    candidates: list[StaticParameters], cancelled: Callable[[], bool] | None
) -> Iterator[list[StaticParameters]]:
    """Yield candidates in batches of up to `LARGEST_BATCH`."""
    for first in range(0, len(candidates), LARGEST_BATCH):
        stop_if(cancelled)
        yield candidates[first : first + LARGEST_BATCH]


def stop_if(cancelled: Callable[[], bool] | None) -> None:
    """Raise LearningCancelledError when `cancelled` returns True."""
    if cancelled is not None and cancelled():
        raise LearningCancelledError
