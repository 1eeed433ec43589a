"""Record what a session can be reproduced from: inputs of perception, and what was made of them.

`ros2 launch intuitive_physics_bringup record.launch.py output:=FOLDER`
"""

import shutil
import sys
from collections.abc import Mapping
from pathlib import Path

from ament_index_python.packages import PackageNotFoundError, get_package_prefix
from launch.actions import (
    DeclareLaunchArgument,
    ExecuteProcess,
    LogInfo,
    OpaqueFunction,
    Shutdown,
    TimerAction,
)
from launch.substitutions import LaunchConfiguration

from intuitive_physics.errors import InvalidInputError
from intuitive_physics_bringup.checks import check_names
from intuitive_physics_bringup.connections import CAMERAS, session_topics
from launch import Action, LaunchContext, LaunchDescription

ARGUMENTS = {
    "output": ("session", "folder of the bag, which must not exist"),
    "namespace": ("", "of the robot; empty: none"),
    "camera": ("realsense", f"topics of which driver are recorded: {', '.join(CAMERAS)}"),
    "color": ("false", "true: record colour images, and depth images registered to them"),
    "clouds": ("false", "true: record point clouds instead of depth images"),
}
"""Default and meaning of each argument."""

LEAST_FREE_SPACE = 5_000_000_000
"""Bytes below which a disk is warned of: depth images of 640 x 480 at 30 Hz take 1.1 GB a
minute."""

LOOK_EVERY = 10.0
"""s between two measurements of the free space."""


def generate_launch_description() -> LaunchDescription:
    """Describe the recorder."""
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, (default, text) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=recorder)])


def recorder(context: LaunchContext) -> list[Action]:
    """Return `ros2 bag record` with its arguments, once these are known to be good."""
    check_names(sys.argv, Path(__file__).name, ARGUMENTS)
    given = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    check(given)
    # Launch must end with the recorder, although the timer of `disk_watch` is still active.
    recorded = ExecuteProcess(cmd=command(given), output="screen", on_exit=Shutdown())
    return [recorded, *disk_watch(Path(given["output"]))]


def disk_watch(output: Path, *, was_low: bool = False) -> list[Action]:
    """Warn once when the disk of a folder fills, and measure again later."""
    folder = next(parent for parent in output.absolute().parents if parent.exists())
    free = shutil.disk_usage(folder).free
    is_low = free < LEAST_FREE_SPACE
    warning = LogInfo(
        msg=f"warning: the disk of {output} has {free} bytes free, expected at least "
        f"{LEAST_FREE_SPACE}; make room, or end the recording before it is full"
    )
    again = OpaqueFunction(function=lambda _: disk_watch(output, was_low=is_low))
    later = TimerAction(period=LOOK_EVERY, actions=[again])
    return [warning, later] if is_low and not was_low else [later]


def check(given: Mapping[str, str]) -> None:
    """Refuse invalid arguments, and a machine without rosbag2, in one line."""
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
