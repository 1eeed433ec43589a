"""A perception node that hears nothing says which topics there are, and how to choose one."""

from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Image

from intuitive_physics_ros.qos import SENSOR_DATA
from intuitive_physics_ros.scripting import NodeProcess, Peer

MODULE = "intuitive_physics_perception.nodes.perception_node"
WANTED = "/camera/camera/depth/image_rect_raw"
THERE = "/camera/depth/image_rect_raw"
ARGUMENTS = [
    *("-r", f"~/depth/image:={WANTED}", "-r", "/clock:=/left/clock"),
    *("-p", "use_sim_time:=true", "-p", "use_color:=true"),
]


def test_a_wrong_camera_and_a_wrong_clock_are_warnings_with_the_right_names():
    with NodeProcess(MODULE, ARGUMENTS) as node, Peer("driver", 60.0) as peer:
        heard = peer.listen(DiagnosticArray, "/diagnostics")
        peer.node.create_publisher(Image, THERE, SENSOR_DATA)
        peer.node.create_publisher(Clock, "/clock", 1)
        frames = (
            f"on {WANTED} (sensor_msgs/msg/Image, no publisher) nor on /perception_node/points "
            "(sensor_msgs/msg/PointCloud2, no publisher); published of these types: "
            f"{THERE}; the launch arguments camera:=, depth_image:= or points:= choose the topic"
        )
        time = (
            "on /left/clock (rosgraph_msgs/msg/Clock, no publisher); published of the same type: "
            "/clock; use_sim_time is true, so time stands still"
        )
        colour = "/perception_node/color/image (sensor_msgs/msg/Image, no publisher)"
        for text in (frames, time, colour):
            peer.spin_until(lambda text=text: text in node.output, f"a warning {text!r}")
            assert node.output.count(text) == 1
        # Frames, their camera's intrinsics, colours and time.
        peer.spin_until(lambda: node.output.count("nothing arrived") >= 4, "four warnings")
        warnings = [line for line in node.output.splitlines() if "nothing arrived" in line]
        assert all("[WARN]" in line for line in warnings)
        assert len(warnings) == 4
        heard.clear()
        peer.spin_until(lambda: heard, "diagnostics")
        messages = {status.name: status.message for status in heard[-1].status}
        for name, text in (("depth/image", frames), ("points", frames), ("clock", time)):
            assert text in messages[f"perception_node: {name}"]
        node.check_running()


def test_poses_that_do_not_come_are_a_warning_with_the_topics_there_are():
    module = "intuitive_physics_perception.nodes.pose_bridge_node"
    box = ["-p", "object_names:=[box]", "-p", "object_shapes:=['box 0.1 0.15 0.2']"]
    with NodeProcess(module, box) as node, Peer("tracker", 60.0) as peer:
        peer.node.create_publisher(PoseStamped, "/mocap/box/pose", SENSOR_DATA)
        text = (
            "on /pose_bridge/box/pose (geometry_msgs/msg/PoseStamped, no publisher); published of "
            "the same type: /mocap/box/pose; choose the topic by a rule, -r '~/box/pose:=/TOPIC'"
        )
        peer.spin_until(lambda: text in node.output, f"a warning {text!r}")
        node.check_running()
