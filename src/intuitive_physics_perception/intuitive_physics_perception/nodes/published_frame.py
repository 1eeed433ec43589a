"""The frame that perception publishes in: its own, or one of the user's by tf."""

from __future__ import annotations

from dataclasses import dataclass

from rclpy.node import Node
from std_msgs.msg import Header

from intuitive_physics.frames.change_of_frame import (
    RigidTransform,
    environment_in,
    observation_in,
    state_in,
)
from intuitive_physics.observation import Observation
from intuitive_physics.scene import Environment
from intuitive_physics.state import ObjectState
from intuitive_physics_perception.environment.environment_model import EnvironmentModel
from intuitive_physics_ros.diagnostics import Level, Status
from intuitive_physics_ros.transforms import Transforms, UnknownTransformError

DISTANCE = 2.0
"""m from the sensor at which a turn of the frame counts as a shift. Our choice: objects that are
perceived well are about as far."""


@dataclass(frozen=True)
class _Placement:
    """Where the environment of a model is in the frame.

    Parameters
    ----------
    model : whose environment it is
    camera : header of the frame it was looked up for
    camera_pose : of the camera in the frame
    from_environment : from the environment's own frame into this one
    """

    model: EnvironmentModel
    camera: Header
    camera_pose: RigidTransform
    from_environment: RigidTransform


class PublishedFrame:
    """Environments, states and observations in the frame in which they are published.

    With a target frame, nothing is published until tf tells where the camera is in it. When it has
    moved against the camera by more than the noise of the readings, the environment is placed
    anew, so that environment and states always fit together. Velocities are those against the
    environment, also where the frame moves.

    Parameters
    ----------
    target : name of the frame; empty: that of the environment model
    """

    def __init__(self, target: str) -> None:
        self._target = target
        self._transforms: Transforms | None = None
        self._placement: _Placement | None = None
        self._problem = ""

    def listen(self, node: Node) -> None:
        """Listen to tf, where a target frame was given.

        Raises
        ------
        InvalidInputError
            When tf2_ros is not installed.
        """
        if self._target:
            self._transforms = Transforms(node)

    def follow(self, camera: Header, model: EnvironmentModel) -> bool:
        """Look where the frame is now; return whether the environment is to be published.

        Parameters
        ----------
        camera : header of the frame that is processed
        model : of the environment
        """
        old, new = self._placement, self._placed(camera, model)
        if new is not None and old is not None and old.model is model and _is_close(old, new):
            return False
        self._placement = new
        return new is not None

    def restart(self) -> None:
        """Forget where frames were: time has gone back."""
        if self._transforms is not None:
            self._transforms.forget()

    @property
    def is_known(self) -> bool:
        """Whether something can be published."""
        return self._placement is not None

    @property
    def camera_pose(self) -> RigidTransform:
        """Of the camera in this frame; only where it is known."""
        return self._known().camera_pose

    @property
    def name(self) -> str:
        """Name of the frame; only where it is known."""
        return self._target or self._known().model.environment.frame_id

    def environment(self) -> Environment:
        """Return the environment of the newest model; only where the frame is known."""
        placed = self._known()
        own = placed.model.environment
        return environment_in(own, self.name, placed.from_environment) if self._target else own

    def state(self, state: ObjectState) -> ObjectState:
        """Return a state of the newest model's environment; only where the frame is known."""
        return state_in(state, self._known().from_environment) if self._target else state

    def observation(self, observation: Observation) -> Observation:
        """Return an observation of any model's environment; only where the frame is known."""
        if not self._target:
            return observation
        return observation_in(observation, self.name, self._known().from_environment)

    def check(self) -> Status:
        """Say for /diagnostics whether the frame is known."""
        if self._problem:
            return Status(Level.WARN, f"nothing is published: {self._problem}")
        return Status(Level.OK, f"published in {self._target or 'the frame of the environment'}")

    @property
    def problem(self) -> str:
        """Why it is not known; empty where it is, or nothing was looked up yet."""
        return self._problem

    def _known(self) -> _Placement:
        if self._placement is None:
            raise UnknownTransformError(self._problem or "no environment is modelled yet")
        return self._placement

    def _placed(self, camera: Header, model: EnvironmentModel) -> _Placement | None:
        sensor = RigidTransform(model.translation, model.sensor_orientation())
        if self._transforms is None:
            return _Placement(model, camera, sensor, RigidTransform())
        try:
            pose = self._transforms.lookup(self._target, camera.frame_id, camera.stamp)
        except UnknownTransformError as error:
            self._problem = str(error)
            return None
        self._problem = ""
        return _Placement(model, camera, pose, pose.after(sensor.inverse))


def _is_close(old: _Placement, new: _Placement) -> bool:
    """Whether two placements of a model differ by less than a reading's noise."""
    shift, angle = old.camera_pose.difference(new.camera_pose)
    return bool(shift + DISTANCE * angle < old.model.noise.deviation(DISTANCE))
