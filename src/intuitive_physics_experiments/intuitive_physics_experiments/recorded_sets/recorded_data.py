"""Recorded data of others: one door that knows a set by its arrays."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.observation import Observation
from intuitive_physics_experiments.recorded_sets.carom_billiards import carom_observations
from intuitive_physics_experiments.recorded_sets.cube_tosses import (
    CubeToss,
    cube_toss_observations,
    cube_tosses,
)
from intuitive_physics_experiments.recorded_sets.spin_flights import (
    SpinFlight,
    spin_flight_observations,
    spin_flights,
)
from intuitive_physics_experiments.recorded_sets.table_tennis import (
    AirCoefficients,
    gun_observations,
    launch_observations,
)
from intuitive_physics_recordings.npz_file import Arrays, load_arrays


@dataclass(frozen=True)
class RecordedSet:
    """A kind of recorded set."""

    title: str  # what a user calls it
    arrays: frozenset[str]  # names that the file has
    load: Callable[[Arrays], list[Observation]]  # makes observations of its arrays


def _kind(title: str, arrays: str, load: Callable[[Arrays], list[Observation]]) -> RecordedSet:
    return RecordedSet(title, frozenset(arrays.split()), load)


# Tosses of a cube onto a table (ContactNets).
CUBE_TOSSES = _kind(
    "cube tosses",
    "position quaternion_wxyz velocity_world angular_velocity_body offsets dt cube_edge",
    cube_toss_observations,
)

# Table-tennis balls from one setting of a launcher.
LAUNCHES = _kind("table-tennis launches", "time position offsets radius", launch_observations)

# Table-tennis balls whose spin a camera measured (SpinDOE).
SPIN_FLIGHTS = _kind(
    "table-tennis flights with measured spin",
    "time position offsets spin radius mass",
    spin_flight_observations,
)

# Table-tennis balls from a ball gun, with velocities.
GUN_FLIGHTS = _kind(
    "table-tennis gun flights", "position velocity offsets dt_implied", gun_observations
)

# Shots of carom billiards: three balls on a table.
CAROM_SHOTS = _kind("carom billiards", "shot_ball_t_x_y ball_radius table", carom_observations)

# All kinds; a file is of the first whose arrays it has.
RECORDED_SETS = (SPIN_FLIGHTS, LAUNCHES, GUN_FLIGHTS, CUBE_TOSSES, CAROM_SHOTS)


def load_recorded_set(path: Path) -> tuple[str, list[Observation]]:
    """Return title and observations of a recorded set."""
    kind, arrays = _read(path, RECORDED_SETS)
    with _naming(path, kind):
        return kind.title, kind.load(arrays)


def kind_of_set(path: Path) -> RecordedSet:
    """Return which of `RECORDED_SETS` a file belongs to."""
    return _read(path, RECORDED_SETS)[0]


def load_cube_tosses(
    path: Path, length_correction: float = 1.0, measured_inertia: bool = False
) -> list[CubeToss]:
    """Return the tosses of a set of cube tosses, with orientations; see `cube_tosses`."""
    kind, arrays = _read(path, (CUBE_TOSSES,))
    with _naming(path, kind):
        return cube_tosses(arrays, length_correction, measured_inertia)


def load_spin_flights(path: Path) -> list[SpinFlight]:
    """Return the flights of a set of flights with measured spin."""
    kind, arrays = _read(path, (SPIN_FLIGHTS,))
    with _naming(path, kind):
        return spin_flights(arrays)


def load_table_tennis(path: Path, air: AirCoefficients) -> tuple[str, list[Observation]]:
    """Return title and observations of a table-tennis set, of balls that fly through air."""
    kind, arrays = _read(path, (LAUNCHES, GUN_FLIGHTS))
    load = launch_observations if kind is LAUNCHES else gun_observations
    with _naming(path, kind):
        return kind.title, load(arrays, air)


def _read(path: Path, expected: Sequence[RecordedSet]) -> tuple[RecordedSet, dict[str, NDArray]]:
    """Return the kind of a set, one of the expected, and its arrays."""
    arrays = load_arrays(path)
    kind = next((kind for kind in RECORDED_SETS if kind.arrays <= arrays.keys()), None)
    if kind is None:
        known = "; ".join(f"{', '.join(sorted(s.arrays))} ({s.title})" for s in RECORDED_SETS)
        raise InvalidInputError(
            f"{path} has the arrays {', '.join(sorted(arrays))}; expected {known}"
        )
    if kind not in expected:
        titles = " or ".join(kind.title for kind in expected)
        raise InvalidInputError(f"{path} is a set of {kind.title}; expected {titles}")
    return kind, arrays


@contextmanager
def _naming(path: Path, kind: RecordedSet) -> Iterator[None]:
    """Make errors name the file and the kind of set."""
    try:
        yield
    except InvalidInputError as error:
        raise InvalidInputError(f"{path} ({kind.title}): {error}") from None
