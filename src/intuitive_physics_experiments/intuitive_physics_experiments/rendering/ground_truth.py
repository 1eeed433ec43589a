"""Ground truth of a rendered recording, kept as JSON in the bag's folder."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.materials import StaticParameters
from intuitive_physics.scene import Environment
from intuitive_physics.validation import finite_array
from intuitive_physics_experiments.rendering.camera import Camera
from intuitive_physics_experiments.rendering.thrown_ball import BallMotion
from intuitive_physics_experiments.rendering.throws import Throw

FORMAT = "intuitive_physics/ground_truth/1"  # Name and version of the file format
FILE_NAME = "ground_truth.json"  # File in the folder of the bag


@dataclass(frozen=True, eq=False)
class GroundTruth:
    """The truth behind a rendered recording, in the world frame of `camera` and `environment`."""

    # what the recording was rendered with; equal settings give equal recordings
    settings: Mapping[str, Any]
    # ns since the epoch, stamp of the first frame; the throws' times count from here
    start_time: int
    camera: Camera  # intrinsics and pose
    environment: Environment  # Ω_e
    static_parameters: StaticParameters  # θ_s
    throws: tuple[Throw, ...]  # in order of time

    def save(self, bag: Path) -> None:
        """Write into the folder of a bag."""
        data = {
            "format": FORMAT,
            "settings": dict(self.settings),
            "start_time_ns": self.start_time,
            "camera": self.camera.to_dict(),
            "environment": self.environment.to_dict(),
            "static_parameters": self.static_parameters.to_dict(),
            "throws": [_throw_to_dict(throw) for throw in self.throws],
        }
        (bag / FILE_NAME).write_text(json.dumps(data, allow_nan=False), encoding="utf-8")

    @staticmethod
    def load(bag: Path) -> GroundTruth:
        """Read what `save` wrote."""
        path = bag / FILE_NAME
        try:
            data = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
            raise InvalidInputError(f"cannot read the ground truth {path}: {error}") from None
        if not isinstance(data, dict) or data.get("format") != FORMAT:
            raise InvalidInputError(f"{path} is not ground truth; expected the format {FORMAT!r}")
        try:
            return GroundTruth(
                data["settings"],
                int(data["start_time_ns"]),
                Camera.from_dict(data["camera"]),
                Environment.from_dict(data["environment"]),
                StaticParameters.from_dict(data["static_parameters"]),
                tuple(_throw_from_dict(throw) for throw in data["throws"]),
            )
        except (KeyError, TypeError, ValueError) as error:
            raise InvalidInputError(f"{path} cannot be read: {error}") from None


def _throw_to_dict(throw: Throw) -> dict[str, Any]:
    motion = throw.motion
    return {
        "material": throw.material,
        "radius": throw.radius,
        "start_time": throw.start_time,
        "times": motion.times.tolist(),
        "positions": motion.positions.tolist(),
        "velocities": motion.velocities.tolist(),
        "angular_velocities": motion.angular_velocities.tolist(),
    }


def _throw_from_dict(data: Mapping[str, Any]) -> Throw:
    times = finite_array(data["times"], "times of a throw", (None,))
    vectors = [
        finite_array(data[name], f"{name} of a throw", (times.size, 3))
        for name in ("positions", "velocities", "angular_velocities")
    ]
    return Throw(
        data["material"],
        float(data["radius"]),
        float(data["start_time"]),
        BallMotion(np.asarray(times), *vectors),
    )
