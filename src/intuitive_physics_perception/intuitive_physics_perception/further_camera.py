"""A further camera of a scene that another camera has modelled."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor, Future

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.frames.change_of_frame import RigidTransform
from intuitive_physics_perception.environment.environment_model import EnvironmentModel
from intuitive_physics_perception.environment.gravity import degrees_between
from intuitive_physics_perception.environment.standing import FramesFromOnePlace
from intuitive_physics_perception.frame import Frame
from intuitive_physics_perception.scene import ModelledScene, begun, modelled_elsewhere
from intuitive_physics_perception.settings import PerceptionSettings

SAME_PLANE = 5.0
"""Angle, degrees, within which a plane that two cameras see is taken for one and the same."""

SAME_PLANE_DISTANCE = 0.2
"""Distance, m, within which it is: farther apart are two surfaces, as a table and a floor."""


class FurtherCamera:
    """Models what a further camera sees, in the frame of the environment that is known.

    Its own model decides what belongs to an object in its frames: it fits its own readings where
    its pose is not quite exact. Objects move in the environment of the first camera.

    Parameters
    ----------
    settings : of all stages
    rng : source of its random choices
    background : in which its view is modelled while frames go on; None models it at once
    """

    def __init__(
        self, settings: PerceptionSettings, rng: np.random.Generator, background: Executor | None
    ) -> None:
        self._settings = settings
        self._rng = rng
        self._background = background
        self.forget()

    def forget(self) -> None:
        """Model its view again from the frames that follow."""
        self._newest = FramesFromOnePlace(self._settings)
        self._modelling: Future[tuple[ModelledScene, str]] | None = None
        self._scene: ModelledScene | None = None
        self.doubt = ""

    def restart(self) -> None:
        """Forget the last frames, as when time goes back; its view stays known."""
        if self._scene is not None:
            self._scene.restart()

    def look(self, frame: Frame, seen: EnvironmentModel) -> ModelledScene | None:
        """Take a frame; return the scene as it is seen from here, None while that is not modelled.

        `seen`: the known environment as it is seen from there.
        """
        if self._scene is None and self._modelling is None:
            self._newest.take(frame.points, frame.time, frame.pose)
            if self._newest.are_enough:
                (rng,) = self._rng.spawn(1)
                job = self._newest.frames, seen, frame.pose, self._settings, rng, self._background
                self._modelling = begun(self._background, _modelled, *job)
        if self._modelling is not None and self._modelling.done():
            (self._scene, self.doubt), self._modelling = self._modelling.result(), None
        if self._scene is not None:
            self._scene.look_from(frame.pose)
        return self._scene


def _modelled(
    frames: Sequence[NDArray[np.float32]],
    seen: EnvironmentModel,
    pose: RigidTransform | None,
    settings: PerceptionSettings,
    rng: np.random.Generator,
    background: Executor | None,
) -> tuple[ModelledScene, str]:
    """Model what frames (height, width, 3) m show from a pose, and say where it contradicts what is
    known."""
    # Where nothing that could be a support is in its view, what is known is.
    scene = modelled_elsewhere(
        frames, seen, pose, settings, rng, background, follows_sensor=False
    ) or ModelledScene(seen, frames, settings, rng, pose=pose, measured=True, background=background)
    return scene, pose_doubt(scene.model, seen, settings)


def pose_doubt(own: EnvironmentModel, seen: EnvironmentModel, settings: PerceptionSettings) -> str:
    """Return a sentence on how far a plane is elsewhere for one camera than for another, empty
    where noise explains it.

    `own` model of a camera and the one that is known, as it is `seen` from there by its pose.
    """
    worst, sentence = 0.0, ""
    for plane in own.detected:
        # Where it is read best.
        ranges = np.linalg.norm(plane.hull, axis=1)
        place, noise = plane.hull[ranges.argmin()], own.noise.deviation(float(ranges.min()))
        same = [
            other
            for other in seen.detected
            if degrees_between(plane.normal, other.normal) < SAME_PLANE
        ]
        apart = min((abs(float(other.normal @ place) - other.offset) for other in same), default=0)
        explained = float(settings.plane_tolerance + settings.plane_sigmas * noise)
        if max(worst, explained) < apart < SAME_PLANE_DISTANCE:
            worst = apart
            sentence = (
                f"a plane is {100.0 * apart:.1f} cm beside where the first camera sees it; "
                "expected the same place: calibrate where tf has the cameras"
            )
    return sentence
