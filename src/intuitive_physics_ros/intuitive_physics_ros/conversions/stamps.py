"""Seconds as the library counts them and stamps as messages carry them."""

from __future__ import annotations

from builtin_interfaces.msg import Time

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.validation import finite_float

NANOSECONDS = 1_000_000_000
LAST_SECOND = 2**31 - 1


def stamp_from_seconds(seconds: float) -> Time:
    """Return the stamp nearest to a time in s, from 0 to 2038-01-19 as the message allows."""
    nanoseconds = round(finite_float(seconds, "time") * NANOSECONDS)
    if not 0 <= nanoseconds <= LAST_SECOND * NANOSECONDS:
        raise InvalidInputError(f"time is {seconds:g} s; expected 0 to {LAST_SECOND} s")
    return Time(sec=nanoseconds // NANOSECONDS, nanosec=nanoseconds % NANOSECONDS)


def seconds_from_stamp(stamp: Time) -> float:
    """Return a stamp in s: to a quarter of a microsecond today, as a double holds it."""
    return stamp.sec + stamp.nanosec / NANOSECONDS
