"""Observations Y^i: the trajectories perceived in one scene, and their JSON files."""

from __future__ import annotations

import json
import os
import tempfile
import uuid
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.scene import Environment, Scene, SceneObject
from intuitive_physics.state import ObjectState
from intuitive_physics.trajectory import Trajectory
from intuitive_physics.validation import name_string

FORMAT = "intuitive_physics/observation/1"
"""Format of the JSON text, which every text names."""


@dataclass(frozen=True)
class ObservedObject:
    """One object of an observation.

    Parameters
    ----------
    object : its material and shape
    trajectory : Y_j^i, its perceived positions
    initial_state : θ_d with covariance at the observation's `start_time`
    """

    object: SceneObject
    trajectory: Trajectory
    initial_state: ObjectState

    def to_dict(self) -> dict[str, Any]:
        """Return plain data that `from_dict` reads."""
        return {
            "object": self.object.to_dict(),
            "times": self.trajectory.times.tolist(),
            "positions": self.trajectory.positions.tolist(),
            "initial_state": self.initial_state.to_dict(),
        }

    @staticmethod
    def from_dict(data: Mapping[str, Any]) -> ObservedObject:
        """Read what `to_dict` wrote."""
        try:
            return ObservedObject(
                SceneObject.from_dict(data["object"]),
                Trajectory(data["times"], data["positions"]),
                ObjectState.from_dict(data["initial_state"]),
            )
        except (KeyError, TypeError) as error:
            raise InvalidInputError(
                f"observed object cannot be read ({error}); "
                "expected object, times, positions, initial_state"
            ) from None


@dataclass(frozen=True)
class Observation:
    """Y^i: the environment and the trajectory of each object seen in it.

    Parameters
    ----------
    environment : Ω_e
    objects : at least one
    start_time : s, on the clock of the trajectories; the initial states hold at this time
    id : unique among all observations; made at random if not given
    """

    environment: Environment
    objects: tuple[ObservedObject, ...]
    start_time: float
    id: str = field(default_factory=lambda: uuid.uuid4().hex)

    def __post_init__(self) -> None:
        name_string(self.id, "observation id")
        object.__setattr__(self, "objects", tuple(self.objects))
        for seen in self.objects:
            if seen.trajectory.times[-1] <= self.start_time:
                raise InvalidInputError(
                    f"object {seen.object.id} was last seen at {seen.trajectory.times[-1]:.6g} s "
                    f"and the observation starts at {self.start_time:.6g} s; "
                    "expected points after the start"
                )
        self.scene()

    def scene(self) -> Scene:
        """Return the world at `start_time`, ready to be simulated."""
        return Scene(
            self.environment,
            tuple(seen.object for seen in self.objects),
            tuple(seen.initial_state for seen in self.objects),
        )

    @property
    def materials(self) -> tuple[str, ...]:
        """Materials of objects, then of the environment, each once."""
        return self.scene().materials

    def to_json(self) -> str:
        """Return the observation as JSON text."""
        return json.dumps(
            {
                "format": FORMAT,
                "id": self.id,
                "start_time": self.start_time,
                "environment": self.environment.to_dict(),
                "objects": [seen.to_dict() for seen in self.objects],
            },
            allow_nan=False,
        )

    @staticmethod
    def from_json(text: str) -> Observation:
        """Read what `to_json` wrote.

        Raises
        ------
        InvalidInputError
            When the text is cut short, not JSON, or not an observation.
        """
        try:
            data = json.loads(text)
        except json.JSONDecodeError as error:
            raise InvalidInputError(f"observation is not whole JSON: {error}") from None
        if not isinstance(data, dict) or data.get("format") != FORMAT:
            got = data.get("format") if isinstance(data, dict) else type(data).__name__
            raise InvalidInputError(f"observation has the format {got!r}; expected {FORMAT!r}")
        try:
            return Observation(
                Environment.from_dict(data["environment"]),
                tuple(ObservedObject.from_dict(seen) for seen in data["objects"]),
                float(data["start_time"]),
                data["id"],
            )
        except (KeyError, TypeError) as error:
            raise InvalidInputError(f"observation cannot be read: it lacks {error}") from None


def observation_materials(observations: Sequence[Observation]) -> tuple[str, ...]:
    """Materials of all observations, each once, in order of appearance."""
    return tuple(dict.fromkeys(name for seen in observations for name in seen.materials))


def save_observation(observation: Observation, path: str | os.PathLike[str]) -> None:
    """Write one observation to a file that appears whole or not at all."""
    target = Path(path)
    try:
        with tempfile.NamedTemporaryFile(
            "w", encoding="utf-8", dir=target.parent, prefix=target.name, delete=False
        ) as file:
            file.write(observation.to_json())
            file.flush()
            os.fsync(file.fileno())
        os.replace(file.name, target)
    except OSError as error:
        raise InvalidInputError(f"cannot write {target}: {error.strerror}") from None


def load_observation(path: str | os.PathLike[str]) -> Observation:
    """Read a file that `save_observation` wrote."""
    try:
        text = Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InvalidInputError(f"cannot read {path}: {error}") from None
    try:
        return Observation.from_json(text)
    except InvalidInputError as error:
        raise InvalidInputError(f"{path}: {error}") from None
