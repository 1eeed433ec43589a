"""The perception node as a process, over DDS: a throw, and everything that can go wrong.

The tests of the camera are one session with one node, in their order: what an earlier one has shown
is known to later ones, which therefore fail when they are run alone.
"""

from __future__ import annotations

import array
import signal
from io import BytesIO

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Vector3
from intuitive_physics_msgs.msg import Environment as EnvironmentMessage
from intuitive_physics_msgs.msg import ObjectStates, Observation
from PIL import Image as PngImage
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, Imu, PointCloud2
from std_msgs.msg import Header
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray

from intuitive_physics_ros.conversions import (
    environment_from_message,
    object_states_from_messages,
    observation_from_message,
    seconds_from_stamp,
    stamp_from_seconds,
)
from intuitive_physics_ros.qos import LATCHED, OBSERVATIONS, SENSOR_DATA
from intuitive_physics_ros.scripting import NodeProcess, Peer

from .camera_messages import (
    FRAMES,
    STEP,
    cloud_message,
    image_message,
    info_message,
    play,
    play_answered,
    play_until,
    says,
    show_until,
    throw,
)

MODULE = "intuitive_physics_perception.nodes.perception_node"
NODE = "/perception_node"
PARAMETERS = ["-p", f"environment_frames:={FRAMES}", "-p", "known_object_names:=[rubber]"]
PARAMETERS += ["-p", "use_color:=true"]
PARAMETERS += ["-p", "known_object_radii:=[0.07]", "-p", "known_object_materials:=[rubber]"]


@pytest.fixture(scope="module")
def node():
    with NodeProcess(MODULE, PARAMETERS) as process:
        yield process


@pytest.fixture
def peer(node):
    with Peer("tester") as peer:
        yield peer
    node.check_running()
    assert "Traceback" not in node.output


@pytest.fixture(scope="module")
def room(make_small_room):
    return make_small_room(tilt=25.0, seed=5)


@pytest.fixture
def images(peer):
    return peer.publisher(Image, f"{NODE}/depth/image", SENSOR_DATA)


def exact(stamp: Time) -> tuple[int, int]:
    return stamp.sec, stamp.nanosec


def test_images_without_camera_info_are_named_and_then_used(peer, images, node, room) -> None:
    heard = peer.listen(DiagnosticArray, "/diagnostics")
    empty = room.depth()
    show_until(
        peer,
        images,
        empty,
        1.0,
        lambda: says(heard, "depth/image", "without a CameraInfo"),
        "a diagnostic of images",
    )
    infos = peer.publisher(CameraInfo, f"{NODE}/depth/camera_info", SENSOR_DATA)
    for message, text in (
        (CameraInfo(width=4, height=4), "focal length fx"),
        (info_message(room), "arrives"),
    ):
        heard.clear()
        play_until(
            peer,
            infos,
            lambda _, message=message: message,
            lambda text=text: says(heard, "depth/camera_info", text),
            f"{text!r} in the diagnostics",
        )
    assert node.output.count("without a CameraInfo") == 1


def test_a_throw_gives_environment_states_and_one_observation(peer, images, node, room) -> None:
    environments = peer.listen(EnvironmentMessage, "intuitive_physics/environment", LATCHED)
    states = peer.listen(ObjectStates, "intuitive_physics/object_states", SENSOR_DATA)
    observations = peer.listen(Observation, "intuitive_physics/observations", OBSERVATIONS)
    markers = peer.listen(MarkerArray, f"{NODE}/markers")
    empty = room.depth()
    show_until(peer, images, empty, 50.0, lambda: environments, "an environment")
    # Stamps that no double of seconds holds.
    start, step = 1_795_000_000_000_000_007, round(1e9 * STEP) + 1
    stamps = [divmod(start + step * k, 1_000_000_000) for k in range(len(throw(room)))]
    times = [seconds_from_stamp(Time(sec=sec, nanosec=nanosec)) for sec, nanosec in stamps]
    assert any(stamp_from_seconds(float(time)) != stamp_from_seconds(time) for time in times)
    thrown = [image_message(d, t) for d, t in zip(throw(room), times, strict=True)]
    play_answered(peer, images, thrown, states)
    peer.spin_until(lambda: observations, "an observation")

    message = environments[-1]
    environment = environment_from_message(message)
    assert (message.header.frame_id, message.camera_frame_id) == (
        "intuitive_physics/environment",
        "camera",
    )
    assert message.version >= 1
    assert len(environment.planes) == 3
    assert environment.gravity == pytest.approx([0, 0, -9.81])
    assert message.camera_pose.position.z == pytest.approx(room.height, abs=0.01)

    seen = [object_states_from_messages(message.objects) for message in states]
    flying = [s[0] for objects, s in seen if objects]
    assert len(flying) >= 5
    assert np.linalg.norm(flying[3].linear_velocity) > 0.5
    assert states[-1].header.frame_id == "intuitive_physics/environment"

    observation = observation_from_message(observations[-1])
    (ball,) = observation.objects
    assert ball.object.material == "rubber"
    assert ball.object.id.startswith("rubber_")
    assert ball.object.shape.bounding_radius == pytest.approx(0.07, abs=0.001)
    assert times[0] < observation.start_time < times[-1]
    made_of_images = [*states[-5:], *observations, observations[-1].environment]
    assert {exact(message.header.stamp) for message in made_of_images} <= set(stamps)
    peer.spin_until(lambda: markers, "markers")
    kinds = {marker.ns for marker in markers[-1].markers}
    assert {"environment", "gravity"} <= kinds


def test_a_late_learner_still_gets_environment_and_observations(peer) -> None:
    environments = peer.listen(EnvironmentMessage, "intuitive_physics/environment", LATCHED)
    observations = peer.listen(Observation, "intuitive_physics/observations", OBSERVATIONS)
    peer.spin_until(lambda: environments and observations, "what was published before")


def test_time_that_jumps_back_restarts_the_tracker(peer, images, node, room) -> None:
    observations = peer.listen(Observation, "intuitive_physics/observations", OBSERVATIONS)
    peer.spin_until(lambda: observations, "the first observation")
    before = len(observations)
    states = peer.listen(ObjectStates, "intuitive_physics/object_states", SENSOR_DATA)
    thrown = [image_message(d, 20.0 + STEP * k) for k, d in enumerate(throw(room))]
    play_answered(peer, images, thrown, states)
    peer.spin_until(lambda: len(observations) > before, "an observation of the second run")
    assert "time went back" in node.output
    ids = [seen.initial_state.id for message in observations for seen in message.objects]
    assert len(set(ids)) == len(ids)


def test_an_image_without_readings_is_named_and_the_next_good_one_used(peer, images, room) -> None:
    heard = peer.listen(DiagnosticArray, "/diagnostics")
    states = peer.listen(ObjectStates, "intuitive_physics/object_states", SENSOR_DATA)
    blind, empty = np.zeros((240, 320)), room.depth()
    show_until(
        peer,
        images,
        blind,
        300.0,
        lambda: says(heard, "depth/image", "no reading"),
        "a diagnostic of images",
    )
    show_until(peer, images, empty, 340.0, lambda: states, "states")


def color_message(color, size: tuple[int, int], time: float) -> Image:
    width, height = size
    return Image(
        header=Header(stamp=stamp_from_seconds(time), frame_id="camera"),
        height=height,
        width=width,
        encoding="rgb8",
        step=3 * width,
        data=array.array("B", bytes(color) * (width * height)),
    )


def test_colour_images_show_in_the_markers_and_must_be_registered(peer, images, room) -> None:
    heard = peer.listen(DiagnosticArray, "/diagnostics")
    markers = peer.listen(MarkerArray, f"{NODE}/markers")
    colors = peer.publisher(Image, f"{NODE}/color/image", SENSOR_DATA)
    ball = room.depth([((1.4, 0.0, 0.45), 0.07)])

    def frame(time: float, size: tuple[int, int]) -> Image:
        colors.publish(color_message((0, 255, 0), size, time))
        return image_message(ball, time)

    def is_green() -> bool:
        shown = [m for array in markers for m in array.markers if m.ns == "objects"]
        return any((m.color.r, m.color.g, m.color.b) == (0.0, 1.0, 0.0) for m in shown)

    play_until(
        peer, images, lambda time: frame(360.0 + time, (320, 240)), is_green, "a green marker"
    )
    play_until(
        peer,
        images,
        lambda time: frame(380.0 + time, (160, 120)),
        lambda: says(heard, "color/image", "registered"),
        "a diagnostic of colour images",
    )


def corrupted(rng, message) -> Image:
    """An image message with some of its fields as no camera would send them."""
    sizes = [0, 1, 3, 65535, 2**31, 2**32 - 1, int(rng.integers(2**32))]
    changes = {
        "width": lambda: int(rng.choice(sizes)),
        "height": lambda: int(rng.choice(sizes)),
        "step": lambda: int(rng.choice(sizes)),
        "encoding": lambda: str(rng.choice(["", "32FC1", "bgr8", "16UC1 ", "?" * 500])),
        "is_bigendian": lambda: int(rng.integers(256)),
        "data": lambda: array.array("B", rng.bytes(int(rng.integers(3000)))),
    }
    for name in rng.choice(list(changes), size=rng.integers(1, 4), replace=False):
        setattr(message, name, changes[name]())
    return message


def compressed_message(depth: np.ndarray, time: float) -> CompressedImage:
    file = BytesIO()
    PngImage.fromarray(depth).save(file, "PNG")
    return CompressedImage(
        header=Header(stamp=stamp_from_seconds(time), frame_id="camera"),
        format="16UC1; compressedDepth png",
        data=array.array("B", bytes(12) + file.getvalue()),
    )


def test_compressed_images_are_as_good(peer, room) -> None:
    arguments = [*PARAMETERS, "-p", "input:=compressed", "-r", "__ns:=/packed"]
    with NodeProcess(MODULE, arguments):
        heard = peer.listen(DiagnosticArray, "/diagnostics")
        environments = peer.listen(
            EnvironmentMessage, "/packed/intuitive_physics/environment", LATCHED
        )
        infos = peer.publisher(CameraInfo, f"/packed{NODE}/depth/camera_info", SENSOR_DATA)
        name = "depth/image/compressedDepth"
        images = peer.publisher(CompressedImage, f"/packed{NODE}/{name}", SENSOR_DATA)
        play_until(
            peer,
            infos,
            lambda _: info_message(room),
            lambda: says(heard, "depth/camera_info", "arrives", "packed/perception_node"),
            "a camera",
        )
        play_until(
            peer,
            images,
            lambda time: CompressedImage(format="jpeg"),
            lambda: says(heard, name, "expected 16UC1 or 32FC1", "packed/perception_node"),
            "a diagnostic of images",
        )
        empty = room.depth().astype(np.uint16)
        play_until(
            peer,
            images,
            lambda time: compressed_message(empty, 50.0 + time),
            lambda: environments,
            "an environment",
        )
    assert len(environment_from_message(environments[-1]).planes) == 3


def test_no_image_makes_the_node_fall_or_hang(peer, images, node, room) -> None:
    """Corrupted ones, named once each, and then a good one is perceived."""
    rng = np.random.default_rng(0)
    states = peer.listen(ObjectStates, "intuitive_physics/object_states", SENSOR_DATA)
    infos = peer.publisher(CameraInfo, f"{NODE}/depth/camera_info", SENSOR_DATA)
    empty = room.depth()
    before = node.output.count("rejected")
    for k in range(40):
        message = image_message(empty, 350.0 + STEP * k)
        if k % 4:
            play(peer, images, [corrupted(rng, message)])
        else:
            info = info_message(room)
            info.k = rng.choice([0.0, np.nan, -1.0, 1e300, 300.0], size=9)
            play(peer, infos, [info])
    states.clear()
    show_until(peer, images, empty, 360.0, lambda: states, "states")
    # A few lines at once and then one a second, for each of two topics.
    assert 1 <= node.output.count("rejected") - before < 25
    assert "internal error" not in node.output


def test_a_moved_camera_is_named_and_modelled_again(peer, images, node, make_small_room) -> None:
    environments = peer.listen(EnvironmentMessage, "intuitive_physics/environment", LATCHED)
    peer.spin_until(lambda: environments, "the environment")
    moved = make_small_room(tilt=33.0, height=0.9, seed=6).depth()
    show_until(
        peer,
        images,
        moved,
        380.0,
        lambda: environments[-1].camera_pose.position.z > 0.88,
        "the environment from where the camera stands now",
    )
    assert "the sensor was moved" in node.output
    assert environments[-1].version > environments[0].version


def test_the_environment_can_be_rebuilt(peer, images, room) -> None:
    environments = peer.listen(EnvironmentMessage, "intuitive_physics/environment", LATCHED)
    peer.spin_until(lambda: environments, "the environment")
    version = environments[-1].version
    answer = peer.call(Trigger, f"{NODE}/rebuild_environment", Trigger.Request())
    assert answer.success
    assert f"next {FRAMES} frames" in answer.message
    empty = room.depth()
    show_until(
        peer, images, empty, 400.0, lambda: environments[-1].version > version, "a new environment"
    )


@pytest.fixture(scope="module")
def cloud_node():
    arguments = ["-p", "input:=points", "-p", f"environment_frames:={FRAMES}"]
    with NodeProcess(MODULE, [*arguments, "-r", "__node:=perception_node"]) as process:
        yield process


def test_clouds_bad_and_good(node, cloud_node, room) -> None:
    """One node for clouds; the one for images stops first, as they have one name."""
    node.stop(signal.SIGTERM)
    # Half the resolution: best effort over UDP loses parts of what is larger.
    empty, good = (room.points(balls)[::2, ::2] for balls in ((), [((1.5, 0.0, 0.4), 0.07)]))
    bad = [
        ("no reading", np.zeros((1, 0, 3)), {}),
        ("truncated", good, {"height": 500}),
    ]
    clock = iter(np.arange(1.0, 1000.0, STEP))
    with Peer("tester") as peer:
        heard = peer.listen(DiagnosticArray, "/diagnostics")
        states = peer.listen(ObjectStates, "intuitive_physics/object_states", SENSOR_DATA)
        clouds = peer.publisher(PointCloud2, f"{NODE}/points", SENSOR_DATA)

        def send(points, **changes) -> None:
            play(peer, clouds, [cloud_message(points, next(clock), **changes)])

        for text, points, changes in bad:
            heard.clear()

            def named(points=points, changes=changes, text=text) -> bool:
                send(points, **changes)
                return any(text in s.message for message in heard for s in message.status)

            peer.spin_until(named, f"{text!r} in the diagnostics")
        for _ in range(2 * FRAMES):
            send(empty)

        def seen() -> bool:
            send(good)
            return any(message.objects for message in states)

        peer.spin_until(seen, "a ball")
    cloud_node.check_running()
    assert "Traceback" not in cloud_node.output
    assert cloud_node.stop(signal.SIGINT) == 0


def imu_message(up, time: float) -> Imu:
    x, y, z = (9.81 * np.asarray(up)).tolist()
    return Imu(
        header=Header(stamp=stamp_from_seconds(time), frame_id="imu"),
        linear_acceleration=Vector3(x=x, y=y, z=z),
    )


def test_gravity_is_that_of_the_imu(room) -> None:
    """An IMU turned by 90° about the camera's x axis; nothing is modelled before it has rested."""
    half = float(np.sqrt(0.5))
    arguments = ["-p", "gravity_source:=imu", "-p", f"imu_orientation:=[{half}, 0.0, 0.0, {half}]"]
    arguments += ["-p", f"environment_frames:={FRAMES}"]
    up = room.rotation.T @ [0.0, np.sin(np.radians(3.0)), np.cos(np.radians(3.0))]
    in_imu = np.array([up[0], up[2], -up[1]])
    empty = room.depth()
    with NodeProcess(MODULE, arguments) as process, Peer("tester") as peer:
        heard = peer.listen(DiagnosticArray, "/diagnostics")
        environments = peer.listen(EnvironmentMessage, "intuitive_physics/environment", LATCHED)
        infos = peer.publisher(CameraInfo, f"{NODE}/depth/camera_info", SENSOR_DATA)
        images = peer.publisher(Image, f"{NODE}/depth/image", SENSOR_DATA)
        imus = peer.publisher(Imu, f"{NODE}/imu", SENSOR_DATA)

        def frame(time: float) -> Image:
            infos.publish(info_message(room))
            return image_message(empty, 1.0 + time)

        play_until(
            peer, images, frame, lambda: says(heard, "environment", "IMU that has rested"), "a wait"
        )
        assert not environments
        no_gravity = imu_message([0.0, 0.0, 0.0], 1.0)
        play_until(
            peer, imus, lambda _: no_gravity, lambda: says(heard, "imu", "gravity in it"), "why not"
        )

        def sample_and_frame(time: float) -> Image:
            imus.publish(imu_message(in_imu, 5.0 + time))
            return frame(100.0 + time)

        play_until(peer, images, sample_and_frame, lambda: environments, "an environment")
        process.check_running()
        assert "Traceback" not in process.output
    environment = environment_from_message(environments[-1])
    assert environment.gravity == pytest.approx([0, 0, -9.81])
    support = environment.planes[0].normal
    assert np.degrees(np.arccos(support[2])) == pytest.approx(3.0, abs=0.2)


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["-p", "gravity_source:=imu", "-p", "imu_orientation:=[1.0]"], "1 numbers"),
        (["-p", "min_radius:=0.9"], "min_radius below max_radius"),
        (["-p", "known_object_names:=[a, b]"], "[2, 1, 1] entries"),
        (["-p", "input:=radar"], "auto, depth, compressed, points"),
        (["-p", "further_cameras:=[left]"], "fixed_frame is empty"),
        (["-p", "further_cameras:=[a, a]", "-p", "fixed_frame:=map"], "names that differ"),
    ],
)
def test_parameters_that_cannot_be_are_one_line(arguments, text) -> None:
    with NodeProcess(MODULE, arguments) as process:
        assert process.wait(20.0) == 1
        assert text in process.output
        assert "Traceback" not in process.output
