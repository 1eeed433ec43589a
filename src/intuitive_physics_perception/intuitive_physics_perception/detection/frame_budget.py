"""Time that each frame has for hypotheses of objects."""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from time import perf_counter

LEAST_LEFT = 0.4
"""Part of the budget that hypotheses have whatever else a frame takes: on a slow machine new
objects are still found."""

LARGEST_STEP = 0.5
"""Part of the time left that is kept free at most for the step that is under way when it ends. Set
by hand."""

REMEMBERED = 0.9
"""Part of the longest step that is expected in the next frame. Set by hand."""

NEWEST = 0.1
"""Part that the newest frame has in the mean time of what follows on hypotheses. Set by hand."""


class FrameBudget:
    """Time of a frame, of which hypotheses of all kinds have what the rest of it leaves: what they
    do not reach waits for the next frame.

    What is followed is looked for where it is expected in any case. A step, such as a fit, is not
    interrupted. So hypotheses end earlier by as long as steps took lately, those of urgent things
    excepted, and by as long as what follows on them takes on average.

    Parameters
    ----------
    seconds : that a frame may take; infinite: it has no end
    clock : s

    Attributes
    ----------
    waiting : clusters that have not been looked at
    is_urgent : whether hypotheses are of what may be gone in the next frame
    """

    def __init__(self, seconds: float = inf, clock: Callable[[], float] = perf_counter) -> None:
        self._seconds = seconds
        self._clock = clock
        self._longest_step = self._usually_after = 0.0
        self.begin_frame()
        self.begin()

    def begin_frame(self) -> None:
        """Let a frame begin now."""
        self._frame_began = self._clock()
        self._ended: float | None = None

    def begin(self) -> None:
        """Let the hypotheses of the frame begin now."""
        now = self._last_look = self._clock()
        left = self._seconds - (now - self._frame_began) - self._usually_after
        left = max(left, LEAST_LEFT * self._seconds)
        self._end = now + left
        self._last_start = self._end - min(self._longest_step, LARGEST_STEP * left)
        self._longest_step *= REMEMBERED
        self._was_spent = self.is_urgent = False
        self.waiting = 0

    @property
    def is_spent(self) -> bool:
        """Whether the time of hypotheses is over."""
        if self._was_spent:
            # Where threads are timed, a look at the clock takes as long as a cluster that waits.
            return True
        now = self._clock()
        self._note_step(now)
        self._was_spent = now >= self._end
        return self._was_spent or (not self.is_urgent and now >= self._last_start)

    def end(self) -> None:
        """Let the hypotheses of the frame be over now."""
        self._ended = self._clock()
        self._note_step(self._ended)
        self._was_spent = self._ended >= self._last_start

    def end_frame(self) -> None:
        """Let the frame be over now."""
        if self._ended is not None:
            after = self._clock() - self._ended
            self._usually_after += NEWEST * (after - self._usually_after)

    def _note_step(self, now: float) -> None:
        if not self._was_spent:
            self._longest_step = max(self._longest_step, now - self._last_look)
        self._last_look = now
