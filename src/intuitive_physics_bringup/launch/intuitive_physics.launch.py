"""Perception, learner and predictor, connected; optionally a bag to replay and RViz."""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument, OpaqueFunction, SetEnvironmentVariable
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PythonExpression
from launch_ros.actions import Node

from intuitive_physics_bringup.connections import (
    CAMERA_TOPICS,
    NODES,
    RANGES,
    default_peers,
    default_range,
    discovery_environment,
    remappings,
)
from launch import LaunchContext, LaunchDescription

SHARE = Path(get_package_share_directory("intuitive_physics_bringup"))

ARGUMENTS = {
    "params_file": (str(SHARE / "config" / "nodes.yaml"), "YAML file with parameters of the nodes"),
    "depth_image": (CAMERA_TOPICS["~/depth/image"], "topic of the depth images"),
    "camera_info": (CAMERA_TOPICS["~/depth/camera_info"], "topic of their camera's intrinsics"),
    "points": (CAMERA_TOPICS["~/points"], "topic of point clouds, where there are no images"),
    "imu": (CAMERA_TOPICS["~/imu"], "topic of an IMU, heard with gravity_source: imu only"),
    "bag": ("", "bag to replay; empty: none"),
    "rate": ("1.0", "bag seconds in one real second"),
    "loop": ("false", "replay the bag again and again"),
    "use_sim_time": (
        PythonExpression(["'true' if '", LaunchConfiguration("bag"), "' else 'false'"]),
        "take time from /clock, as a replayed bag wants it",
    ),
    "rviz": ("false", "show everything in RViz"),
    "discovery": (
        default_range(),
        f"where other nodes are looked for: {', '.join(RANGES)}; what the environment says, else "
        "this machine",
    ),
    "peers": (default_peers(), "other machines that are looked for, addresses divided by ;"),
    "enclaves": (
        "/intuitive_physics",
        "where the nodes' enclaves are in a keystore of SROS2, used with ROS_SECURITY_ENABLE only",
    ),
}


def generate_launch_description() -> LaunchDescription:
    """Describe the suite."""
    given = {name: LaunchConfiguration(name) for name in ARGUMENTS}
    inputs = [
        ("~/depth/image", given["depth_image"]),
        ("~/depth/camera_info", given["camera_info"]),
        ("~/points", given["points"]),
        ("~/imu", given["imu"]),
    ]
    nodes = [
        Node(
            package=package,
            executable=name,
            name=name,
            output="screen",
            parameters=[given["params_file"], {"use_sim_time": given["use_sim_time"]}],
            remappings=[*remappings(name), *(inputs if name == "perception_node" else [])],
            ros_arguments=["--enclave", [given["enclaves"], f"/{name}"]],
        )
        for name, package in NODES.items()
    ]
    replay = Node(
        package="intuitive_physics_recordings",
        executable="replay_node",
        output="screen",
        parameters=[{name: given[name] for name in ("bag", "rate", "loop")}],
        ros_arguments=["--enclave", [given["enclaves"], "/replay_node"]],
        condition=IfCondition(PythonExpression(["'", given["bag"], "' != ''"])),
    )
    rviz = Node(
        package="rviz2",
        executable="rviz2",
        arguments=["-d", str(SHARE / "rviz" / "intuitive_physics.rviz")],
        ros_arguments=["--enclave", [given["enclaves"], "/operator"]],
        condition=IfCondition(given["rviz"]),
    )
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, (default, text) in ARGUMENTS.items()
    ]
    return LaunchDescription(
        [*declared, OpaqueFunction(function=limit_discovery), *nodes, replay, rviz]
    )


def limit_discovery(context: LaunchContext) -> list[SetEnvironmentVariable]:
    """Say to all that is started after this which other nodes it looks for."""
    given = (LaunchConfiguration(name).perform(context) for name in ("discovery", "peers"))
    variables = discovery_environment(*given)
    return [SetEnvironmentVariable(name, value) for name, value in variables.items()]
