"""Where nothing arrives on a topic, it is said once in a while who publishes what."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf
from types import SimpleNamespace

import pytest
from rclpy.node import NodeNameNonExistentError
from sensor_msgs.msg import Image, PointCloud2

from intuitive_physics_ros.diagnostics import Level
from intuitive_physics_ros.monitors import InputMonitor
from intuitive_physics_ros.silence import (
    AFTER,
    NEAREST,
    WARN_AGAIN,
    ClockCheck,
    Silence,
    launch_arguments,
    nearest,
)

IMAGE = "sensor_msgs/msg/Image"
REMEDY = launch_arguments("camera", "depth_image")


@dataclass
class FakeNode:
    """A node with a graph of its own: types of the publishers of each topic."""

    graph: dict[str, list[str]] = field(default_factory=dict)
    sim_time: bool = True
    time: int = 0
    lines: list[str] = field(default_factory=list)
    asked: int = 0

    def get_logger(self):
        return SimpleNamespace(warning=self.lines.append, info=self.lines.append)

    def resolve_topic_name(self, name):
        return {"~/depth": "/camera/depth", "~/points": "/camera/points", "/clock": "/left/clock"}[
            name
        ]

    def get_node_names_and_namespaces(self):
        """One node for each publisher, this one, and one that leaves at once."""
        self.asked += 1
        names = [f"{name} {k}" for name, kinds in self.graph.items() for k in range(len(kinds))]
        return [(name, "/") for name in ["own", "left", *names]]

    def get_name(self):
        return "own"

    def get_namespace(self):
        return "/"

    def get_publisher_names_and_types_by_node(self, name, namespace):
        assert namespace == "/"
        assert name != "own"
        if name == "left":
            raise NodeNameNonExistentError(name)
        topic, k = name.split(" ")
        return [(topic, [self.graph[topic][int(k)]])]

    def get_parameter(self, name):
        assert name == "use_sim_time"
        return SimpleNamespace(value=self.sim_time)

    def get_clock(self):
        return SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=self.time))


@pytest.fixture
def node():
    return FakeNode({"/camera/depth": []}, sim_time=False)


def waiting(clock, silent, seconds):
    """Ask once a second, as diagnostics do; return the last answer."""
    report = ""
    for _ in range(int(seconds)):
        clock.now += 1.0
        report = silent.report()
    return report


def test_who_publishes_and_what_to_do_is_said_after_some_seconds_and_rarely(clock, node):
    node.graph |= {"/cam/depth": [IMAGE], "/other": [IMAGE], "/cloud": ["sensor_msgs/msg/Points"]}
    silent = Silence(node, {"~/depth": Image}, REMEDY)
    assert waiting(clock, silent, AFTER - 1.0) == ""
    assert node.asked == 0
    text = waiting(clock, silent, 1.0)
    assert text == (
        "nothing arrived for 5 s on /camera/depth (sensor_msgs/msg/Image, no publisher); published "
        "of the same type: /cam/depth, /other; the launch arguments camera:= or depth_image:= "
        "choose the topic"
    )
    assert node.lines == [text]
    waiting(clock, silent, WARN_AGAIN - 1.0)
    assert len(node.lines) == 1
    waiting(clock, silent, WARN_AGAIN + 1.0)
    assert len(node.lines) == 3


def test_the_graph_is_left_alone_once_something_arrived(clock, node):
    silent = Silence(node, {"~/depth": Image}, REMEDY)
    waiting(clock, silent, AFTER)
    asked = node.asked
    silent.end()
    assert waiting(clock, silent, 100.0) == ""
    assert node.asked == asked
    assert len(node.lines) == 1


@pytest.mark.parametrize(
    ("publishers", "said"),
    [
        ([], "no publisher)"),
        ([IMAGE], "1 publisher)"),
        ([IMAGE, IMAGE], "2 publishers)"),
        (["a/msg/B"], "no publisher, but 1 of a/msg/B)"),
        ([IMAGE, "a/msg/B", "a/msg/B"], "1 publisher, but 2 of a/msg/B)"),
    ],
)
def test_publishers_are_counted_by_their_type(clock, node, publishers, said):
    node.graph["/camera/depth"] = publishers
    text = waiting(clock, Silence(node, {"~/depth": Image}, REMEDY), AFTER)
    assert f"on /camera/depth ({IMAGE}, {said}; no other topic of the same type" in text


def test_a_publisher_that_may_be_silent_is_no_warning_until_the_patience_is_over(clock, node):
    node.graph["/camera/depth"] = [IMAGE]
    patient = Silence(node, {"~/depth": Image}, REMEDY, patience=30.0)
    endless = Silence(node, {"~/depth": Image}, REMEDY, patience=inf)
    for second in range(1, 40):
        clock.now += 1.0
        assert bool(patient.report()) is (second >= AFTER)
        assert bool(endless.report()) is (second >= AFTER)
        assert len(node.lines) == (second >= 30)
    node.graph["/camera/depth"] = []
    endless.report()
    assert len(node.lines) == 2


def test_while_time_stands_still_a_publisher_may_wait_for_other_nodes(clock, node):
    node.graph["/camera/depth"] = [IMAGE]
    node.sim_time = True
    silent = Silence(node, {"~/depth": Image}, REMEDY)
    waiting(clock, silent, WARN_AGAIN - 1.0)
    assert node.lines == []
    node.time = 1
    waiting(clock, silent, 1.0)
    assert len(node.lines) == 1


def test_several_topics_of_which_one_is_enough_are_one_warning(clock, node):
    silent = Silence(node, {"~/depth": Image, "~/points": PointCloud2}, REMEDY)
    both = [InputMonitor(node, name, 2.0) for name in ("~/depth", "~/points")]
    for monitor in both:
        monitor.expect(silent)
    for _ in range(10):
        clock.now += 1.0
        said = [monitor.check() for monitor in both]
    assert [status.level for status in said] == [Level.WARN, Level.WARN]
    assert all("nor on /camera/points (sensor_msgs/msg/PointCloud2" in one.message for one in said)
    assert len(node.lines) == 1
    both[0].accepted()
    assert both[0].check().level is Level.OK
    assert both[1].check().message == "nothing arrived yet on ~/points"


def test_near_names_come_first_and_few(clock):
    names = [f"/robot/sensor_{k}/scan" for k in range(20)]
    near = ["/camera/depth/image_rect_raw", "/camera/depth/image"]
    found = nearest([*names, *near], ["/camera/camera/depth/image_rect_raw"])
    assert found[:2] == near
    assert len(found) == NEAREST


def test_a_clock_that_does_not_come_is_named(clock):
    node = FakeNode({"/clock": ["rosgraph_msgs/msg/Clock"], "/left/clock": []})
    check = ClockCheck(node)
    for _ in range(int(AFTER) + 1):
        status = check()
        clock.now += 1.0
    assert status.level is Level.WARN
    assert node.lines == [status.message]
    assert "on /left/clock (rosgraph_msgs/msg/Clock, no publisher)" in status.message
    assert "published of the same type: /clock; use_sim_time is true" in status.message
    node.time = 1
    assert check().level is Level.OK
    node.sim_time, node.time = False, 0
    assert check().level is Level.OK
    assert len(node.lines) == 1


def test_one_launch_argument_is_a_sentence_too():
    assert launch_arguments("imu") == "the launch argument imu:= chooses the topic"
    assert (
        launch_arguments("a", "b", "c") == "the launch arguments a:=, b:= or c:= choose the topic"
    )
