"""Perception, learner and predictor; optionally a bag to replay and RViz.

All arguments are checked before the first process is started. An error that only a node can find,
such as a wrong value of a parameter or a damaged bag, ends everything with one sentence.
"""

import os
import re
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from ament_index_python.packages import (
    PackageNotFoundError,
    get_package_prefix,
    get_package_share_directory,
)
from launch.actions import (
    DeclareLaunchArgument,
    EmitEvent,
    LogInfo,
    OpaqueFunction,
    RegisterEventHandler,
    SetEnvironmentVariable,
)
from launch.event_handlers import OnProcessExit, OnProcessIO, OnProcessStart
from launch.events import Shutdown
from launch.events.process import ProcessExited, ProcessIO, ProcessStarted
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from intuitive_physics.errors import InvalidInputError
from intuitive_physics_bringup.checks import (
    check_bag,
    check_names,
    check_parameter_file,
    check_rate,
)
from intuitive_physics_bringup.connections import (
    CAMERAS,
    NODES,
    PEERS,
    RANGE,
    RANGES,
    camera_name,
    clock_rules,
    default_peers,
    default_range,
    discovery_environment,
    with_compressed,
)
from intuitive_physics_bringup.failures import Failures
from intuitive_physics_ros.topics import OBJECT_STATES, OBSERVATIONS
from launch import Action, LaunchContext, LaunchDescription

SHARE = Path(get_package_share_directory("intuitive_physics_bringup"))

ARGUMENTS = {
    "namespace": ("", "of all nodes and topics, one for each robot; empty: none"),
    "params_file": (str(SHARE / "config" / "nodes.yaml"), "YAML file with parameters of the nodes"),
    "camera": ("realsense", f"topics of which driver are heard: {', '.join(CAMERAS)}"),
    "depth_image": ("", "topic of the depth images; empty: that of the camera"),
    "camera_info": ("", "topic of their camera's intrinsics; empty: that of the camera"),
    "points": ("", "topic of point clouds, where there are no images; empty: that of the camera"),
    "imu": (
        "",
        "topic of an IMU, heard with gravity_source: imu only; empty: that of the camera (a "
        "realsense needs enable_gyro, enable_accel and unite_imu_method:=2 of its own launch file)",
    ),
    "color": (
        "",
        "true: depth and colour images of the camera that are registered to each other (a "
        "realsense needs align_depth.enable:=true of its own launch file); or the "
        "topic of colour images registered to depth_image; empty: as params_file says",
    ),
    "further_cameras": (
        "",
        "namespaces of further cameras of the same scene and driver, in place of the driver's own "
        "(camera/camera of a realsense), divided by ;; tf has all in fixed_frame",
    ),
    "fixed_frame": (
        "",
        "frame that stands still, in which tf has the camera where it moves, or several; empty: as "
        "params_file says",
    ),
    "log_level": ("info", "of the nodes: debug, info, warn, error or fatal"),
    "respawn": ("false", "start a node that ended again"),
    "autostart": (
        "true",
        "configure and activate the nodes; false leaves that to a lifecycle manager",
    ),
    "bag": ("", "bag to replay; empty: none"),
    "rate": ("1.0", "bag seconds in one real second"),
    "loop": ("false", "replay the bag again and again"),
    "use_sim_time": ("", "take time from the clock of the bag; empty: if there is a bag"),
    "rviz": ("false", "show everything in RViz"),
    "discovery": (
        default_range(),
        f"where other nodes are looked for: {', '.join(RANGES)}; what the environment says, else "
        "this machine",
    ),
    "peers": (default_peers(), "other machines that are looked for, addresses divided by ;"),
    "enclaves": (
        "",
        "where the nodes' enclaves are in a keystore of SROS2, used with ROS_SECURITY_ENABLE only; "
        "empty: /intuitive_physics below the namespace",
    ),
}
"""Default and meaning of each argument."""

ONLY_HERE = (
    "looks for other nodes on this machine only; discovery:=subnet or peers:=ADDRESS finds others"
)
"""Logged at the start: a robot and RViz on a laptop do not see each other otherwise."""

RESPAWN_DELAY = 0.5
"""s between the end of a node and its next start."""

REPLAY_PATIENCE = 300.0
"""s that the bag waits for the nodes, whose first start compiles their kernels."""

NAMESPACE = re.compile(r"(/?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*)?")
"""Pattern of a valid namespace."""

LOG_LEVELS = ("debug", "info", "warn", "error", "fatal")
"""Values of `log_level`."""


def generate_launch_description() -> LaunchDescription:
    """Describe the suite."""
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, (default, text) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=processes)])


def processes(context: LaunchContext) -> list[Action]:
    """Return all that is started, once every argument is known to be good."""
    check_names(sys.argv, Path(__file__).name, ARGUMENTS)
    given = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    check(given)
    variables = discovery_environment(given["discovery"], given["peers"])
    started: list[Action] = [
        SetEnvironmentVariable(name, value) for name, value in variables.items()
    ]
    if variables[RANGE] == "LOCALHOST" and not variables[PEERS]:
        started.append(LogInfo(msg=ONLY_HERE))
    started += follow(Failures(respawn=as_bool("respawn", given["respawn"])))
    started += [node(name, given) for name in NODES]
    if given["bag"]:
        started.append(replay(given))
    if as_bool("rviz", given["rviz"]):
        started.append(rviz(given))
    return started


def follow(failures: Failures) -> list[Action]:
    """Return what ends everything when one process fails."""

    def ended(event: ProcessExited, context: LaunchContext) -> list[Action] | None:
        # After Ctrl-C nothing is a failure any more.
        code = 0 if context.is_shutdown else event.returncode
        ends_all = failures.ended(event.process_name, code)
        if failures.sentence:
            # Launch logs it as its last line, and returns 1.
            raise RuntimeError(failures.sentence)
        return [EmitEvent(event=Shutdown(reason="a process failed"))] if ends_all else None

    def started(event: ProcessStarted, _: LaunchContext) -> None:
        failures.started(event.process_name)

    def heard(event: ProcessIO) -> None:
        failures.heard(event.process_name, event.text.decode(errors="replace"))

    handlers = (
        OnProcessStart(on_start=started),
        OnProcessIO(on_stderr=heard),
        OnProcessExit(on_exit=ended),
    )
    return [RegisterEventHandler(handler) for handler in handlers]


def check(given: Mapping[str, str]) -> None:
    """Refuse invalid arguments in one line."""
    _expect(given, "namespace", NAMESPACE.fullmatch, "letters, digits and _, parts divided by /")
    _expect(given, "camera", CAMERAS.__contains__, f"one of {', '.join(CAMERAS)}")
    _expect(
        given,
        "further_cameras",
        lambda _: all(NAMESPACE.fullmatch(one) for one in further(given)),
        "namespaces divided by ;",
    )
    _expect(given, "log_level", LOG_LEVELS.__contains__, f"one of {', '.join(LOG_LEVELS)}")
    _expect(given, "params_file", lambda path: Path(path).is_file(), "the path of a YAML file")
    check_parameter_file(given["params_file"], prefix(given))
    check_bag(given["bag"])
    check_rate(given["rate"])
    for name in ("respawn", "autostart", "loop", "rviz"):
        as_bool(name, given[name])
    if given["use_sim_time"]:
        as_bool("use_sim_time", given["use_sim_time"])
    if as_bool("rviz", given["rviz"]):
        try:
            get_package_prefix("rviz2")
        except PackageNotFoundError:
            raise InvalidInputError(
                "rviz is true, but rviz2 is not installed; expected rviz:=false, or rviz2 "
                "(sudo apt install ros-jazzy-rviz2)"
            ) from None


def node(name: str, given: Mapping[str, str]) -> Node:
    """Return one of the three nodes."""
    set_here: dict[str, Any] = {
        "use_sim_time": uses_sim_time(given),
        "autostart": as_bool("autostart", given["autostart"]),
    }
    remappings = clock_rules(prefix(given), replayed=bool(given["bag"]))
    if name == "perception_node":
        remappings += inputs(given)
        if given["color"]:
            set_here["use_color"] = given["color"] != "false"
        if given["fixed_frame"]:
            set_here["fixed_frame"] = given["fixed_frame"]
        if further(given):
            set_here["further_cameras"] = [camera_name(one) for one in further(given)]
    defaults: dict[str, Any] = {}
    if name == "predictor_node":
        defaults["calibration_file"] = calibration_file(given)
    respawn = as_bool("respawn", given["respawn"])
    return Node(
        package=NODES[name],
        executable=name,
        name=name,
        namespace=given["namespace"],
        output="screen",
        parameters=[defaults, given["params_file"], set_here],
        remappings=remappings,
        respawn=respawn,
        respawn_delay=RESPAWN_DELAY,
        ros_arguments=["--log-level", given["log_level"], *enclave(name, given)],
    )


def calibration_file(given: Mapping[str, str]) -> str:
    """Return where the predictor keeps how well it predicts: beside the learner's database."""
    home = Path(os.environ.get("XDG_DATA_HOME", ""))
    if not home.is_absolute():
        home = Path.home() / ".local" / "share"
    folder = home / "intuitive_physics" / prefix(given).strip("/")
    return str(folder / "calibration.json")


def enclave(name: str, given: Mapping[str, str]) -> list[str]:
    """Return where the keys of a node are, as an argument of it."""
    folder = given["enclaves"] or f"{prefix(given)}/intuitive_physics"
    return ["--enclave", f"{folder}/{name}"]


def inputs(given: Mapping[str, str]) -> list[tuple[str, str]]:
    """Return the topic of each of perception's inputs."""
    topics = CAMERAS[given["camera"]].topics(color=given["color"] == "true")
    named = {
        "~/depth/image": given["depth_image"],
        "~/depth/camera_info": given["camera_info"],
        "~/points": given["points"],
        "~/imu": given["imu"],
        "~/color/image": "" if given["color"] in ("true", "false") else given["color"],
    }
    chosen = with_compressed({name: named[name] or topic for name, topic in topics.items()})
    for namespace in further(given):
        camera = CAMERAS[given["camera"]]
        chosen |= camera.further_topics(namespace, color=given["color"] == "true")
    return list(chosen.items())


def further(given: Mapping[str, str]) -> list[str]:
    """Return the namespaces of further cameras."""
    return [one for one in given["further_cameras"].split(";") if one]


def replay(given: Mapping[str, str]) -> Node:
    """Return what plays the bag to the nodes, once they listen."""
    return Node(
        package="intuitive_physics_recordings",
        executable="replay_node",
        namespace=given["namespace"],
        output="screen",
        parameters=[
            {
                "bag": given["bag"],
                "rate": float(given["rate"]),
                "loop": as_bool("loop", given["loop"]),
                "topic_prefix": prefix(given),
                "inputs_only": True,
                "wait_for_subscribers": [OBJECT_STATES, OBSERVATIONS],
                "wait_timeout": REPLAY_PATIENCE,
            }
        ],
        ros_arguments=["--log-level", given["log_level"], *enclave("replay_node", given)],
    )


def rviz(given: Mapping[str, str]) -> Node:
    """Return RViz, whose topics are relative to the namespace as well."""
    return Node(
        package="rviz2",
        executable="rviz2",
        namespace=given["namespace"],
        arguments=[
            "-d",
            str(SHARE / "rviz" / "intuitive_physics.rviz"),
            "-f",
            f"{prefix(given)}/intuitive_physics/environment".lstrip("/"),
        ],
        parameters=[{"use_sim_time": uses_sim_time(given)}],
        remappings=[
            ("perception_node/points", dict(inputs(given))["~/points"]),
            *clock_rules(prefix(given), replayed=bool(given["bag"])),
        ],
        ros_arguments=enclave("operator", given),
    )


def prefix(given: Mapping[str, str]) -> str:
    """Return the namespace with a slash before it, empty for none."""
    namespace = given["namespace"].strip("/")
    return f"/{namespace}" if namespace else ""


def uses_sim_time(given: Mapping[str, str]) -> bool:
    """Whether nodes take time from a clock that is published."""
    if given["use_sim_time"]:
        return as_bool("use_sim_time", given["use_sim_time"])
    return bool(given["bag"])


def as_bool(name: str, text: str) -> bool:
    """Return an argument as a bool; InvalidInputError when it is neither true nor false."""
    value = {"true": True, "1": True, "false": False, "0": False}.get(text.lower())
    if value is None:
        raise InvalidInputError(f"{name} is {text!r}; expected true or false")
    return value


def _expect(
    given: Mapping[str, str], name: str, holds: Callable[[str], object], expected: str
) -> None:
    if not holds(given[name]):
        raise InvalidInputError(f"{name} is {given[name]!r}; expected {expected}")
