"""The pose bridge as a process: poses of a motion-capture system or of tags in, states out."""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import (
    Point,
    PoseStamped,
    PoseWithCovarianceStamped,
    Quaternion,
    TransformStamped,
    Vector3,
)
from intuitive_physics_msgs.msg import Environment as EnvironmentMessage
from intuitive_physics_msgs.msg import ObjectStates, Observation, TrajectoryDistribution
from rclpy.duration import Duration
from scipy.spatial.transform import Rotation

from intuitive_physics.shapes import Box
from intuitive_physics_ros.conversions import (
    object_states_from_messages,
    observation_from_message,
    seconds_from_stamp,
    stamp_from_seconds,
)
from intuitive_physics_ros.qos import LATCHED, OBSERVATIONS, SENSOR_DATA
from intuitive_physics_ros.scripting import NodeProcess, Peer

from .answers import wait_for_states

MODULE = "intuitive_physics_perception.nodes.pose_bridge_node"
PREDICTOR = "intuitive_physics_predictor.nodes.predictor_node"
NODE = "/pose_bridge"
BOX = ["-p", "object_names:=[box]", "-p", "object_shapes:=['box 0.1 0.15 0.2']"]
RATE = 100.0

START, VELOCITY, SPIN = np.array([0.0, 0.5, 0.8]), np.array([1.5, -0.5, 2.0]), 3.0
"""m, m/s, and rad/s about z, of a box that is thrown."""

THROWN, LANDS = 0.4, 0.6
"""s, the part of a throw that is always shown, and until when the box flies."""


def true_pose(t: float) -> tuple[np.ndarray, np.ndarray]:
    place = START + VELOCITY * t + 0.5 * np.array([0.0, 0.0, -9.81]) * t**2
    return place, Rotation.from_rotvec([0.0, 0.0, SPIN * t]).as_quat()


def place_and_turn(t: float, rng: np.random.Generator) -> tuple[Point, Quaternion]:
    place, turn = true_pose(t)
    noisy = place + 0.001 * rng.normal(size=3)
    return Point(**dict(zip("xyz", noisy, strict=True))), Quaternion(
        **dict(zip("xyzw", turn, strict=True))
    )


def pose(time: float, t: float, rng: np.random.Generator, frame_id: str = "world") -> PoseStamped:
    message = PoseStamped()
    message.header.stamp, message.header.frame_id = stamp_from_seconds(time), frame_id
    message.pose.position, message.pose.orientation = place_and_turn(t, rng)
    return message


def pose_with_covariance(time, t, rng) -> PoseWithCovarianceStamped:
    plain = pose(time, t, rng)
    message = PoseWithCovarianceStamped(header=plain.header)
    message.pose.pose = plain.pose
    message.pose.covariance = np.diag([1e-6] * 3 + [2.5e-5] * 3).ravel()
    return message


def transform(time, t, rng) -> TransformStamped:
    plain = pose(time, t, rng)
    message = TransformStamped(header=plain.header, child_frame_id="tag_7")
    place = plain.pose.position
    message.transform.translation = Vector3(x=place.x, y=place.y, z=place.z)
    message.transform.rotation = plain.pose.orientation
    return message


@contextmanager
def bridge(*arguments: str) -> Iterator[tuple[Peer, NodeProcess]]:
    with NodeProcess(MODULE, [*BOX, *arguments]) as process, Peer("tester", 60.0) as peer:
        yield peer, process
        assert process.process.poll() in (None, 0)
        assert "Traceback" not in process.output


def throw(peer: Peer, publisher, make: Callable, begin: float, states: list[ObjectStates]) -> None:
    """Publish the poses of a throw, each once that before is answered or must be lost, and go on
    until a state from its end is heard: poses and states are of best effort, and a node that is
    busy loses all but the newest. Where a quarter of a second is lost there is no observation."""
    rng = np.random.default_rng(0)

    def newest() -> float:
        return seconds_from_stamp(states[-1].header.stamp) - begin if states else -np.inf

    for t in np.arange(0.0, LANDS, 1.0 / RATE):
        if t >= THROWN and states[-1].objects and 0.75 * THROWN <= newest() <= LANDS:
            break
        publisher.publish(make(begin + t, t, rng))
        wait_for_states(peer, states, begin + t, 0.5 / RATE)
    assert states[-1].objects
    assert 0.75 * THROWN <= newest() <= LANDS


def meet(peer: Peer, publisher, make: Callable, begin: float, states: list[ObjectStates]) -> None:
    """Publish poses of long before a throw until one is answered: the node may know later of this
    publisher than this one of it, and what it misses of best effort is lost."""
    rng, stamps = np.random.default_rng(1), itertools.count()

    def answered() -> bool:
        publisher.publish(make(begin - 50.0 + 0.1 * next(stamps), 0.0, rng))
        peer.spin_for(0.1)
        return bool(states)

    peer.spin_until(answered, "states")


def check_state(message: ObjectStates, begin: float) -> None:
    """Compare the newest state with the law of free flight at its own stamp."""
    (box,), (state,) = object_states_from_messages(message.objects)
    t = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec - begin
    assert message.header.frame_id == "world"
    assert (box.id, box.material, box.shape) == ("box", "object", Box((0.1, 0.15, 0.2)))
    assert state.position == pytest.approx(true_pose(t)[0], abs=0.005)
    expected = VELOCITY + np.array([0.0, 0.0, -9.81]) * t
    assert state.linear_velocity == pytest.approx(expected, abs=0.15)
    assert state.angular_velocity == pytest.approx([0.0, 0.0, SPIN], abs=0.5)


@pytest.mark.parametrize(
    ("kind", "make", "message"),
    [
        ("pose", pose, PoseStamped),
        ("pose_with_covariance", pose_with_covariance, PoseWithCovarianceStamped),
        ("transform", transform, TransformStamped),
    ],
)
def test_poses_become_states_and_an_observation(kind, make, message) -> None:
    with bridge("-p", f"input:={kind}") as (peer, process):
        states = peer.listen(ObjectStates, "intuitive_physics/object_states", SENSOR_DATA)
        environments = peer.listen(EnvironmentMessage, "intuitive_physics/environment", LATCHED)
        observations = peer.listen(Observation, "intuitive_physics/observations", OBSERVATIONS)
        poses = peer.publisher(message, f"{NODE}/box/pose", SENSOR_DATA)
        peer.spin_until(lambda: environments, "the environment")
        meet(peer, poses, make, 100.0, states)
        throw(peer, poses, make, 100.0, states)
        check_state(states[-1], 100.0)
        assert not observations
        assert process.stop() == 0
        peer.spin_until(lambda: observations, f"an observation of what wrote {process.output}")
        observation = observation_from_message(observations[-1])
        assert [one.object.id for one in observation.objects] == ["box"]


@pytest.mark.needs("tf2_msgs", "tf2_ros")
def test_tags_are_taken_from_tf_and_other_frames_are_looked_up() -> None:
    from tf2_msgs.msg import TFMessage

    # The tag is 0.05 m beside the centre of the box, along the box's x.
    arguments = ["-p", "input:=tf", "-p", "object_frames:=[tag_7]"]
    arguments += ["-p", "object_offsets:=['-0.05 0 0']"]
    with bridge(*arguments) as (peer, _):
        states = peer.listen(ObjectStates, "intuitive_physics/object_states", SENSOR_DATA)
        tf = peer.publisher(TFMessage, "/tf", 100)
        static = peer.publisher(TFMessage, "/tf_static", LATCHED)
        camera = TransformStamped(child_frame_id="camera")
        camera.header.frame_id = "world"
        # The camera looks from 2 m above, and its x is the world's y.
        camera.transform.translation.z = 2.0
        camera.transform.rotation = Quaternion(z=np.sqrt(0.5), w=np.sqrt(0.5))
        static.publish(TFMessage(transforms=[camera]))
        assert static.wait_for_all_acked(Duration(seconds=60.0))

        def seen(time: float, t: float, rng: np.random.Generator) -> TFMessage:
            message = transform(time, t, rng)
            message.header.frame_id = "camera"
            place, turn = true_pose(t)
            tag = place + Rotation.from_quat(turn).apply([0.05, 0.0, 0.0]) - [0.0, 0.0, 2.0]
            inverse = Rotation.from_quat([0.0, 0.0, -np.sqrt(0.5), np.sqrt(0.5)])
            in_camera = inverse.apply(tag)
            message.transform.translation = Vector3(**dict(zip("xyz", in_camera, strict=True)))
            own = (inverse * Rotation.from_quat(turn)).as_quat()
            message.transform.rotation = Quaternion(**dict(zip("xyzw", own, strict=True)))
            return TFMessage(transforms=[message])

        throw(peer, tf, seen, 100.0, states)
        check_state(states[-1], 100.0)


def test_the_predictor_predicts_what_the_bridge_sees() -> None:
    with bridge() as (peer, _), NodeProcess(PREDICTOR, ["-p", "use_sim_time:=false"]) as predictor:
        predictions = peer.listen(
            TrajectoryDistribution, "intuitive_physics/predictions", SENSOR_DATA
        )
        poses = peer.publisher(PoseStamped, f"{NODE}/box/pose", SENSOR_DATA)
        peer.spin_until(
            lambda: peer.node.count_publishers("intuitive_physics/predictions"), "the predictor"
        )
        rng = np.random.default_rng(1)

        def now() -> float:
            return 1e-9 * peer.node.get_clock().now().nanoseconds

        # A box that lies on the floor.
        def feed() -> None:
            message = pose(now(), 0.0, rng)
            message.pose.position.z = 0.1 + 0.0005 * rng.normal()
            poses.publish(message)
            peer.spin_for(1.0 / 30.0)

        peer.spin_until(lambda: predictions or feed(), "predictions")
        (box,) = predictions[-1].objects
        assert box.object_id == "box"
        assert predictions[-1].header.frame_id == "world"
        assert "Traceback" not in predictor.output


def test_what_cannot_be_used_is_named() -> None:
    with bridge() as (peer, process):
        heard = peer.listen(DiagnosticArray, "/diagnostics")
        states = peer.listen(ObjectStates, "intuitive_physics/object_states", SENSOR_DATA)
        poses = peer.publisher(PoseStamped, f"{NODE}/box/pose", SENSOR_DATA)
        rng = np.random.default_rng(0)
        unstamped, unreal, unturned = (pose(100.0, 0.0, rng) for _ in range(3))
        unstamped.header.stamp.sec = 0
        unreal.pose.position.x = float("nan")
        unturned.pose.orientation = Quaternion(w=0.0)
        elsewhere = pose(100.0, 0.0, rng, frame_id="moon")
        endless = pose(100.0, 0.0, rng, frame_id="x" * 100_000)
        for message, text in (
            (unstamped, "stamp of a pose is 0"),
            (unreal, "translation of a frame"),
            (unturned, "orientation of a frame"),
            (elsewhere, "moon"),
            (endless, "of 100000 characters"),
        ):
            heard.clear()

            def told(text=text) -> bool:
                return any(text in one.message for each in heard for one in each.status)

            peer.spin_until(
                lambda message=message, told=told: (
                    told() or poses.publish(message) or peer.spin_for(0.1)
                ),
                text,
            )
        assert not any(message.objects for message in states)
        # Time goes back, and it begins anew.
        throw(peer, poses, pose, 200.0, states)
        throw(peer, poses, pose, 100.0, states)
        process.wait_for("time went back")
        check_state(states[-1], 100.0)


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["-p", "object_shapes:=['cube 0.1']"], "expected 'sphere' and radius or 'box'"),
        (["-p", "object_shapes:=['box 0.1 x 0.2']"], "cannot be read"),
        (["-p", "object_names:=[a b]"], "expected letters, digits and _"),
        (["-p", "object_names:=[a, b]"], "2 names and 1 shapes; expected as many"),
        (["-p", "object_offsets:=['1 2']"], "expected x y z in m"),
        (["-p", "environment_file:=nowhere.json"], "'nowhere.json' cannot be read"),
        (["-p", "input:=tf", "-p", "object_frames:=[a, b]"], "2 frames for 1 objects"),
    ],
)
def test_parameters_that_cannot_be_are_one_line(arguments, text) -> None:
    check_refusal(arguments, text)


def test_tf_that_is_not_installed_is_one_line(tmp_path, monkeypatch) -> None:
    (tmp_path / "tf2_msgs.py").write_text("raise ImportError\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)
    check_refusal(["-p", "input:=tf"], "input is tf, but tf2_msgs is not installed; expected it")


def check_refusal(arguments: list[str], text: str) -> None:
    with NodeProcess(MODULE, [*BOX, *arguments]) as process:
        assert process.wait(30.0) == 1
    assert text in process.output
    assert "Traceback" not in process.output
