"""Waits for the states that answer what a test has sent to a node."""

from __future__ import annotations

from contextlib import suppress

from intuitive_physics_ros.conversions import seconds_from_stamp
from intuitive_physics_ros.scripting import PeerTimeoutError

ANSWERED = 1.0
"""s after which what was sent is lost."""


def wait_for_states(peer, states, time, tolerance: float = 1e-4) -> None:
    """Wait until the newest states are of a time (s), or what was sent is lost.

    Of messages of best effort a busy node loses all but the newest.
    """

    def answered() -> bool:
        newest = seconds_from_stamp(states[-1].header.stamp) if states else float("-inf")
        return bool(abs(newest - time) < tolerance)

    with suppress(PeerTimeoutError):
        peer.spin_until(answered, "states", ANSWERED)
