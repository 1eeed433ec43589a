"""Observations as files in a folder."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.observation import Observation, load_observation, save_observation

SUFFIX = ".json"
"""Ending of a file with one observation."""


def save_observations(observations: Sequence[Observation], folder: Path) -> None:
    """Write each observation into a file of its own, named in order of time and by its id."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InvalidInputError(f"cannot make the folder {folder}: {error.strerror}") from None
    ordered = sorted(observations, key=lambda observation: observation.start_time)
    for number, observation in enumerate(ordered):
        save_observation(observation, folder / f"{number:04d}_{observation.id}{SUFFIX}")


def load_observations(folder: Path) -> list[Observation]:
    """Read all observations of a folder, in order of their names.

    Raises
    ------
    InvalidInputError
        When there is none, or one of them cannot be read.
    """
    files = sorted(folder.glob(f"*{SUFFIX}"))
    if not files:
        raise InvalidInputError(
            f"folder {folder} has no {SUFFIX} file; expected observations, as "
            "`intuitive-physics perceive BAG --save FOLDER` writes them"
        )
    return [load_observation(file) for file in files]
