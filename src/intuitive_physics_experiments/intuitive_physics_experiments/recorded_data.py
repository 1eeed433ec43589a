"""Recorded data of others: one door that knows a set by its arrays."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.observation import Observation
from intuitive_physics_experiments.npz_file import Arrays, load_arrays
from intuitive_physics_experiments.table_tennis import gun_observations, launch_observations


@dataclass(frozen=True)
class RecordedSet:
    """A kind of recorded set.

    Parameters
    ----------
    title : what a user calls it
    arrays : names that the file has
    load : makes observations of its arrays
    """

    title: str
    arrays: frozenset[str]
    load: Callable[[Arrays], list[Observation]]


RECORDED_SETS = (
    RecordedSet(
        "table-tennis launches",
        frozenset({"time", "position", "offsets", "radius"}),
        launch_observations,
    ),
    RecordedSet(
        "table-tennis gun flights",
        frozenset({"position", "velocity", "offsets", "dt_implied"}),
        gun_observations,
    ),
)


def load_recorded_set(path: Path) -> tuple[str, list[Observation]]:
    """Return title and observations of a recorded set.

    Raises
    ------
    InvalidInputError
        When the arrays are of no known set, or not what that set has.
    """
    arrays = load_arrays(path)
    for known in RECORDED_SETS:
        if known.arrays <= arrays.keys():
            try:
                observations = known.load(arrays)
            except InvalidInputError as error:
                raise InvalidInputError(f"{path} ({known.title}): {error}") from None
            return known.title, observations
    expected = "; ".join(f"{', '.join(sorted(s.arrays))} ({s.title})" for s in RECORDED_SETS)
    raise InvalidInputError(
        f"{path} has the arrays {', '.join(sorted(arrays))}; expected {expected}"
    )
