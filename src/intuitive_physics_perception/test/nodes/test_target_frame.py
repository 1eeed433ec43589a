"""Perception publishes in a frame of the user's, by the real tf2."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from intuitive_physics_msgs.msg import Environment as EnvironmentMessage
from intuitive_physics_msgs.msg import ObjectStates, Observation
from sensor_msgs.msg import CameraInfo, Image
from tf2_msgs.msg import TFMessage
from vision_msgs.msg import Detection3DArray

from intuitive_physics.frames.change_of_frame import RigidTransform
from intuitive_physics.messages.geometry import xyz, xyzw
from intuitive_physics_ros.conversions import (
    environment_from_message,
    object_states_from_messages,
    observation_from_message,
    seconds_from_stamp,
)
from intuitive_physics_ros.qos import LATCHED, OBSERVATIONS, SENSOR_DATA
from intuitive_physics_ros.scripting import NodeProcess, Peer

from ..conftest import Head
from .camera_messages import (
    FRAMES,
    STEP,
    image_message,
    info_message,
    play,
    play_answered,
    play_until,
    throw,
    transform_stamped,
)

pytestmark = pytest.mark.needs("tf2_msgs", "tf2_ros", "vision_msgs")

MODULE = "intuitive_physics_perception.nodes.perception_node"
NODE = "/perception_node"
PARAMETERS = ["-p", f"environment_frames:={FRAMES}", "-p", "target_frame:=base_link"]
PARAMETERS += ["-p", "publish_detections:=true"]

BASE = RigidTransform((2.0, -1.0, 0.3), (0.0, 0.0, np.sin(0.4), np.cos(0.4)))
"""The robot's orientation in the room: turned about the vertical."""


@pytest.fixture
def parameters() -> list[str]:
    return PARAMETERS


@pytest.fixture
def node(parameters) -> Iterator[NodeProcess]:
    with NodeProcess(MODULE, parameters) as process:
        yield process
    assert "Traceback" not in process.output


@pytest.fixture
def peer(node) -> Iterator[Peer]:
    with Peer("tester") as peer:
        yield peer
        node.check_running()


@pytest.fixture(scope="module")
def room(make_small_room):
    return make_small_room(tilt=25.0, seed=5)


def camera_in(base: RigidTransform, room) -> RigidTransform:
    """Pose of the camera in the robot's frame."""
    return base.inverse.after(room.pose)


def transform_message(pose: RigidTransform, time: float = 0.0) -> TFMessage:
    return TFMessage(transforms=[transform_stamped("base_link", "camera", pose, time)])


def test_environment_states_and_observations_are_in_the_target_frame(peer, node, room) -> None:
    environments = peer.listen(EnvironmentMessage, "intuitive_physics/environment", LATCHED)
    states = peer.listen(ObjectStates, "intuitive_physics/object_states", SENSOR_DATA)
    observations = peer.listen(Observation, "intuitive_physics/observations", OBSERVATIONS)
    detections = peer.listen(Detection3DArray, "intuitive_physics/detections")
    heard = peer.listen(DiagnosticArray, "/diagnostics")
    images = peer.publisher(Image, f"{NODE}/depth/image", SENSOR_DATA)
    infos = peer.publisher(CameraInfo, f"{NODE}/depth/camera_info", SENSOR_DATA)
    infos.publish(info_message(room))
    empty = room.depth()

    def told(text: str) -> bool:
        return any(text in one.message for message in heard for one in message.status)

    def look(time: float) -> Image:
        infos.publish(info_message(room))
        return image_message(empty, 1.0 + time)

    play_until(peer, images, look, lambda: told("tf does not know where 'camera'"), "what lacks")
    assert not environments
    assert not states
    tf = peer.publisher(TFMessage, "/tf_static", LATCHED)
    tf.publish(transform_message(camera_in(BASE, room)))
    later = 50.0
    play_until(
        peer, images, lambda time: image_message(empty, later + time), lambda: environments, "it"
    )
    play_answered(
        peer,
        images,
        [image_message(d, 200.0 + STEP * k) for k, d in enumerate(throw(room))],
        states,
    )
    peer.spin_until(lambda: observations, "an observation")
    peer.spin_until(
        lambda: detections and detections[-1].header.stamp == states[-1].header.stamp,
        "detections of the newest states",
    )

    message = environments[-1]
    environment = environment_from_message(message)
    assert (message.header.frame_id, message.camera_frame_id) == ("base_link", "camera")
    place = message.camera_pose.position
    assert [place.x, place.y, place.z] == pytest.approx(camera_in(BASE, room).translation)
    # The room's floor is z = 0, which is 0.3 m below the robot's origin.
    floor = environment.planes[0]
    assert floor.normal == pytest.approx([0, 0, 1], abs=0.01)
    assert floor.signed_distances(BASE.inverse.points([1.0, 0.0, 0.0])) == pytest.approx(
        0, abs=0.01
    )
    assert environment.gravity == pytest.approx([0, 0, -9.81], abs=0.1)

    # The ball starts at (1.4, -0.4, 0.5) with (0.4, 0.9, 1.2) m/s in the room, which it flies
    # through on a parabola.
    assert {one.header.frame_id for one in states} == {"base_link"}
    observation = observation_from_message(observations[-1])
    assert observation.environment.frame_id == "base_link"
    (ball,) = observation.objects
    times = ball.trajectory.times - (200.0 + STEP * (FRAMES + 2))
    expected = np.array([1.4, -0.4, 0.5]) + np.outer(times, [0.4, 0.9, 1.2])
    expected[:, 2] -= 0.5 * 9.81 * times**2
    assert BASE.points(ball.trajectory.positions) == pytest.approx(expected, abs=0.02)
    # Those who read detections get the same objects at the same places.
    by_stamp = {(d.header.stamp.sec, d.header.stamp.nanosec): d for d in detections}
    for message in states[-10:]:
        same = by_stamp[message.header.stamp.sec, message.header.stamp.nanosec]
        assert same.header == message.header
        assert [one.id for one in same.detections] == [one.id for one in message.objects]
        for one, own in zip(same.detections, message.objects, strict=True):
            assert one.bbox.center == own.pose.pose
    flying = [object_states_from_messages(one.objects)[1] for one in states if one.objects]
    velocity = BASE.directions(flying[4][0].linear_velocity)
    assert velocity[:2] == pytest.approx([0.4, 0.9], abs=0.3)


def test_a_frame_that_moves_takes_the_environment_along(peer, node, room) -> None:
    environments = peer.listen(EnvironmentMessage, "intuitive_physics/environment", LATCHED)
    images = peer.publisher(Image, f"{NODE}/depth/image", SENSOR_DATA)
    infos = peer.publisher(CameraInfo, f"{NODE}/depth/camera_info", SENSOR_DATA)
    tf = peer.publisher(TFMessage, "/tf", 100)
    empty = room.depth()

    def drive(begin: float, base: RigidTransform):
        """The camera stands, and the robot's frame somewhere else."""

        def look(time: float) -> Image:
            infos.publish(info_message(room))
            tf.publish(transform_message(camera_in(base, room), begin + time))
            return image_message(empty, begin + time)

        return look

    def floor_height() -> float:
        return float(environment_from_message(environments[-1]).planes[0].offset)

    def stands_at(height: float) -> bool:
        return bool(environments) and abs(floor_height() + height) < 0.02

    for height, begin in ((0.3, 100.0), (0.5, 200.0)):
        base = RigidTransform((2.0, -1.0, height), BASE.orientation)
        play_until(peer, images, drive(begin, base), lambda h=height: stands_at(h), "the floor")
    versions = [message.version for message in environments]
    assert versions == sorted(versions)
    # It stands now, and nothing is published anew.
    before = len(environments)
    look = drive(300.0, base)
    play(peer, images, [look(STEP * k) for k in range(10)])
    assert len(environments) - before <= 1
    # Time goes back, as in a bag that is played again: the later transforms are forgotten.
    base = RigidTransform((2.0, -1.0, 0.7), BASE.orientation)
    play_until(peer, images, drive(50.0, base), lambda: stands_at(0.7), "the floor, later")
    assert "time went back" in node.output


def carried(head: Head, k: int) -> RigidTransform:
    """Go with the camera on a head that turns by 20 °/s while it moves by 0.4 m/s; its pose."""
    gone = max(0.0, (k - FRAMES) * STEP)
    head.go(np.array([0.0, 0.4, 0.05]) * gone, [-4.0 * gone, -20.0 * gone, 0.0])
    return BASE.inverse.after(head.room.pose)


@pytest.mark.parametrize(
    "parameters", [["-p", f"environment_frames:={FRAMES}", "-p", "fixed_frame:=base_link"]]
)
def test_a_camera_that_is_carried_sees_everything_where_it_is(
    peer, node, parameters, make_small_room
) -> None:
    """p0 + v t - g t²/2 in the frame that stands still, whatever the camera does meanwhile."""
    room = make_small_room(tilt=25.0, seed=5)
    head = Head(room)
    environments = peer.listen(EnvironmentMessage, "intuitive_physics/environment", LATCHED)
    states = peer.listen(ObjectStates, "intuitive_physics/object_states", SENSOR_DATA)
    observations = peer.listen(Observation, "intuitive_physics/observations", OBSERVATIONS)
    frames = peer.listen(TFMessage, "/tf_static", LATCHED)
    images = peer.publisher(Image, f"{NODE}/depth/image", SENSOR_DATA)
    infos = peer.publisher(CameraInfo, f"{NODE}/depth/camera_info", SENSOR_DATA)
    tf = peer.publisher(TFMessage, "/tf", 100)
    p0, v0 = np.array([1.4, -0.4, 0.5]), np.array([0.4, 0.9, 1.2])

    def look(time: float) -> Image:
        """It stands, until the environment is known."""
        infos.publish(info_message(room))
        tf.publish(transform_message(carried(head, 0), 1.0 + time))
        return image_message(room.depth(), 1.0 + time)

    play_until(peer, images, look, lambda: environments, "an environment")
    begun = 100.0
    for k in range(3 * FRAMES + 14):
        flown = (k - FRAMES) * STEP
        place = p0 + v0 * flown - [0.0, 0.0, 0.5 * 9.81 * flown**2]
        pose = carried(head, k)
        balls = [(place, 0.07)] if 0.0 <= flown < 0.5 else []
        # The image comes before the transform of its time, as it often does.
        images.publish(image_message(room.depth(balls), begun + k * STEP))
        tf.publish(transform_message(pose, begun + k * STEP))
        peer.spin_for(0.05)
    peer.spin_until(lambda: observations, "an observation")
    assert {message.header.frame_id for message in environments} == {"base_link"}
    first = begun + FRAMES * STEP

    def truth(times: np.ndarray) -> np.ndarray:
        flown = np.asarray(times)[:, None] - first
        return BASE.inverse.points(p0 + flown * v0 - 0.5 * flown**2 * [0.0, 0.0, 9.81])

    seen = 0
    for message in states:
        time = seconds_from_stamp(message.header.stamp)
        if time > first + 0.42:
            # It comes to the floor.
            continue
        for state in object_states_from_messages(message.objects)[1]:
            assert state.position == pytest.approx(truth([time])[0], abs=0.04)
            seen += 1
    assert seen >= 5
    (ball,) = observation_from_message(observations[-1]).objects
    assert ball.trajectory.positions == pytest.approx(truth(ball.trajectory.times), abs=0.02)
    # The environment's own frame hangs where it stands still, with z up.
    (hung,) = {one.child_frame_id: one for message in frames for one in message.transforms}.values()
    assert (hung.header.frame_id, hung.child_frame_id) == (
        "base_link",
        "intuitive_physics/environment",
    )
    own = RigidTransform(xyz(hung.transform.translation), xyzw(hung.transform.rotation))
    assert own.directions([0.0, 0.0, 1.0]) == pytest.approx([0.0, 0.0, 1.0], abs=0.02)
    assert own.translation[2] == pytest.approx(-BASE.translation[2], abs=0.02)
    assert "Traceback" not in node.output
