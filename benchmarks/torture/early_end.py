"""Errors that end a part or a check, in one line, so that the rest of the run goes on."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from intuitive_physics.errors import IntuitivePhysicsError

# After which a part is given up: each further start may take a minute and shows nothing new
MOST_DEATHS = 10


class EarlyEndError(IntuitivePhysicsError):
    """A part cannot go on, since a node died or an event does not happen."""


def check_deaths(deaths: Sequence[str]) -> None:
    """Raise `EarlyEndError` when there were too many."""
    if len(deaths) > MOST_DEATHS:
        raise EarlyEndError(f"nodes died {len(deaths)} times by themselves")


@contextmanager
def noted(failures: list[str]) -> Iterator[None]:
    """Note an error in the block in one line, and go on after the block."""
    try:
        yield
    except Exception as error:
        failures.append(f"ended early: {in_one_line(error)}")


def in_one_line(error: Exception) -> str:
    """Return the message of an error; for an unexpected one, its kind and its place as well."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    said = " ".join(dict.fromkeys([*lines[:1], *lines[-1:]]))
    if isinstance(error, IntuitivePhysicsError):
        return said
    place = traceback.extract_tb(error.__traceback__)[-1]
    return f"{type(error).__name__} in {Path(place.filename).name}:{place.lineno}: {said}"


def traceback_in(output: str) -> str:
    """Return in one line the first traceback of an output and the line before it; or nothing."""
    before, heading, after = output.partition("Traceback (most recent call last)")
    if not heading:
        return ""
    cause = (before.splitlines() or [""])[-1].strip()
    error = next((line for line in after.splitlines()[1:] if line[:1].strip()), "")
    return f"a traceback: {cause} {error}"


class FaultError(IntuitivePhysicsError):
    """The nodes did not bear a fault as they should."""


def result_of(check: Callable[[], None]) -> str:
    """Return "ok", or in one line the error that a check raises."""
    try:
        check()
    except Exception as error:
        return in_one_line(error)
    return "ok"
