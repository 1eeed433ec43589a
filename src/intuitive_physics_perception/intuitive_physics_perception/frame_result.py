"""Perception result of one frame."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.observation import Detections, Observation
from intuitive_physics.scene import SceneObject
from intuitive_physics.state import ObjectState
from intuitive_physics_perception.detection.detections import Detection
from intuitive_physics_perception.environment.environment_model import EnvironmentModel
from intuitive_physics_perception.tracking.episodes import Episode, observations_from


@dataclass(frozen=True)
class PerceivedObject:
    """An object that is tracked now.

    Parameters
    ----------
    object : what it is
    state : in the environment's frame
    color : (3,) recent mean of red, green and blue, 0 to 1; None where unknown
    detection : of this frame alone, in the environment's frame; None where it was not seen in it
    """

    object: SceneObject
    state: ObjectState
    color: NDArray[np.float64] | None = None
    detection: Detections | None = None


@dataclass(frozen=True)
class FrameDiagnostics:
    """Numbers and times of one frame.

    Parameters
    ----------
    problem : one sentence on why the frame could not be used, empty when it could
    waiting : clusters of points that have to wait for the next frame, as the time is over
    spheres : how many were found
    seconds : time each stage took, by its name
    """

    problem: str = ""
    waiting: int = 0
    spheres: int = 0
    seconds: dict[str, float] = field(default_factory=dict)


class StageTimer:
    """Measures how long each stage of one frame takes, in `seconds` by its name."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self.seconds: dict[str, float] = {}
        self._clock = clock

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Time what is done inside the block."""
        started = self._clock()
        yield
        self.seconds[name] = self._clock() - started


@dataclass(frozen=True)
class FrameResult:
    """Perception result of one frame.

    Parameters
    ----------
    time : s, of the objects' states: that of the frame, or of the latest detection in it where
        readings have times of their own, or of what another sensor has shown later still
    model : the environment; None while it is not known
    is_new_model : whether this frame completed it, or revised it
    revised : one sentence when parts of the environment have come or gone; else empty
    restarted : whether time went back, so that tracking has started again
    moved : one sentence when the environment is modelled again from the frames that follow, as the
        sensor was moved, the support has gone or gravity points elsewhere; else empty
    detections : what was found in this frame alone, in the environment's frame
    objects : what is tracked, in the environment's frame
    episodes : those that ended with this frame
    diagnostics : how it went
    """

    time: float
    model: EnvironmentModel | None
    is_new_model: bool = False
    revised: str = ""
    restarted: bool = False
    moved: str = ""
    detections: tuple[Detection, ...] = ()
    objects: tuple[PerceivedObject, ...] = ()
    episodes: tuple[Episode, ...] = ()
    diagnostics: FrameDiagnostics = FrameDiagnostics()

    @cached_property
    def observations(self) -> tuple[Observation, ...]:
        """Observations of the episodes, computed when first asked for: objects are known before."""
        return observations_from(self.episodes)
