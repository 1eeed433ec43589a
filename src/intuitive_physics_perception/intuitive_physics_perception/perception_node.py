"""The perception node: depth images or clouds in; environment, states and observations out."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import partial
from typing import Any

import numpy as np
from geometry_msgs.msg import TransformStamped
from intuitive_physics_msgs.msg import Environment as EnvironmentMessage
from intuitive_physics_msgs.msg import ObjectStates
from intuitive_physics_msgs.msg import Observation as ObservationMessage
from numpy.typing import NDArray
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from std_msgs.msg import ColorRGBA, Header
from std_srvs.srv import Trigger
from visualization_msgs.msg import Marker, MarkerArray

from intuitive_physics.errors import IntuitivePhysicsError, InvalidInputError
from intuitive_physics.observation import Observation
from intuitive_physics.scene import Environment, Plane
from intuitive_physics_perception.compile import warm_up
from intuitive_physics_perception.depth import (
    Field,
    Intrinsics,
    depth_from_image_data,
    points_from_cloud_data,
    points_from_depth,
)
from intuitive_physics_perception.environment_model import EnvironmentModel
from intuitive_physics_perception.frame_worker import FrameWorker
from intuitive_physics_perception.pipeline import Perceived, PerceptionPipeline
from intuitive_physics_perception.settings import KnownObject, PerceptionSettings
from intuitive_physics_ros.conversions import (
    environment_to_message,
    object_states_to_message,
    observation_to_message,
    seconds_from_stamp,
)
from intuitive_physics_ros.conversions.geometry import (
    point_to_message,
    pose_to_message,
    quaternion_to_message,
    vector_to_message,
)
from intuitive_physics_ros.diagnostics import Diagnostics, Level, Status
from intuitive_physics_ros.input_monitor import InputMonitor
from intuitive_physics_ros.markers import clearing_marker, environment_markers, object_markers
from intuitive_physics_ros.parameters import Parameter, declare_parameters
from intuitive_physics_ros.qos import LATCHED, SENSOR_DATA
from intuitive_physics_ros.run_node import run_node

INPUTS: dict[str, tuple[str, ...]] = {
    "auto": ("~/depth/image", "~/points"),
    "depth": ("~/depth/image",),
    "points": ("~/points",),
}
"""Topics that each value of the parameter `input` subscribes."""

OBSERVATIONS = QoSProfile(
    depth=50,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
"""Finished observations: a learner that starts late still gets the last ones."""

INPUT_TIMEOUT = 2.0
GRAVITY_ARROW_LENGTH = 0.3

NO_OBJECT = KnownObject("none", 1.0, "none")
"""Stands in the lists of known objects, which ROS cannot have empty, when there are none."""

OWN_PARAMETERS = [
    Parameter("input", "auto", "what is subscribed to", choices=tuple(INPUTS)),
    Parameter("seed", 0, "seed of the random choices of RANSAC", (0, 2**31 - 1)),
    Parameter(
        "image_is_rectified",
        False,
        "take the camera matrix from P and no distortion, instead of K and D",
    ),
    Parameter("marker_rate", 5.0, "RViz marker messages a second", (0.1, 100.0)),
    Parameter("up_hint", [0.0, 0.0, 0.0], "roughly upward in the sensor's frame; zeros: none"),
    Parameter("known_object_names", [NO_OBJECT.name], "names of objects known by their radius"),
    Parameter("known_object_radii", [NO_OBJECT.radius], "their radii, m"),
    Parameter("known_object_materials", [NO_OBJECT.material], "their materials"),
]


def setting_parameters() -> list[Parameter]:
    """Return a parameter for each of the library's settings that is a number, word or choice."""
    return [
        Parameter(
            setting.name,
            setting.default,
            setting.metadata["description"],
            (setting.metadata["lower"], setting.metadata["upper"])
            if "lower" in setting.metadata
            else None,
        )
        for setting in fields(PerceptionSettings)
        if isinstance(setting.default, bool | int | float | str)
    ]


def settings_from_parameters(values: dict[str, Any]) -> PerceptionSettings:
    """Return the library's settings from the node's parameters by name.

    Raises
    ------
    InvalidInputError
        When the lists of known objects differ in length or a value is out of range.
    """
    columns = [list(values[f"known_object_{name}"]) for name in ("names", "radii", "materials")]
    if len({len(column) for column in columns}) != 1:
        raise InvalidInputError(
            f"known_object_names, _radii and _materials have {[len(c) for c in columns]} entries; "
            "expected as many of each"
        )
    known = [KnownObject(*row) for row in zip(*columns, strict=True)]
    hint = tuple(values["up_hint"])
    if len(hint) != 3:
        raise InvalidInputError(f"up_hint has {len(hint)} numbers; expected x, y and z")
    return PerceptionSettings(
        up_hint=hint if any(hint) else None,
        known_objects=() if known == [NO_OBJECT] else tuple(known),
        **{parameter.name: values[parameter.name] for parameter in setting_parameters()},
    )


@dataclass(frozen=True)
class _Camera:
    """The newest CameraInfo, kept as the rays of its pixels."""

    key: tuple[Any, ...]
    rays: NDArray[np.float32]


class PerceptionNode(Node):
    """Topics and a worker thread around `PerceptionPipeline`."""

    def __init__(self) -> None:
        super().__init__("perception_node")
        values = declare_parameters(self, [*OWN_PARAMETERS, *setting_parameters()])
        settings = settings_from_parameters(values)
        self._rectified = values["image_is_rectified"]
        self._pipeline = PerceptionPipeline(settings, np.random.default_rng(values["seed"]))
        self._input = values["input"]
        self._kind: type | None = None
        self._camera: _Camera | None = None
        self._rebuild = False
        self._model: EnvironmentModel | None = None
        self._version = 0
        self._frames = 0
        self._restarts = 0
        self._problem = ""
        self._seconds: dict[str, float] = {}
        self._newest: tuple[Header, Perceived] | None = None
        self._make_publishers()
        self._worker: FrameWorker[Image | PointCloud2] = FrameWorker(warm_up, self._handle)
        self._make_inputs()
        self.create_service(Trigger, "~/rebuild_environment", self._on_rebuild)
        self.create_timer(1.0 / values["marker_rate"], self._on_marker_tick)

    def destroy_node(self) -> None:
        """Stop the worker and publish what it had under way."""
        self._worker.stop()
        for observation in self._pipeline.finish():
            self._publish_observation(observation)
        super().destroy_node()

    def _make_publishers(self) -> None:
        self._environment = self.create_publisher(EnvironmentMessage, "~/environment", LATCHED)
        self._states = self.create_publisher(ObjectStates, "~/object_states", SENSOR_DATA)
        self._observations = self.create_publisher(
            ObservationMessage, "~/observation", OBSERVATIONS
        )
        self._markers = self.create_publisher(MarkerArray, "~/markers", 1)
        try:
            from tf2_msgs.msg import TFMessage
        except ImportError:
            self._transforms = None
        else:
            self._transforms = self.create_publisher(TFMessage, "/tf_static", LATCHED)

    def _make_inputs(self) -> None:
        kinds = {"~/depth/image": Image, "~/points": PointCloud2}
        self._monitors: dict[type, InputMonitor] = {}
        diagnostics = Diagnostics(self)
        for topic in INPUTS[self._input]:
            monitor = InputMonitor(self, topic, INPUT_TIMEOUT)
            self._monitors[kinds[topic]] = monitor
            diagnostics.add(topic.removeprefix("~/"), partial(self._check_input, kinds[topic]))
            self.create_subscription(kinds[topic], topic, self._worker.put, SENSOR_DATA)
        if "~/depth/image" in INPUTS[self._input]:
            self._info_monitor = InputMonitor(self, "~/depth/camera_info", None)
            diagnostics.add("depth/camera_info", self._info_monitor.check)
            self.create_subscription(
                CameraInfo, "~/depth/camera_info", self._on_camera_info, SENSOR_DATA
            )
        diagnostics.add("environment", self._check_environment)
        diagnostics.add("frames", self._check_frames)

    def _on_camera_info(self, message: CameraInfo) -> None:
        matrix = np.reshape(message.p, (3, 4))[:, :3] if self._rectified else message.k
        distortion = () if self._rectified else message.d
        key = (
            message.width,
            message.height,
            tuple(np.ravel(matrix)),
            tuple(distortion),
            message.distortion_model,
        )
        if self._camera is not None and self._camera.key == key:
            self._info_monitor.accepted()
            return
        try:
            camera = Intrinsics(
                message.width, message.height, matrix, distortion, message.distortion_model
            )
            self._camera = _Camera(key, camera.rays())
        except IntuitivePhysicsError as error:
            self._info_monitor.rejected(error)
        else:
            self._info_monitor.accepted()

    def _on_rebuild(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._rebuild = True
        response.success = True
        response.message = (
            "the environment is modelled anew from the next "
            f"{self._pipeline.settings.environment_frames} frames"
        )
        return response

    def _handle(self, message: Image | PointCloud2) -> None:
        """Perceive one frame; runs in the worker's thread."""
        monitor = self._monitors[type(message)]
        if self._kind is not None and type(message) is not self._kind:
            # With `auto` the input that was good first stays: both show the same scene.
            return
        try:
            points = self._image_points(message) if isinstance(message, Image) else _points(message)
            if self._kind is None:
                self._kind = type(message)
                self.get_logger().info(f"perceives {self._kind.__name__} messages")
            if self._rebuild:
                self._rebuild = False
                for observation in self._pipeline.rebuild_environment():
                    self._publish_observation(observation)
            perceived = self._pipeline.process(points, seconds_from_stamp(message.header.stamp))
            self._publish(message.header, perceived)
        except IntuitivePhysicsError as error:
            monitor.rejected(error)
            return
        except Exception as error:
            # A thread that dies would take all perception with it.
            monitor.rejected(f"internal error, please report: {error!r}")
            return
        if perceived.diagnostics.problem:
            monitor.rejected(perceived.diagnostics.problem)
        else:
            monitor.accepted()

    def _image_points(self, message: Image) -> NDArray[np.float32]:
        depth = depth_from_image_data(
            message.data,
            width=message.width,
            height=message.height,
            encoding=message.encoding,
            step=message.step,
            is_bigendian=bool(message.is_bigendian),
        )
        camera = self._camera
        if camera is None:
            raise InvalidInputError(
                "depth images arrive without a CameraInfo on ~/depth/camera_info; "
                "expected one: publish it or remap the topic"
            )
        return points_from_depth(depth, camera.rays)

    def _publish(self, header: Header, perceived: Perceived) -> None:
        self._frames += 1
        self._problem = perceived.diagnostics.problem
        self._seconds = perceived.diagnostics.seconds
        if perceived.restarted:
            self._restarts += 1
            self.get_logger().warning("time went back: what was followed is followed anew")
        if perceived.is_new_model and perceived.model is not None:
            self._publish_environment(header, perceived.model)
        self._model = perceived.model
        for observation in perceived.observations:
            self._publish_observation(observation)
        if perceived.model is not None and not perceived.diagnostics.problem:
            self._states.publish(
                object_states_to_message(
                    [seen.object for seen in perceived.objects],
                    [seen.state for seen in perceived.objects],
                    frame_id=perceived.model.environment.frame_id,
                    stamp=header.stamp,
                )
            )
            self._newest = (header, perceived)

    def _publish_environment(self, header: Header, model: EnvironmentModel) -> None:
        self._version += 1
        pose = pose_to_message(model.translation, model.sensor_orientation())
        self._environment.publish(
            environment_to_message(
                model.environment,
                stamp=header.stamp,
                version=self._version,
                camera_frame_id=header.frame_id,
                camera_pose=pose,
            )
        )
        self.get_logger().info(f"environment {self._version} has {len(model.detected)} planes")
        self._publish_transform(header, model)

    def _publish_transform(self, header: Header, model: EnvironmentModel) -> None:
        """Hang the environment below the sensor's frame, which may have a parent already."""
        if self._transforms is None:
            return
        from tf2_msgs.msg import TFMessage

        transform = TransformStamped(header=header, child_frame_id=model.environment.frame_id)
        x, y, z, w = model.sensor_orientation()
        transform.transform.translation = vector_to_message(-model.translation @ model.rotation)
        transform.transform.rotation = quaternion_to_message((-x, -y, -z, w))
        self._transforms.publish(TFMessage(transforms=[transform]))

    def _publish_observation(self, observation: Observation) -> None:
        self._observations.publish(observation_to_message(observation))
        names = ", ".join(seen.object.id for seen in observation.objects)
        self.get_logger().info(f"observed {names}")

    def _on_marker_tick(self) -> None:
        newest = self._newest
        if newest is None or self._markers.get_subscription_count() == 0:
            return
        header, perceived = newest
        model = perceived.model
        if model is None:
            return
        own = Header(stamp=header.stamp, frame_id=model.environment.frame_id)
        objects, states = (
            zip(*((o.object, o.state) for o in perceived.objects), strict=True)
            if (perceived.objects)
            else ((), ())
        )
        self._markers.publish(
            MarkerArray(
                markers=[
                    clearing_marker(),
                    *environment_markers(shown_environment(model), header.stamp),
                    *object_markers(objects, states, own),
                    gravity_marker(model.environment, own),
                ]
            )
        )

    def _check_input(self, kind: type) -> Status:
        if self._kind is not None and kind is not self._kind:
            return Status(Level.OK, f"not used: {self._kind.__name__} messages came first")
        return self._monitors[kind].check()

    def _check_environment(self) -> Status:
        model = self._model
        if model is None:
            return Status(Level.WARN, self._problem or "not modelled yet")
        values = {
            "version": self._version,
            "planes": len(model.detected),
            "points of the support": model.detected[0].support,
            "sensor above it (m)": f"{model.translation[2]:.3f}",
            "range noise at 2 m (mm)": f"{1e3 * model.noise.deviation(2.0):.1f}",
        }
        return Status(Level.OK, f"{len(model.detected)} planes", values)

    def _check_frames(self) -> Status:
        took = 1e3 * sum(self._seconds.values())
        values = {
            "handled": self._frames,
            "dropped": self._worker.dropped,
            "restarts": self._restarts,
            **{f"{name} (ms)": f"{1e3 * s:.1f}" for name, s in self._seconds.items()},
        }
        if self._problem:
            return Status(Level.WARN, self._problem, values)
        return Status(Level.OK, f"the last frame took {took:.0f} ms", values)


def shown_environment(model: EnvironmentModel) -> Environment:
    """Return the environment with its planes cut to what was seen of them."""
    planes = [
        Plane(plane.id, plane.material, plane.normal, plane.offset, outline)
        for plane, outline in zip(model.environment.planes, model.outlines(), strict=True)
    ]
    return Environment(planes, (), model.environment.gravity, model.environment.frame_id)


def gravity_marker(environment: Environment, header: Header) -> Marker:
    """Return an arrow that ends at the environment's origin and points along gravity."""
    down = environment.gravity / max(float(np.linalg.norm(environment.gravity)), 1e-9)
    return Marker(
        header=header,
        ns="gravity",
        type=Marker.ARROW,
        pose=pose_to_message((0.0, 0.0, 0.0)),
        scale=vector_to_message((0.01, 0.03, 0.05)),
        color=ColorRGBA(r=1.0, a=1.0),
        points=[point_to_message(-GRAVITY_ARROW_LENGTH * down), point_to_message(np.zeros(3))],
    )


def _points(message: PointCloud2) -> NDArray[np.float32]:
    return points_from_cloud_data(
        message.data,
        width=message.width,
        height=message.height,
        point_step=message.point_step,
        row_step=message.row_step,
        fields=[Field(f.name, f.offset, f.datatype, f.count) for f in message.fields],
        is_bigendian=bool(message.is_bigendian),
    )


def main() -> int:
    """Run the node until it is told to stop."""
    return run_node(PerceptionNode)
