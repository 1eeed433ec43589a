"""What a test of a law of motion finds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Violation:
    """The worst violation of a law by a track.

    Parameters
    ----------
    log_p : logarithm of its p value among all places of the track that were tested
    time : s, at which the earliest violation as strong as its p value must be begins at the latest
    clean_until : s, the time up to which nothing is known against the track
    what : for people, what the object does not do
    """

    log_p: float
    time: float
    clean_until: float
    what: str


NOTABLE_LOG_P = -7.0
"""Logarithm of the p value of a place, 0.1 %, from which on a violation is taken to begin there
where the track as a whole violates the law."""


def violations_of(
    log_ps: NDArray[np.float64],
    begins: NDArray[np.float64],
    ends: NDArray[np.float64],
    what: str,
) -> Violation | None:
    """Put together what a test found at w places; None where there was no place.

    `log_ps` (w,) logarithm of the p value at each; `begins` (w,) and `ends` (w,) s, between which a
    violation at each place lies.
    """
    if log_ps.size == 0:
        return None
    # Bonferroni's bound of the least of w p values.
    corrected = log_ps + np.log(log_ps.size)
    worst = float(min(corrected.min(), 0.0))
    notable = np.flatnonzero(corrected <= max(NOTABLE_LOG_P, worst))
    if notable.size == 0:
        notable = np.array([int(np.argmin(corrected))])
    first = notable[np.lexsort((-begins[notable], ends[notable]))[0]]
    return Violation(worst, float(ends[first]), float(begins[first]), what)
