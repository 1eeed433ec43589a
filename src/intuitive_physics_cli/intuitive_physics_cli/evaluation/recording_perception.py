"""The perception pipeline run over a whole bag, with no ROS."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.observation import Observation
from intuitive_physics_cli.evaluation.bag_frames import FrameSource, find_frame_source, read_frames
from intuitive_physics_perception.environment.environment_model import EnvironmentModel
from intuitive_physics_perception.frame_result import Perceived
from intuitive_physics_perception.pipeline import PerceptionPipeline
from intuitive_physics_perception.settings import PerceptionSettings
from intuitive_physics_recordings.bag_reader import BagReader


@dataclass(frozen=True, eq=False)
class PerceivedRecording:
    """What perception made of a bag.

    Parameters
    ----------
    source : where the frames came from
    duration : s of the bag
    model : the environment; None when it was never known
    frames_with_spheres : number of frames in which at least one sphere was found
    problems : frames that could not be used, by the reason
    observations : finished observations, in order of time
    """

    source: FrameSource
    duration: float
    model: EnvironmentModel | None
    frames_with_spheres: int
    problems: Counter[str]
    observations: tuple[Observation, ...]


def perceive_recording(
    path: Path,
    settings: PerceptionSettings,
    rng: np.random.Generator,
    *,
    topic: str | None = None,
    on_progress: Callable[[int, int], None] = lambda done, total: None,
    on_frame: Callable[[NDArray[np.float32], Perceived], None] = lambda points, perceived: None,
) -> PerceivedRecording:
    """Perceive every frame of a bag.

    Parameters
    ----------
    topic : of depth images or clouds; None guesses
    on_progress : called with the frames done and the frames in all
    on_frame : called with each frame's points (..., 3) m and what they told

    Raises
    ------
    InvalidInputError
        When the bag cannot be read or shows no scene.
    """
    pipeline = PerceptionPipeline(settings, rng)
    model: EnvironmentModel | None = None
    observations: list[Observation] = []
    problems: Counter[str] = Counter()
    with_spheres = 0
    with BagReader(path) as bag:
        source, duration = find_frame_source(bag, topic), bag.duration
        for done, (time, points) in enumerate(read_frames(bag, source), start=1):
            perceived = pipeline.process(points, time)
            on_frame(points, perceived)
            model = perceived.model or model
            observations += perceived.observations
            with_spheres += perceived.diagnostics.spheres > 0
            if perceived.diagnostics.problem:
                problems[perceived.diagnostics.problem] += 1
            on_progress(done, source.frames)
    observations += pipeline.finish()
    return PerceivedRecording(source, duration, model, with_spheres, problems, tuple(observations))
