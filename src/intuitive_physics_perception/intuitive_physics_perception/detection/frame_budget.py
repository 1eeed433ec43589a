"""Time that one frame has for hypotheses of objects."""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from time import perf_counter

LEAST_LEFT = 0.4
"""Part of the budget that hypotheses have whatever was spent before: on a slow machine new objects
are still found."""


class FrameBudget:
    """Time of a frame for hypotheses of all kinds: what it does not reach waits for the next frame.

    What is followed is looked for where it is expected in any case.

    Parameters
    ----------
    seconds : that it has; infinite: it has no end
    clock : s, at which it begins now
    spent : s of it that were spent before

    Attributes
    ----------
    waiting : clusters that have not been looked at
    """

    def __init__(
        self,
        seconds: float = inf,
        clock: Callable[[], float] = perf_counter,
        spent: float = 0.0,
    ) -> None:
        self._clock = clock
        self._end = clock() + max(seconds - spent, LEAST_LEFT * seconds)
        self._was_spent = False
        self.waiting = 0

    @property
    def is_spent(self) -> bool:
        """Whether its time is over."""
        # Where threads are timed, a look at the clock takes as long as a cluster that waits.
        self._was_spent = self._was_spent or self._clock() >= self._end
        return self._was_spent
