"""Sharing the worlds of a batch among threads."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor


def run_in_shares(
    roll: Callable[[int, int], None], worlds: int, threads: int, smallest_share: int
) -> None:
    """Call `roll(first, last)` for contiguous shares of the worlds, each in a thread of its own.

    Parameters
    ----------
    roll : rolls out the worlds `first` to `last` (exclusive), without the GIL
    smallest_share : worlds for which another thread is worth its start
    """
    shares = max(1, min(threads, worlds // smallest_share))
    if shares == 1:
        roll(0, worlds)
        return
    edges = [worlds * share // shares for share in range(shares + 1)]
    with ThreadPoolExecutor(shares - 1) as pool:
        others = pool.map(roll, edges[1:-1], edges[2:])
        roll(*edges[:2])
        # Asking for the results raises what a thread has raised.
        list(others)
