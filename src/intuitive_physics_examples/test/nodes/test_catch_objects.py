"""The example clients: that in Python beside a real predictor, that in C++ by the names it uses."""

from __future__ import annotations

import re
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from intuitive_physics_msgs.msg import Environment as EnvironmentMessage
from intuitive_physics_msgs.msg import (
    ObjectStates,
    PredictedTrajectory,
    Region,
    ResultCode,
    TrajectoryDistribution,
)
from intuitive_physics_msgs.srv import Query

from intuitive_physics.processes import ChildProcess
from intuitive_physics.scene import Environment, Plane, SceneObject
from intuitive_physics.shapes import Sphere
from intuitive_physics.state import ObjectState
from intuitive_physics_ros.conversions import (
    environment_to_message,
    object_states_to_message,
    stamp_from_seconds,
)
from intuitive_physics_ros.qos import LATCHED, SENSOR_DATA
from intuitive_physics_ros.scripting import NodeProcess, Peer

PACKAGE = Path(__file__).parents[2]
CLIENT = PACKAGE / "nodes" / "catch_objects.py"
PREDICTOR = "intuitive_physics_predictor.nodes.predictor_node"
SAID = re.compile(r"catch ball at \((.+), (.+), (.+)\) m of lab in (.+) s: (\d+)%")


def start_client(*arguments: str) -> ChildProcess:
    """Start the example."""
    return ChildProcess([sys.executable, str(CLIENT), "--ros-args", *arguments])


def test_a_thrown_ball_is_to_be_caught_where_it_will_be() -> None:
    # At the stamp of each state the ball is at (0, 0, 1) and has (1, 0, 2) m/s: at (x, 0, z) it has
    # fallen for x s, so that z = 1 + 2 x - g x² / 2, as long as it is in the air.
    environment = Environment([Plane("floor", "wood", (0, 0, 1), 0.0)], frame_id="lab")
    ball = SceneObject("ball", "rubber", Sphere(0.05))
    covariance = np.diag([1e-6] * 3 + [0.0] * 3 + [1e-4] * 3 + [1.0] * 3)
    state = ObjectState((0, 0, 1), (0, 0, 0, 1), (1, 0, 2), (0, 0, 0), covariance)
    client = start_client("-p", "center:=[0.5, 0.0, 1.0]", "-p", "size:=[0.6, 0.6, 2.0]")
    with NodeProcess(PREDICTOR, ["-p", "stale_after:=5.0"]), Peer("tester", 60.0) as peer:
        try:
            latched = peer.publisher(EnvironmentMessage, "intuitive_physics/environment", LATCHED)
            latched.publish(environment_to_message(environment))
            states = peer.publisher(ObjectStates, "intuitive_physics/object_states", SENSOR_DATA)

            def feed() -> None:
                now = stamp_from_seconds(time.time())
                message = object_states_to_message([ball], [state], frame_id="lab", stamp=now)
                states.publish(message)
                peer.spin_for(1.0 / 60.0)

            peer.spin_until(lambda: len(SAID.findall(client.output)) >= 2 or feed(), "two answers")
        finally:
            assert client.stop() == 0
    assert "Traceback" not in client.output
    for x, y, z, t, percent in (map(float, numbers) for numbers in SAID.findall(client.output)):
        assert t >= 0.2
        # A prediction begins after its state, by a time that only the load of the machine bounds.
        assert -0.02 <= x - t < 0.5
        assert y == pytest.approx(0.0, abs=0.02)
        assert z == pytest.approx(1.0 + 2.0 * x - 4.905 * x**2, abs=0.02)
        assert 0.2 <= x <= 0.8
        assert percent > 90.0


def test_without_a_predictor_it_waits_and_ends_clean() -> None:
    client = start_client()
    client.wait_for("nothing is predicted yet", 30.0)
    assert client.stop() == 0
    assert "Traceback" not in client.output


def test_the_example_in_c_uses_names_that_exist() -> None:
    # Where rclcpp is, as on ros:jazzy, colcon compiles it; here its names are compared.
    text = (PACKAGE / "src" / "catch_objects.cpp").read_text(encoding="utf-8")
    fields = {
        "asked->": Query.Request,
        "answer.": Query.Response,
        "newest_->": TrajectoryDistribution,
        "trajectory.": PredictedTrajectory,
    }
    for variable, kind in fields.items():
        used = set(re.findall(re.escape(variable) + r"([a-z_]+)", text)) - {"reset"}
        assert used
        assert used <= set(kind.get_fields_and_field_types()), variable
    for name, kind in (
        ("Query::Request", Query.Request),
        ("ResultCode", ResultCode),
        ("Region", Region),
    ):
        constants = set(re.findall(rf"{name}::([A-Z]+)\b", text))
        assert constants
        assert all(hasattr(kind, name) for name in constants)
    headers = set(re.findall(r'"intuitive_physics_msgs/(\w+)/(\w+)\.hpp"', text))
    for folder, name in headers:
        kind = "".join(part.capitalize() for part in name.split("_"))
        assert (PACKAGE.parent / "intuitive_physics_msgs" / folder / f"{kind}.{folder}").exists()
    python = CLIENT.read_text(encoding="utf-8")
    for topic in ('"intuitive_physics/predictions"', '"predictor_node/query"'):
        assert topic in text
        assert topic in python
