"""The launch file: the processes it starts, and the arguments it refuses."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import pytest

from intuitive_physics.errors import InvalidInputError
from intuitive_physics_bringup.connections import CAMERAS, NODES, clock_rules

LAUNCH_FILE = Path(__file__).parent.parent / "launch" / "intuitive_physics.launch.py"


def loaded():
    spec = importlib.util.spec_from_file_location("suite_launch", LAUNCH_FILE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def arguments(suite, **given):
    return {name: default for name, (default, _) in suite.ARGUMENTS.items()} | given


def renamed(action) -> dict[str, str]:
    """Return the remapping rules of a launch action, new name by old name."""
    rules = action._Node__remappings
    return dict(tuple("".join(one.text for one in side) for side in rule) for rule in rules)


@pytest.mark.parametrize(
    ("prefix", "replayed", "clock"),
    [("/left", True, "/left/clock"), ("/left", False, None), ("", True, None), ("", False, None)],
)
def test_time_is_below_the_namespace_with_a_bag_only(prefix, replayed, clock):
    assert dict(clock_rules(prefix, replayed=replayed)).get("/clock") == clock


@pytest.mark.needs("ros2launch")
@pytest.mark.parametrize(
    ("given", "clock"),
    [
        ({"namespace": "left", "use_sim_time": "true"}, None),
        ({"namespace": "left", "bag": "monday"}, "/left/clock"),
        ({"bag": "monday"}, None),
    ],
)
def test_nodes_and_rviz_take_the_time_of_a_simulator_or_of_their_bag(monkeypatch, given, clock):
    monkeypatch.setenv("AMENT_PREFIX_PATH", sys.prefix)
    suite = loaded()
    given = arguments(suite, **given)
    assert suite.uses_sim_time(given)
    for action in [*(suite.node(name, given) for name in NODES), suite.rviz(given)]:
        assert renamed(action).get("/clock") == clock


@pytest.mark.parametrize(
    ("camera", "namespace", "name", "image"),
    [
        ("realsense", "rear/camera", "rear_camera", "rear/camera/depth/image_rect_raw"),
        ("azure_kinect", "/rear", "rear", "/rear/depth/image_raw"),
        ("zed", "zed2/zed_node", "zed2_zed_node", "zed2/zed_node/depth/depth_registered"),
    ],
)
def test_a_further_camera_has_the_topics_of_its_driver_in_its_namespace(
    camera, namespace, name, image
):
    topics = CAMERAS[camera].further_topics(namespace)
    assert topics[f"~/{name}/depth/image"] == image
    assert topics[f"~/{name}/depth/image/compressedDepth"] == f"{image}/compressedDepth"
    assert len(topics) == 6


@pytest.mark.needs("ros2launch")
def test_further_cameras_are_parameters_and_rules_of_perception(monkeypatch):
    monkeypatch.setenv("AMENT_PREFIX_PATH", sys.prefix)
    suite = loaded()
    given = arguments(suite, further_cameras="rear/camera;side/camera", fixed_frame="map")
    suite.check(given)
    rules = renamed(suite.node("perception_node", given))
    assert rules["~/side_camera/points"] == "side/camera/depth/color/points"
    assert rules["~/points"] == "camera/camera/depth/color/points"


@pytest.mark.needs("ros2launch")
@pytest.mark.parametrize(
    ("name", "value", "complaint"),
    [
        ("rviz", "maybe", "rviz is 'maybe'; expected true or false"),
        (
            "params_file",
            "nowhere.yaml",
            "params_file is 'nowhere.yaml'; expected the path of a YAML",
        ),
        ("camera", "pinhole", "camera is 'pinhole'; expected one of realsense, zed, azure_kinect"),
        ("namespace", "a b", "namespace is 'a b'; expected letters, digits and _"),
        ("further_cameras", "a;b c", "further_cameras is 'a;b c'; expected namespaces divided by"),
        ("log_level", "loud", "log_level is 'loud'; expected one of debug, info"),
        ("rate", "-1", "rate is '-1'; expected a number from 0.01 to 100"),
        ("bag", "nowhere", "bag is 'nowhere'; expected the path of a bag"),
        ("respawn", "often", "respawn is 'often'; expected true or false"),
        ("use_sim_time", "perhaps", "use_sim_time is 'perhaps'; expected true or false"),
    ],
)
def test_bad_arguments_are_refused(monkeypatch, name, value, complaint):
    monkeypatch.setenv("AMENT_PREFIX_PATH", sys.prefix)
    suite = loaded()
    with pytest.raises(InvalidInputError) as error:
        suite.check(arguments(suite, **{name: value}))
    assert complaint in str(error.value)
