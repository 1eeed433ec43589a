"""Record what a session can be reproduced from: inputs of perception, and what was made of them.

`ros2 launch intuitive_physics_bringup record.launch.py output:=FOLDER`
"""

from collections.abc import Mapping
from pathlib import Path

from ament_index_python.packages import PackageNotFoundError, get_package_prefix
from launch.actions import DeclareLaunchArgument, ExecuteProcess, OpaqueFunction
from launch.substitutions import LaunchConfiguration

from intuitive_physics.errors import InvalidInputError
from intuitive_physics_bringup.connections import CAMERAS, session_topics
from launch import LaunchContext, LaunchDescription

ARGUMENTS = {
    "output": ("session", "folder of the bag, which must not exist"),
    "namespace": ("", "of the robot; empty: none"),
    "camera": ("realsense", f"topics of which driver are recorded: {', '.join(CAMERAS)}"),
    "color": ("false", "true: record colour images, and depth images registered to them"),
    "clouds": ("false", "true: record point clouds instead of depth images"),
}
"""Default and meaning of each argument."""


def generate_launch_description() -> LaunchDescription:
    """Describe the recorder."""
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, (default, text) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=recorder)])


def recorder(context: LaunchContext) -> list[ExecuteProcess]:
    """Return `ros2 bag record` with its arguments, once these are known to be good."""
    given = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    check(given)
    return [ExecuteProcess(cmd=command(given), output="screen")]


def check(given: Mapping[str, str]) -> None:
    """Refuse arguments that cannot be, and a machine without rosbag2, in one line.

    Raises
    ------
    InvalidInputError
        When one of them is not what it must be.
    """
    if Path(given["output"]).exists():
        raise InvalidInputError(f"output is {given['output']!r}; expected a folder to be made")
    if given["camera"] not in CAMERAS:
        raise InvalidInputError(
            f"camera is {given['camera']!r}; expected one of {', '.join(CAMERAS)}"
        )
    for name in ("color", "clouds"):
        if given[name] not in ("true", "false"):
            raise InvalidInputError(f"{name} is {given[name]!r}; expected true or false")
    try:
        get_package_prefix("ros2bag")
        get_package_prefix("rosbag2_storage_mcap")
    except PackageNotFoundError as error:
        raise InvalidInputError(
            f"{error.args[0]} is not installed; expected ros2 bag with its MCAP storage "
            "(sudo apt install ros-jazzy-ros2bag ros-jazzy-rosbag2-storage-mcap)"
        ) from None


def command(given: Mapping[str, str]) -> list[str]:
    """Return the command line of the recorder."""
    topics = session_topics(
        CAMERAS[given["camera"]],
        given["namespace"],
        color=given["color"] == "true",
        clouds=given["clouds"] == "true",
    )
    record = ["ros2", "bag", "record", "--storage", "mcap", "--output", given["output"]]
    return [*record, "--topics", *topics]
