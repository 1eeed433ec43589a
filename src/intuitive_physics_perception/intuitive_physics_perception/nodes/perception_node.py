"""The perception node: depth images or clouds in; environment, states and observations out."""

from __future__ import annotations

import re
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from rclpy.publisher import Publisher
from std_msgs.msg import Header
from std_srvs.srv import Trigger

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.frames.change_of_frame import RigidTransform
from intuitive_physics.messages.geometry import StampSeconds
from intuitive_physics.observation import Observation
from intuitive_physics.validation import unit_quaternion
from intuitive_physics_perception.compile import warm_up
from intuitive_physics_perception.environment.gravity import RestingAccelerometer
from intuitive_physics_perception.frame_result import FrameDiagnostics, FrameResult
from intuitive_physics_perception.nodes.camera_inputs import CameraInputs
from intuitive_physics_perception.nodes.frame_input import INPUTS, DecodedFrame, FrameInput
from intuitive_physics_perception.nodes.outputs import MARKER_RATE, Outputs, object_names
from intuitive_physics_perception.nodes.user_frames import FixedFrame, PublishedFrame
from intuitive_physics_perception.pipeline import PerceptionPipeline
from intuitive_physics_perception.settings import (
    NO_DIRECTION,
    NO_OBJECT,
    PerceptionSettings,
    settings_from_values,
)
from intuitive_physics_ros.conversions import seconds_from_stamp, stamp_from_seconds
from intuitive_physics_ros.conversions.scenes import detections_to_message
from intuitive_physics_ros.diagnostics import Level, Status
from intuitive_physics_ros.environment_publisher import EnvironmentPublisher
from intuitive_physics_ros.imu_input import ImuInput
from intuitive_physics_ros.lifecycle.managed_node import ManagedNode
from intuitive_physics_ros.lifecycle.run_node import farewell, run_node
from intuitive_physics_ros.parameters import Parameter, setting_parameters
from intuitive_physics_ros.qos import QOS_OVERRIDES
from intuitive_physics_ros.topics import DETECTIONS
from intuitive_physics_ros.transforms import Transforms, UnknownTransformError

NO_ORIENTATION = [0.0, 0.0, 0.0, 0.0]
"""Value of the parameter `imu_orientation` that stands for none: ROS parameters have a value."""

FRAME = "environment_frame_id"
"""Parameter that names the frame of everything that is published."""

DEFAULT_FRAME = PerceptionSettings().environment_frame_id
"""Its default, which stands below the node's namespace."""

NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
"""Pattern of a further camera's name, which is part of topics."""

KEPT_STAMPS = 20_000
"""Frames whose exact stamps are kept, ten minutes at 30 a second: observations begin at one of them
and come out when their motion is over."""

PARAMETERS = [
    Parameter(
        "input",
        "auto",
        "what is subscribed to; auto: depth images and clouds; compressed: depth images on "
        "compressedDepth and colour ones on compressed below their topics, as image_transport has "
        "them",
        choices=tuple(INPUTS),
    ),
    Parameter(
        "further_cameras",
        [""],
        "names of further cameras of the same scene, whose topics are those of the first with the "
        "name before them, such as ~/NAME/depth/image; needs fixed_frame; one empty name: none",
    ),
    Parameter(
        "reordering_time",
        0.1,
        "longest time that a frame waits for earlier ones of other cameras, s; later ones are "
        "dropped",
        (0.0, 1.0),
    ),
    Parameter("seed", 0, "seed of the random choices of RANSAC", (0, 2**31 - 1)),
    Parameter(
        "image_is_rectified",
        False,
        "take the camera matrix from P and no distortion, instead of K and D",
    ),
    Parameter(
        "row_readout_time",
        0.0,
        "time from the exposure of one row of a depth image to that of the next, s, of a rolling "
        "shutter whose first row has the image's stamp; below 0: the last row is exposed first",
        (-0.01, 0.01),
    ),
    Parameter(
        "use_color",
        False,
        "subscribe to ~/color/image, registered to the depth image, to keep crossing objects apart",
    ),
    Parameter(
        "publish_detections",
        False,
        "publish vision_msgs/Detection3DArray of the objects on detections as well",
    ),
    MARKER_RATE,
    Parameter(
        "fixed_frame",
        "",
        "frame that stands still, such as map or odom, in which tf has the pose of a sensor that "
        "moves, or of each of several cameras, at the time of each frame; empty: the sensor stands "
        "still, or moves slowly and is found by what it sees",
    ),
    Parameter(
        "target_frame",
        "",
        "frame in which environment, states and observations are published, such as base_link or "
        "map, by tf from the camera's frame; empty: fixed_frame, and without one that of the "
        "environment, with z up",
    ),
    Parameter("up_hint", list(NO_DIRECTION), "roughly upward in the sensor's frame; zeros: none"),
    Parameter(
        "imu_orientation",
        NO_ORIENTATION,
        "quaternion (x, y, z, w) of the IMU in the sensor's frame; zeros: from tf",
    ),
    Parameter("known_object_names", [NO_OBJECT.name], "names of objects known by their radius"),
    Parameter("known_object_radii", [NO_OBJECT.radius], "their radii, m"),
    Parameter("known_object_materials", [NO_OBJECT.material], "their materials"),
    *setting_parameters(PerceptionSettings),
]
"""All parameters of the node."""


class PerceptionNode(ManagedNode):
    """Topics around `PerceptionPipeline`."""

    def __init__(self) -> None:
        super().__init__("perception_node", PARAMETERS, warm_up)

    def configure(self) -> None:
        """Make the pipeline, which has no environment yet, and the environment's publishers."""
        values = self.values()
        settings = settings_from_values(values | {FRAME: self._frame_id(values[FRAME])})
        self._revision = ThreadPoolExecutor(1, "revision of the environment")
        self._pipeline = PerceptionPipeline(
            settings, np.random.default_rng(values["seed"]), background=self._revision
        )
        self._rebuild, self._last_time = False, -np.inf
        self._sensor_frame = ""
        self._newest: tuple[Header, FrameResult] | None = None
        self._hung: RigidTransform | None = None
        self._stamps: dict[float, StampSeconds] = {}
        self._frames = self._restarts = self._moves = self._late_before = 0
        self._cameras = ["", *_further_cameras(values["further_cameras"], values["fixed_frame"])]
        self._transforms: Transforms | None = None
        self._environment = EnvironmentPublisher(self)
        self._fixed = FixedFrame(values["fixed_frame"])
        self._frame = PublishedFrame(values["target_frame"] or self._fixed.name)

    def activate(self) -> None:
        """Subscribe to frames and publish what is perceived in them."""
        values = self.values()
        self._outputs = Outputs(self)
        self._detections: Publisher | None = None
        if values["publish_detections"]:
            self._offer_detections()
        if values["fixed_frame"] or values["target_frame"]:
            self._transforms = Transforms(self)
        self._fixed.listen(self._transforms)
        self._frame.listen(self._transforms)
        if self._pipeline.settings.gravity_source == "imu":
            self._make_imu(values["imu_orientation"])
        self._input = CameraInputs(self._cameras, values["reordering_time"])
        for camera in self._cameras:
            frames = FrameInput(
                self,
                self.diagnostics,
                camera,
                partial(self._input.put, camera),
                kinds=INPUTS[values["input"]],
                is_placed=bool(values["fixed_frame"]),
                rectified=values["image_is_rectified"],
                color=values["use_color"],
                row_time=values["row_readout_time"],
                kernels=self.kernels,
                use=self._perceive,
            )
            self._input.add(camera, frames)
        self.diagnostics.add("environment", self._check_environment)
        self.diagnostics.add("pose of the sensor", self._check_sensor)
        for camera in self._cameras[1:]:
            self.diagnostics.add(f"pose of {camera}", partial(self._check_pose, camera))
        self.diagnostics.add("frame of what is published", self._frame.check)
        self.diagnostics.add("frames", self._check_frames)
        self.create_service(Trigger, "~/rebuild_environment", self._on_rebuild)
        self.create_timer(1.0 / values[MARKER_RATE.name], self._on_marker_tick)

    def deactivate(self) -> None:
        """Stop the worker and publish what it had under way; the environment stays known."""
        if self._input.stop(self.patience()):
            self._publish_observations(self._pipeline.finish())
        else:
            self.get_logger().warning("the frame under way did not end in time and is left behind")
        farewell([self._outputs.observations, *self._environment.publishers])

    def cleanup(self) -> None:
        """Forget the environment."""
        self._revision.shutdown(wait=False, cancel_futures=True)
        self._environment.destroy()
        del self._pipeline

    def _frame_id(self, given: str) -> str:
        """Put the frame's default name below the namespace: each robot has its own."""
        namespace = self.get_namespace().strip("/")
        return f"{namespace}/{given}" if namespace and given == DEFAULT_FRAME else given

    def _offer_detections(self) -> None:
        try:
            from vision_msgs.msg import Detection3DArray
        except ImportError:
            raise InvalidInputError(
                "publish_detections is true, but vision_msgs is not installed; expected it "
                "(sudo apt install ros-jazzy-vision-msgs)"
            ) from None
        self._detections = self.create_publisher(
            Detection3DArray,
            DETECTIONS,
            10,
            qos_overriding_options=QOS_OVERRIDES,
        )

    def _make_imu(self, orientation: list[float]) -> None:
        self._accelerometer = RestingAccelerometer()
        if len(orientation) != 4:
            raise InvalidInputError(
                f"imu_orientation has {len(orientation)} numbers; expected x, y, z and w"
            )
        rotation = unit_quaternion(orientation, "imu_orientation") if any(orientation) else None
        imu = ImuInput(self, "~/imu", lambda: self._sensor_frame, self._on_imu, rotation)
        self.diagnostics.add("imu", imu.monitor.check)

    def _on_imu(
        self,
        time: float,
        acceleration: NDArray[np.float64],
        angular_velocity: NDArray[np.float64] | None,
    ) -> None:
        self._accelerometer.add(time, acceleration, angular_velocity)
        if self._accelerometer.up is not None:
            self._pipeline.take_up(self._accelerometer.up)

    def _on_rebuild(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._rebuild = True
        response.success = True
        response.message = (
            "the environment is modelled again from the next "
            f"{self._pipeline.settings.environment_frames} frames"
        )
        return response

    def _perceive(self, frame: DecodedFrame) -> str:
        """Perceive one frame; runs in the input's thread. Return why it could not be used."""
        camera, header = frame.camera, frame.header
        if not camera:
            self._sensor_frame = header.frame_id
        if self._rebuild:
            self._rebuild = False
            self._publish_observations(self._pipeline.rebuild_environment())
        time = seconds_from_stamp(header.stamp)
        self._stamps[time] = time
        if len(self._stamps) > KEPT_STAMPS:
            del self._stamps[next(iter(self._stamps))]
        if self._transforms is not None and time < self._last_time:
            self._transforms.forget()
        self._last_time = time
        try:
            pose = self._fixed.sensor_pose(header)
            points = self._fixed.as_of_stamp(header, frame.points, frame.offsets, pose)
        except UnknownTransformError as error:
            return str(error)
        result = self._pipeline.process(points, time, frame.colors, pose, camera, frame.offsets)
        self._frames += 1
        if result.restarted:
            self._restarts += 1
            self.get_logger().warning("time went back: tracking starts again")
        if result.moved:
            self._moves += 1
            of = f"camera {camera}: " if camera else ""
            self.get_logger().warning(f"{of}{result.moved}")
        if result.revised:
            self.get_logger().info(result.revised)
        if result.model is not None:
            if not camera:
                self._publish_environment(header, result, pose)
            if self._frame.is_known and not result.diagnostics.problem:
                self._publish_states(header, time, result)
        # Observations take longer than a frame, and nobody waits for them as for the states.
        self._publish_observations(result.observations)
        self._newest = (header, result)
        return result.diagnostics.problem or self._frame.problem

    def _publish_environment(
        self, header: Header, result: FrameResult, pose: RigidTransform | None
    ) -> None:
        """Publish the environment where it is new, or new in the frame of what is published."""
        model = result.model
        if model is None:
            return
        # Without a given pose the sensor's frame moves where the sensor does.
        if result.is_new_model or (pose is None and model.sensor_pose is not self._hung):
            self._fixed.hang(self._environment, model, header, pose)
            self._hung = model.sensor_pose
        if self._frame.follow(header, model):
            environment = self._frame.environment()
            self._environment.publish(
                environment, camera=header, camera_pose=self._frame.camera_pose
            )
            if result.is_new_model:
                self.get_logger().info(
                    f"environment {self._environment.version} has {len(environment.planes)} planes "
                    f"and {len(environment.boxes)} boxes"
                )

    def _publish_states(self, header: Header, time: float, result: FrameResult) -> None:
        objects = [item.object for item in result.objects]
        states = [self._frame.state(item.state) for item in result.objects]
        detections = [self._frame.detection(item.detection) for item in result.objects]
        stamp = header.stamp if result.time == time else stamp_from_seconds(result.time)
        header = Header(stamp=stamp, frame_id=self._frame.name)
        self._outputs.publish_states(header, objects, states, detections)
        if self._detections is not None:
            self._detections.publish(detections_to_message(objects, states, header))

    def _publish_observations(self, observations: tuple[Observation, ...]) -> None:
        for observation in observations:
            if not self._frame.is_known:
                names = object_names(observation)
                self.get_logger().warning(f"observed {names}, which is lost: {self._frame.problem}")
                continue
            start = self._stamps.get(observation.start_time, observation.start_time)
            placed = self._frame.observation(observation)
            self._outputs.publish_observation(replace(placed, start_time=start))

    def _on_marker_tick(self) -> None:
        if self._newest is None or not self._outputs.has_viewer:
            return
        header, result = self._newest
        if result.model is not None:
            self._outputs.publish_markers(
                header.stamp,
                result.model.seen_environment(),
                [item.object for item in result.objects],
                [item.state for item in result.objects],
                [item.color for item in result.objects],
            )

    def _check_environment(self) -> Status:
        result = self._newest[1] if self._newest else None
        model = result.model if result else None
        values: dict[str, object] = {
            "version": self._environment.version,
            "times the sensor was moved": self._moves,
        }
        if model is None:
            problem = result.diagnostics.problem if result else ""
            return Status(Level.WARN, problem or "not modelled yet", values)
        values |= {
            "planes": len(model.detected),
            "planes with edges": sum(plane.boundary is not None for plane in model.detected),
            "boxes": len(model.environment.boxes),
            "points of the support": model.detected[0].support if model.has_support else 0,
            "sensor above it (m)": f"{model.translation[2]:.3f}",
            "range noise at 2 m (mm)": f"{1e3 * model.noise.deviation(2.0):.1f}",
        }
        if model.gravity_doubt:
            return Status(Level.WARN, model.gravity_doubt, values)
        return Status(Level.OK, f"{len(model.detected)} planes", values)

    def _check_sensor(self) -> Status:
        """Say whether it is known where the first sensor is."""
        motion = self._pipeline.sensor_motion
        if self._fixed.name or motion is None:
            return self._fixed.check()
        values = {"what its view does not show": motion.unseen or "nothing"}
        if motion.doubt:
            return Status(
                Level.WARN, f"how the sensor has moved is not known: {motion.doubt}", values
            )
        shift, angle = RigidTransform().difference(motion.way)
        return Status(
            Level.OK,
            f"by what it sees the sensor has moved by {100.0 * shift:.1f} cm and "
            f"{np.degrees(angle):.1f}° since the environment was modelled",
            values,
        )

    def _check_pose(self, camera: str) -> Status:
        """Say whether a further camera's pose fits what it and the first camera see."""
        doubt = self._pipeline.further_doubt(camera)
        if doubt:
            return Status(Level.WARN, doubt)
        return Status(Level.OK, "nothing shows that it is wrong")

    def _check_frames(self) -> Status:
        diagnostics = self._newest[1].diagnostics if self._newest else FrameDiagnostics()
        late, self._late_before = self._input.late - self._late_before, self._input.late
        values = {
            "handled": self._frames,
            "dropped": self._input.dropped,
            "late": self._input.late,
            "restarts": self._restarts,
            "clusters that wait": diagnostics.waiting,
            **{f"{name} (ms)": f"{1e3 * s:.1f}" for name, s in diagnostics.seconds.items()},
        }
        if diagnostics.problem:
            return Status(Level.WARN, diagnostics.problem, values)
        if late:
            return Status(
                Level.WARN,
                f"{late} frames came after later ones of other cameras had been handled; expected "
                "them within reordering_time",
                values,
            )
        if not self._frames:
            return Status(Level.OK, "no frame was handled yet", values)
        took = 1e3 * sum(diagnostics.seconds.values())
        return Status(Level.OK, f"the last frame took {took:.0f} ms", values)


def _further_cameras(names: list[str], fixed_frame: str) -> list[str]:
    """Return the names of further cameras once they are known to be good."""
    further = [name for name in names if name]
    good = all(NAME.fullmatch(name) for name in further) and len(set(further)) == len(further)
    if not good:
        raise InvalidInputError(
            f"further_cameras is {further}; expected names that differ, of letters, digits and _"
        )
    if further and not fixed_frame:
        raise InvalidInputError(
            f"further_cameras is {further} and fixed_frame is empty; expected the frame in which "
            "tf has the pose of each camera"
        )
    return further


def main() -> int:
    """Run the node until it is stopped."""
    return run_node(PerceptionNode)
