"""Frames of the user's, by tf: the one that stands still, and the one that is published in."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from std_msgs.msg import Header

from intuitive_physics.frames.change_of_frame import (
    RigidTransform,
    detections_in,
    environment_in,
    observation_in,
    state_in,
)
from intuitive_physics.observation import Detections, Observation
from intuitive_physics.scene import Environment
from intuitive_physics.state import ObjectState
from intuitive_physics_perception.environment.environment_model import EnvironmentModel
from intuitive_physics_perception.environment.standing import is_same_view
from intuitive_physics_perception.input.reading_times import as_of_start
from intuitive_physics_ros.conversions import seconds_from_stamp, stamp_from_seconds
from intuitive_physics_ros.diagnostics import Level, Status
from intuitive_physics_ros.environment_publisher import EnvironmentPublisher
from intuitive_physics_ros.transforms import Transforms, UnknownTransformError

POSE_INTERVAL = 0.01
"""Time, s, between two poses of a sensor within one frame, as of `as_of_start`."""

PATIENCE = 0.15
"""Time, s, that a frame waits for the transform of its time. Our choice: joint states come 10 to
100 times a second, and the image of the next frame is not to be lost meanwhile."""


class FixedFrame:
    """Looks up the pose of the sensor at each frame, and publishes the frames of environments.

    Parameters
    ----------
    name : of the frame; empty: the sensor stands still, and environments hang below it
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self._transforms: Transforms | None = None
        self._problem = ""
        self._missed = 0

    def listen(self, transforms: Transforms | None) -> None:
        """Set the source of transforms, used only where the frame has a name."""
        self._transforms = transforms if self.name else None

    def sensor_pose(self, sensor: Header) -> RigidTransform | None:
        """Return where the sensor is at the time of a frame; None where it stands still.

        Raises
        ------
        UnknownTransformError
            When tf does not know it within the patience that a frame has.
        """
        if self._transforms is None:
            return None
        try:
            pose = self._transforms.lookup_at(self.name, sensor.frame_id, sensor.stamp, PATIENCE)
        except UnknownTransformError as error:
            self._problem = str(error)
            self._missed += 1
            raise
        self._problem = ""
        return pose

    def as_of_stamp(
        self,
        sensor: Header,
        points: NDArray[np.float32],
        offsets: NDArray[np.float32] | None,
        pose: RigidTransform | None,
    ) -> NDArray[np.float32]:
        """Return a frame as a sensor would have read it that had stood still since its stamp.

        Parameters
        ----------
        sensor : header of the frame
        points : (height, width, 3) m, each as of its own time
        offsets : (height, width) s, these times after the stamp; None: all are of the stamp's
        pose : of the sensor at the stamp; None where it stands still

        Returns
        -------
        (height, width, 3) m in the sensor's frame at the stamp

        Raises
        ------
        UnknownTransformError
            As `sensor_pose`.
        """
        if pose is None or offsets is None or not offsets.size:
            return points
        first, last = float(offsets.min()), float(offsets.max())
        times = np.linspace(first, last, 1 + max(1, math.ceil((last - first) / POSE_INTERVAL)))
        begin = seconds_from_stamp(sensor.stamp)
        poses = [
            self.sensor_pose(
                Header(stamp=stamp_from_seconds(begin + float(t)), frame_id=sensor.frame_id)
            )
            for t in times
        ]
        known = [one for one in poses if one is not None]
        moved = as_of_start(points, offsets, times, known)
        back = pose.inverse.after(known[0])
        return back.points(moved.reshape(-1, 3)).astype(np.float32).reshape(points.shape)

    def hang(
        self,
        publisher: EnvironmentPublisher,
        model: EnvironmentModel,
        sensor: Header,
        pose: RigidTransform | None,
    ) -> None:
        """Publish where an environment's frame is: below this frame, or else below the sensor's.

        `pose`: of the sensor at its time in this frame; None where it stands still.
        """
        parent, parent_pose = sensor, model.sensor_pose
        if pose is not None:
            parent = Header(stamp=sensor.stamp, frame_id=self.name)
            parent_pose = model.sensor_pose.after(pose.inverse)
        publisher.hang(model.environment.frame_id, parent, parent_pose)

    def check(self) -> Status:
        """Say for /diagnostics whether it is known where the sensor is."""
        if not self.name:
            return Status(Level.OK, "the sensor stands still")
        values = {"frames without a transform": self._missed}
        if self._problem:
            return Status(Level.WARN, self._problem, values)
        return Status(Level.OK, f"the sensor moves in {self.name}", values)


@dataclass(frozen=True)
class _Placement:
    """Place of a model's environment, and of the camera, in the frame that is published in."""

    model: EnvironmentModel
    camera_pose: RigidTransform
    from_environment: RigidTransform


class PublishedFrame:
    """Environments, states and observations in the frame in which they are published.

    With a target frame, nothing is published until tf knows where the camera is in it. When it has
    moved against the camera by more than the noise of the readings, the environment is placed
    again, so that environment and states always fit together. Velocities are those against the
    environment, also where the frame moves.

    Parameters
    ----------
    target : name of the frame; empty: that of the environment model

    Attributes
    ----------
    problem : why it is not known; empty where it is, or nothing was looked up yet
    """

    def __init__(self, target: str) -> None:
        self._target = target
        self._transforms: Transforms | None = None
        self._placement: _Placement | None = None
        self.problem = ""

    def listen(self, transforms: Transforms | None) -> None:
        """Set the source of transforms, used only where a target frame is named."""
        if self._target:
            self._transforms = transforms

    def follow(self, camera: Header, model: EnvironmentModel) -> bool:
        """Look where the frame is now; return whether the environment is to be published."""
        old = self._placement
        same = old is not None and old.model.environment is model.environment
        if same and self._transforms is None:
            return False
        new = self._placed(camera, model)
        if new is not None and old is not None and same and _is_close(old, new):
            return False
        self._placement = new
        return new is not None

    @property
    def is_known(self) -> bool:
        """Whether something can be published."""
        return self._placement is not None

    @property
    def camera_pose(self) -> RigidTransform:
        """Pose of the camera in this frame; only where it is known."""
        return self._known_placement().camera_pose

    @property
    def name(self) -> str:
        """Name of the frame; only where it is known."""
        return self._target or self._known_placement().model.environment.frame_id

    def environment(self) -> Environment:
        """Return the environment of the newest model; only where the frame is known."""
        placed = self._known_placement()
        environment = placed.model.environment
        return (
            environment_in(environment, self.name, placed.from_environment)
            if self._target
            else environment
        )

    def state(self, state: ObjectState) -> ObjectState:
        """Return a state of the newest model's environment; only where the frame is known."""
        return state_in(state, self._known_placement().from_environment) if self._target else state

    def detection(self, detection: Detections | None) -> Detections | None:
        """Return a detection in the newest model's environment; only where the frame is known."""
        if detection is None or not self._target:
            return detection
        return detections_in(detection, self._known_placement().from_environment)

    def observation(self, observation: Observation) -> Observation:
        """Return an observation of any model's environment; only where the frame is known."""
        if not self._target:
            return observation
        return observation_in(observation, self.name, self._known_placement().from_environment)

    def check(self) -> Status:
        """Say for /diagnostics whether the frame is known."""
        if self.problem:
            return Status(Level.WARN, f"nothing is published: {self.problem}")
        return Status(Level.OK, f"published in {self._target or 'the frame of the environment'}")

    def _known_placement(self) -> _Placement:
        if self._placement is None:
            raise UnknownTransformError(self.problem or "no environment is modelled yet")
        return self._placement

    def _placed(self, camera: Header, model: EnvironmentModel) -> _Placement | None:
        sensor = model.sensor_pose
        if self._transforms is None:
            return _Placement(model, sensor, RigidTransform())
        try:
            pose = self._transforms.lookup(self._target, camera.frame_id, camera.stamp)
        except UnknownTransformError as error:
            self.problem = str(error)
            return None
        self.problem = ""
        return _Placement(model, pose, pose.after(sensor.inverse))


def _is_close(old: _Placement, new: _Placement) -> bool:
    """Whether an environment has moved in the frame by less than a reading's noise."""
    return is_same_view(old.from_environment.inverse.after(new.from_environment), old.model.noise)
