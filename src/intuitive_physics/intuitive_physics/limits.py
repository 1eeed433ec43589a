"""Limits on the size of input: messages, files and rows of databases.

Sizes are checked before anything is made in proportion to them, so that nothing that is sent or
stored can take a process's memory or hours of its time. The limits are far above what an honest
user has; a process that needs more raises them at its start with `use_limits`.
"""

from __future__ import annotations

from dataclasses import dataclass

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.settings import check_settings, list_settings, number


@dataclass(frozen=True)
class InputLimits:
    """The limits of a process, which honest input does not meet.

    Memory and time grow with the square of the number of pairs: to prepare a prediction takes 0.7 s
    and 0.4 GB with 32 materials, 13 s and 2 GB with 64. The paper's largest set has 21. The other
    limits are our choices.
    """

    most_materials: int = number(
        32, 1, 1000, "materials of a scene, of static parameters and of a database at most"
    )
    most_objects: int = number(256, 1, 10_000, "objects of a scene at most")
    most_primitives: int = number(1024, 1, 100_000, "planes and static boxes of a scene at most")
    most_corners: int = number(1024, 3, 100_000, "corners of a plane's edge at most")
    most_points: int = number(
        100_000, 1, 10_000_000, "points of all trajectories of an observation together at most"
    )
    longest_observation: float = number(
        600.0, 1.0, 1e6, "time that an observation lasts at most", unit="s"
    )
    longest_text: int = number(
        100_000_000, 1000, 2_000_000_000, "size of a text that is parsed at most", unit="bytes"
    )

    largest_database: int = number(
        20_000_000_000,
        0,
        1_000_000_000_000,
        "size to which observations may make a database grow at most, about a million throws; "
        "0: no limit",
        unit="bytes",
    )
    largest_unpacked: int = number(
        2_000_000_000,
        1000,
        1_000_000_000_000,
        "size of what is unpacked from a file at once at most",
        unit="bytes",
    )

    def __post_init__(self) -> None:
        check_settings(self)


_in_use = InputLimits()


def limits() -> InputLimits:
    """Return the limits of this process."""
    return _in_use


def use_limits(new: InputLimits) -> None:
    """Give this process other limits."""
    global _in_use
    _in_use = new


def check_limit(limit: str, got: float, what: str) -> None:
    """Check a size against a limit.

    Parameters
    ----------
    limit : name of a field of `InputLimits`
    got : the size
    what : has it, such as "materials of the message"

    Raises
    ------
    InvalidInputError
        When it is larger.
    """
    most = getattr(_in_use, limit)
    if not got <= most:
        unit = next(setting.unit for setting in list_settings(InputLimits) if setting.name == limit)
        expected = f"{_shown(most)} {unit}".rstrip()
        raise InvalidInputError(
            f"{what}: got {_shown(got)}, expected at most {expected}; send less, or raise the "
            f"limit {limit} where it is meant"
        )


def _shown(number: float) -> str:
    return f"{number:g}" if isinstance(number, float) else str(number)
