"""The pose bridge: poses of tags or motion capture in; environment, states, observations out."""

from __future__ import annotations

import re
from collections.abc import Callable
from contextlib import suppress
from typing import Any, TypeAlias

import numpy as np
from geometry_msgs.msg import (
    PoseStamped,
    PoseWithCovarianceStamped,
    TransformStamped,
)
from numpy.typing import NDArray
from std_msgs.msg import Header

from intuitive_physics.errors import IntuitivePhysicsError, InvalidInputError
from intuitive_physics.frames.change_of_frame import RigidTransform
from intuitive_physics.messages.geometry import xyz, xyzw
from intuitive_physics.observation import Observation
from intuitive_physics.scene import Environment, Plane, SceneObject
from intuitive_physics.state import ObjectState
from intuitive_physics.validation import covariance_matrix, name_string
from intuitive_physics_perception.nodes.frame_worker import FrameWorker
from intuitive_physics_perception.nodes.outputs import MARKER_RATE, Outputs
from intuitive_physics_perception.poses.described_objects import (
    described_objects,
    environment_from_file,
)
from intuitive_physics_perception.poses.pose_tracker import MeasuredPose, PoseTracker
from intuitive_physics_ros.conversions import seconds_from_stamp
from intuitive_physics_ros.environment_publisher import EnvironmentPublisher
from intuitive_physics_ros.lifecycle.managed_node import ManagedNode
from intuitive_physics_ros.lifecycle.run_node import farewell, run_node
from intuitive_physics_ros.monitors import InputMonitor
from intuitive_physics_ros.parameters import Parameter
from intuitive_physics_ros.qos import SENSOR_DATA, create_subscription
from intuitive_physics_ros.silence import Silence
from intuitive_physics_ros.transforms import Transforms, UnknownTransformError
from intuitive_physics_ros.unexpected_errors import unexpected_errors

PoseMessage: TypeAlias = PoseStamped | PoseWithCovarianceStamped | TransformStamped

POSE, POSE_WITH_COVARIANCE, TRANSFORM = "pose", "pose_with_covariance", "transform"
"""Values of the parameter `input` with which each object has a topic of its own."""

TF = "tf"
"""Value of `input` with which poses are those of frames on /tf."""

NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
"""Pattern of an object's name, which is part of a topic."""

TIMEOUT = 2.0
"""Time, s, without a pose after which an input counts as lost."""

WAITING = 1000
"""Poses that may wait to be handled."""

PARAMETERS = (
    Parameter(
        "input",
        "pose",
        "messages on ~/NAME/pose of each object; tf: no such topics, but the frames object_frames "
        "on /tf, as detectors of tags send them",
        choices=(POSE, POSE_WITH_COVARIANCE, TRANSFORM, TF),
    ),
    Parameter("object_names", ["object"], "names of the objects, and parts of their topics"),
    Parameter(
        "object_shapes",
        ["box 0.1 0.1 0.1"],
        "of each: sphere RADIUS, box X Y Z (whole edges), capsule RADIUS LENGTH (without caps), m",
    ),
    Parameter("object_materials", ["object"], "of each, its name"),
    Parameter(
        "object_offsets",
        [""],
        "of each: X Y Z, or X Y Z QX QY QZ QW, of its centre in the frame whose pose is measured; "
        "one empty text: none",
    ),
    Parameter("object_frames", [""], "of each, its frame on /tf; one empty text: the names"),
    Parameter("frame_id", "world", "frame of all that is published, z up; others by tf"),
    Parameter(
        "environment_file",
        "",
        "JSON of an environment, or of an observation; its frame and all coordinates are frame_id; "
        "empty: one floor",
    ),
    Parameter("floor_height", 0.0, "z of the floor, m", (-1e6, 1e6)),
    Parameter("floor_material", "environment", "material of the floor"),
    Parameter("position_noise", 0.001, "standard deviation of a measured position, m", (1e-6, 1.0)),
    Parameter(
        "orientation_noise",
        0.005,
        "standard deviation of a measured orientation about each axis, rad",
        (1e-6, 3.0),
    ),
    MARKER_RATE,
)
"""All parameters of the node."""


class PoseBridgeNode(ManagedNode):
    """Topics around `PoseTracker`."""

    def __init__(self) -> None:
        super().__init__("pose_bridge", PARAMETERS)

    def configure(self) -> None:
        """Make the tracker, which has seen nothing yet."""
        values = self.values()
        self._names = names = values["object_names"]
        for name in names:
            if not NAME.fullmatch(name):
                raise InvalidInputError(
                    f"object_names has {name!r}; expected letters, digits and _, as in topics"
                )
        offsets = values["object_offsets"]
        objects = described_objects(
            names,
            values["object_shapes"],
            values["object_materials"],
            [""] * len(names) if offsets == [""] else offsets,
        )
        self._frame_id = values["frame_id"]
        path = values["environment_file"]
        floor = Plane("floor", values["floor_material"], (0, 0, 1), values["floor_height"])
        environment = Environment([floor], frame_id=self._frame_id)
        if path:
            environment = environment_from_file(path)
        if environment.frame_id != self._frame_id:
            raise InvalidInputError(
                f"frame_id is {self._frame_id!r} and the environment of {path!r} is in "
                f"{environment.frame_id!r}; expected the same frame"
            )
        self._model = environment
        self._tracker = PoseTracker(environment, objects)
        self._environment = EnvironmentPublisher(self)

    def activate(self) -> None:
        """Subscribe to poses and publish states and observations."""
        values = self.values()
        self._noise = values["position_noise"] ** 2, values["orientation_noise"] ** 2
        self._outputs = Outputs(self)
        now = Header(stamp=self.get_clock().now().to_msg(), frame_id=self._frame_id)
        self._environment.publish(self._model, camera=now, camera_pose=RigidTransform())
        self._frame: tuple[Header, dict[str, MeasuredPose]] | None = None
        self._expected: set[str] = set()
        self._newest: tuple[Header, list[SceneObject], list[ObjectState]] = now, [], []
        self._transforms: Transforms | None = None
        # Where all poses are in one frame nothing has to be looked up.
        with suppress(InvalidInputError):
            self._transforms = Transforms(self)
        self._monitors = {name: InputMonitor(self, name, TIMEOUT) for name in self._names}
        self._worker: FrameWorker[tuple[str, Any]] = FrameWorker(self._handle, WAITING)
        for name, monitor in self._monitors.items():
            self.diagnostics.add(f"poses of {name}", monitor.check)
        if values["input"] == TF:
            self._hear_frames(values["object_frames"])
        else:
            self._hear_topics(values["input"])
        self.create_timer(1.0 / values[MARKER_RATE.name], self._on_marker_tick)

    def deactivate(self) -> None:
        """Stop the worker and publish what moved; where objects were is forgotten."""
        if self._worker.stop(self.patience()):
            self._publish_observations(self._tracker.finish())
        else:
            self.get_logger().warning("the pose under way did not end in time and is left behind")
        farewell([self._outputs.observations, *self._environment.publishers])

    def cleanup(self) -> None:
        """Forget the environment."""
        self._environment.destroy()
        del self._tracker

    def _hear_topics(self, wanted: str) -> None:
        for name_of_kind, kind in (
            (POSE, PoseStamped),
            (POSE_WITH_COVARIANCE, PoseWithCovarianceStamped),
            (TRANSFORM, TransformStamped),
        ):
            if name_of_kind != wanted:
                continue
            for name in self._names:
                rule = f"-r '~/{name}/pose:=/TOPIC'"
                remedy = f"choose the topic by a rule, {rule}, and its type by the parameter input"
                self._monitors[name].expect(Silence(self, {f"~/{name}/pose": kind}, remedy))
                create_subscription(self, kind, f"~/{name}/pose", self._taking(name), SENSOR_DATA)

    def _hear_frames(self, frames: list[str]) -> None:
        names = self._names
        given = names if frames == [""] else frames
        if len(given) != len(names):
            raise InvalidInputError(
                f"object_frames has {len(given)} frames for {len(names)} objects; expected as many"
            )
        try:
            from tf2_msgs.msg import TFMessage
        except ImportError:
            raise InvalidInputError(
                "input is tf, but tf2_msgs is not installed; expected it "
                "(sudo apt install ros-jazzy-tf2-msgs)"
            ) from None
        take = {frame: self._taking(name) for frame, name in zip(given, names, strict=True)}

        def on_transforms(message: Any) -> None:
            for transform in message.transforms:
                if transform.child_frame_id in take:
                    take[transform.child_frame_id](transform)

        for frame, name in zip(given, names, strict=True):
            remedy = f"no transform of the frame {frame!r}, as object_frames names it, has come"
            self._monitors[name].expect(Silence(self, {"/tf": TFMessage}, remedy))
        self.create_subscription(TFMessage, "/tf", on_transforms, 100)

    def _taking(self, name: str) -> Callable[[PoseMessage], None]:
        return lambda message: self._worker.put((name, message))

    def _handle(self, item: tuple[str, PoseMessage]) -> None:
        """Take a pose; runs in the worker's thread."""
        name, message = item
        monitor = self._monitors[name]
        try:
            self._collect(name, message.header, self._measured(message))
        except IntuitivePhysicsError as error:
            monitor.rejected(error)
        except Exception as error:
            # A thread that dies would take all poses with it.
            monitor.rejected(unexpected_errors(self).report(error, "a pose"))
        else:
            monitor.accepted()

    def _collect(self, name: str, header: Header, pose: MeasuredPose) -> None:
        """Track the poses of one stamp together, as soon as all have come that came last time."""
        if self._frame is not None and self._frame[0].stamp != header.stamp:
            self._track()
        if self._frame is None:
            self._frame = Header(stamp=header.stamp, frame_id=self._frame_id), {}
        self._frame[1][name] = pose
        if self._frame[1].keys() >= self._expected:
            self._track()

    def _track(self) -> None:
        if self._frame is None:
            return
        (header, poses), self._frame = self._frame, None
        self._expected = set(poses)
        back, observations = self._tracker.update(float(seconds_from_stamp(header.stamp)), poses)
        if back:
            self.get_logger().warning("time went back: tracking starts again")
        objects, states = self._tracker.states()
        self._newest = header, objects, states
        self._outputs.publish_states(header, objects, states)
        self._publish_observations(observations)

    def _measured(self, message: PoseMessage) -> MeasuredPose:
        """Return a pose in the frame of all that is published."""
        stamp = message.header.stamp
        if stamp.sec == 0 and stamp.nanosec == 0:
            raise InvalidInputError("stamp of a pose is 0; expected the time of its measurement")
        place, covariance = _pose_of(message)
        frame = name_string(message.header.frame_id, "frame of a pose")
        position, rotation = (variance * np.eye(3) for variance in self._noise)
        if covariance is not None:
            position, rotation = covariance[:3, :3], covariance[3:, 3:]
        if frame != self._frame_id:
            way = self._way_from(frame, stamp)
            place = way.after(place)
            position, rotation = way.covariances(position), way.covariances(rotation)
        return MeasuredPose(place, position, rotation)

    def _way_from(self, frame: str, stamp: Any) -> RigidTransform:
        if self._transforms is None:
            raise InvalidInputError(
                f"pose is in the frame {frame!r}; expected {self._frame_id!r}, as frame_id says, "
                "or tf2_ros to look up where the one is in the other"
            )
        try:
            return self._transforms.lookup(self._frame_id, frame, stamp)
        except UnknownTransformError as error:
            raise InvalidInputError(f"{error}, or frame_id {frame!r}") from None

    def _publish_observations(self, observations: tuple[Observation, ...]) -> None:
        for observation in observations:
            self._outputs.publish_observation(observation)

    def _on_marker_tick(self) -> None:
        if self._outputs.has_viewer:
            header, objects, states = self._newest
            self._outputs.publish_markers(header.stamp, self._model, objects, states)


def _pose_of(message: PoseMessage) -> tuple[RigidTransform, NDArray[np.float64] | None]:
    """Return a pose and its covariance (6, 6) of position and rotation vector, where it has one."""
    if isinstance(message, TransformStamped):
        transform = message.transform
        return RigidTransform(xyz(transform.translation), xyzw(transform.rotation)), None
    if isinstance(message, PoseStamped):
        return RigidTransform(xyz(message.pose.position), xyzw(message.pose.orientation)), None
    pose = message.pose.pose
    covariance = covariance_matrix(
        np.reshape(message.pose.covariance, (6, 6)), "covariance of a pose", 6
    )
    place = RigidTransform(xyz(pose.position), xyzw(pose.orientation))
    # By convention zeros say that it is not known.
    return place, covariance if covariance[:3, :3].any() and covariance[3:, 3:].any() else None


def main() -> int:
    """Run the node until it is stopped."""
    return run_node(PoseBridgeNode)
