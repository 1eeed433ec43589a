"""Two cameras over DDS make one track; one that falls silent, or another on its topic, is named."""

from __future__ import annotations

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from intuitive_physics_msgs.msg import Environment as EnvironmentMessage
from intuitive_physics_msgs.msg import ObjectStates, Observation
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage

from intuitive_physics_ros.conversions import (
    object_states_from_messages,
    observation_from_message,
    seconds_from_stamp,
    stamp_from_seconds,
)
from intuitive_physics_ros.qos import LATCHED, OBSERVATIONS, SENSOR_DATA
from intuitive_physics_ros.scripting import NodeProcess, Peer

from .answers import wait_for_states
from .camera_messages import (
    FRAMES,
    STEP,
    cloud_message,
    image_message,
    info_message,
    says,
    transform_stamped,
)

pytestmark = pytest.mark.needs("tf2_msgs", "tf2_ros")

MODULE = "intuitive_physics_perception.nodes.perception_node"
NODE = "/perception_node"
PARAMETERS = ["-p", f"environment_frames:={FRAMES}", "-p", "fixed_frame:=room"]
LAG = 0.02
"""s by which the second camera's frames are later."""


@pytest.fixture(scope="module")
def rooms(make_small_room) -> dict:
    """The room as the camera sees it, and as one does that looks along -y."""
    first, second = make_small_room(seed=5), make_small_room(seed=6)
    second.look_along_minus_y([1.6, 1.2, 0.8])
    return {"": first, "side": second}


def header(name: str, time: float) -> Header:
    return Header(stamp=stamp_from_seconds(time), frame_id=f"camera{name}")


def places_message(rooms) -> TFMessage:
    return TFMessage(
        transforms=[
            transform_stamped("room", f"camera{name}", room.pose) for name, room in rooms.items()
        ]
    )


class Session:
    """Publishes what both cameras, or some, send, and hears states."""

    def __init__(self, peer: Peer, rooms) -> None:
        self.peer, self.rooms, self.time = peer, rooms, 10.0
        self.states = peer.listen(ObjectStates, "intuitive_physics/object_states", SENSOR_DATA)
        prefix = {name: f"{NODE}/{name}/depth" if name else f"{NODE}/depth" for name in rooms}
        self.images = {
            name: peer.publisher(Image, f"{p}/image", SENSOR_DATA) for name, p in prefix.items()
        }
        self.infos = {
            name: peer.publisher(CameraInfo, f"{p}/camera_info", SENSOR_DATA)
            for name, p in prefix.items()
        }
        peer.publisher(TFMessage, "/tf_static", LATCHED).publish(places_message(rooms))

    def show(self, place=None, names=("side", "")) -> None:
        """Send one frame of some cameras, the later one first; the ball is at a place (3,) m at a
        time after this one, None for none."""
        for name in names:
            lag = LAG if name else 0.0
            room, time = self.rooms[name], self.time + lag
            balls = [(place(lag), 0.07)] if place is not None else []
            self.infos[name].publish(info_message(room))
            image = image_message(room.depth(balls), time, header=header(name, time))
            self.images[name].publish(image)
        shown = self.time
        self.time += STEP
        self.peer.spin_for(0.04)
        if self.states:
            wait_for_states(self.peer, self.states, shown, 1.5 * LAG)


def test_two_cameras_make_one_track_and_one_goes_on_without_the_other(rooms) -> None:
    """p0 + v t - g t²/2 in the room, by the frames of both; then the first falls silent."""
    with NodeProcess(MODULE, [*PARAMETERS, "-p", "further_cameras:=[side]"]) as node:
        with Peer("tester", 60.0) as peer:
            environments = peer.listen(EnvironmentMessage, "intuitive_physics/environment", LATCHED)
            observations = peer.listen(Observation, "intuitive_physics/observations", OBSERVATIONS)
            heard = peer.listen(DiagnosticArray, "/diagnostics")
            session = Session(peer, rooms)
            states = session.states
            peer.spin_until(lambda: environments or session.show(), "an environment")
            for _ in range(2 * FRAMES):
                session.show()
            begun = session.time
            p0, v0 = np.array([1.4, -0.4, 0.5]), np.array([0.4, 0.6, 1.6])

            def truth(time: float) -> np.ndarray:
                t = time - begun
                return p0 + v0 * t - [0.0, 0.0, 0.5 * 9.81 * t * t]

            for _ in range(8):
                now = session.time
                session.show(lambda lag, now=now: truth(now + lag))
            for _ in range(12):
                session.show()
            peer.spin_until(lambda: observations, "an observation")
            followed = [message for message in states if message.objects]
            assert {obj.id for message in followed for obj in message.objects} == {"sphere_1"}
            stamps = [seconds_from_stamp(message.header.stamp) for message in followed]
            assert stamps == sorted(stamps)
            steps = {round(float(t - begun) % STEP, 3) % STEP for t in stamps}
            assert len(steps) == 2  # frames of both
            for message, stamp in zip(followed, stamps, strict=True):
                if stamp < begun + 8 * STEP - 0.02:
                    (state,) = object_states_from_messages(message.objects)[1]
                    assert state.position == pytest.approx(truth(float(stamp)), abs=0.03)
            (ball,) = observation_from_message(observations[0]).objects
            seen = ball.detections
            expected = np.array([truth(float(time)) for time in seen.times])
            assert seen.positions == pytest.approx(expected, abs=0.02)
            # Of best effort: a busy machine loses some.
            assert len(seen.times) >= 8

            heard.clear()
            states.clear()
            peer.spin_until(
                lambda: (
                    says(heard, "depth/image", "nothing arrived on ~/depth/image for")
                    or session.show(names=["side"])
                ),
                "that the first camera is silent",
            )
            assert len(states) >= 10
            assert says(heard, "side/depth/image", "arrives")
        node.check_running()
        assert "Traceback" not in node.output


def test_frames_of_another_camera_on_one_topic_are_an_error(rooms) -> None:
    with NodeProcess(MODULE, ["-p", f"environment_frames:={FRAMES}"]) as node:
        with Peer("tester", 60.0) as peer:
            environments = peer.listen(EnvironmentMessage, "intuitive_physics/environment", LATCHED)
            heard = peer.listen(DiagnosticArray, "/diagnostics")
            clouds = peer.publisher(PointCloud2, f"{NODE}/points", SENSOR_DATA)
            points, times = rooms[""].points(), iter(np.arange(1.0, 1e4, STEP))

            def send(name: str) -> None:
                time = float(next(times))
                clouds.publish(cloud_message(points, time, header=header(name, time)))
                peer.spin_for(0.03)

            peer.spin_until(lambda: environments or send(""), "an environment")
            text = "frame_id is 'cameraside'; expected 'camera' as in all before"
            peer.spin_until(lambda: says(heard, "points", text) or send("side"), text)
            assert "one topic" in node.output
            heard.clear()
            peer.spin_until(lambda: says(heard, "points", "arrives") or send(""), "good frames")
        node.check_running()
        assert "Traceback" not in node.output
