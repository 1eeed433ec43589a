"""Every key of a package.xml is one that rosdep or ROS knows, and what is imported is declared."""

from __future__ import annotations

import json
import re
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
from tools.source_tree import PACKAGES, PYTHON_PACKAGES, ROOT, imported_packages, syntax_of

ROSDEP_KEYS = {
    "python3-hypothesis",
    "python3-matplotlib",
    "python3-mujoco-pip",
    "python3-numba",
    "python3-numpy",
    "python3-open3d-pip",
    "python3-pil",
    "python3-pybullet-pip",
    "python3-pytest",
    "python3-rosbags-pip",
    "python3-scipy",
    "python3-yaml",
}
"""Keys of rosdep/python.yaml in ros/rosdistro that resolve on Ubuntu; checked in its commit 8468e88
of 22 August 2026. Add a key only after looking it up there."""

ROS_PACKAGES = {
    "action_msgs",
    "ament_cmake",
    "ament_index_python",
    "builtin_interfaces",
    "diagnostic_msgs",
    "geometry_msgs",
    "launch",
    "launch_ros",
    "lifecycle_msgs",
    "nav_msgs",
    "rcl_interfaces",
    "rclcpp",
    "rclpy",
    "ros2cli",
    "ros2pkg",
    "rosgraph_msgs",
    "rosidl_default_generators",
    "rosidl_default_runtime",
    "rviz2",
    "sensor_msgs",
    "sros2",
    "std_msgs",
    "std_srvs",
    "tf2_msgs",
    "tf2_ros_py",
    "vision_msgs",
    "visualization_msgs",
}
"""Packages that jazzy/distribution.yaml of the same commit releases."""

KEY_OF_IMPORT = {
    "PIL": "python3-pil",
    "hypothesis": "python3-hypothesis",
    "matplotlib": "python3-matplotlib",
    "mpl_toolkits": "python3-matplotlib",
    "mujoco": "python3-mujoco-pip",
    "numba": "python3-numba",
    "numpy": "python3-numpy",
    "open3d": "python3-open3d-pip",
    "pybullet": "python3-pybullet-pip",
    "pytest": "python3-pytest",
    "rosbags": "python3-rosbags-pip",
    "scipy": "python3-scipy",
    "tf2_ros": "tf2_ros_py",
    "yaml": "python3-yaml",
}
"""The key that brings a Python package, where it has another name."""

FROM_PIP = {
    "cma": "cma",
    "distributed": "distributed",
    "lz4": "lz4",
    "plotly": "plotly",
    "rerun": "rerun-sdk",
    "scoringrules": "scoringrules",
}
"""Python packages without a rosdep key, with the name that `pip install` takes."""


def manifest(package: str) -> Path:
    return ROOT / "src" / package / "package.xml"


def declared_keys(package: str) -> set[str | None]:
    root = ElementTree.parse(manifest(package)).getroot()
    return {element.text for element in root if element.tag.endswith("depend")}


@pytest.mark.parametrize("package", PACKAGES)
def test_every_key_is_known(package):
    unknown = declared_keys(package) - ROSDEP_KEYS - ROS_PACKAGES - set(PACKAGES)
    assert not unknown, f"{package} declares {unknown}, which rosdep install does not find"


@pytest.mark.parametrize("package", PYTHON_PACKAGES)
def test_imported_packages_are_declared(package):
    imported = {name for _, syntax in syntax_of(package) for name in imported_packages(syntax)}
    outside = imported - set(sys.stdlib_module_names) - set(PACKAGES)
    needed = {KEY_OF_IMPORT.get(name, name) for name in outside - set(FROM_PIP)}
    lacking = needed - declared_keys(package)
    assert not lacking, f"package.xml of {package} lacks {sorted(lacking)}"


@pytest.mark.parametrize("package", PYTHON_PACKAGES)
def test_packages_from_pip_are_named_in_the_manifest(package):
    text = manifest(package).read_text(encoding="utf-8")
    for path, syntax in syntax_of(package):
        for name in {FROM_PIP[one] for one in imported_packages(syntax) & FROM_PIP.keys()}:
            assert f"pip install {name}" in text, (
                f"{path} imports {name}, which has no rosdep key; "
                f"expected a comment with “pip install {name}” in {package}/package.xml"
            )


@pytest.mark.parametrize("package", PACKAGES)
def test_no_link_leaves_a_package(package):
    folder = manifest(package).parent
    for path in folder.rglob("*"):
        if path.is_symlink():
            assert path.resolve().is_relative_to(folder.resolve()), f"{path} is a link out of it"


def test_definitions_of_messages_are_those_of_the_message_package():
    source = manifest("intuitive_physics_msgs").parent / "msg"
    package = "intuitive_physics_recordings"
    copies = manifest(package).parent / package / "message_definitions"
    texts = [{path.name: path.read_bytes() for path in at.iterdir()} for at in (source, copies)]
    assert texts[0] == texts[1], f"run: rm {copies}/* && cp {source}/*.msg {copies}/"


def test_the_container_installs_what_rosdep_has_no_key_for():
    dockerfile = (ROOT / "Dockerfile").read_text(encoding="utf-8")
    installed = set(re.findall(r"pip install (.*)", dockerfile)[0].split())
    # Only a command that shows recordings in its own program needs that program.
    assert installed == set(FROM_PIP.values()) - {"rerun-sdk"}
    container = ROOT / ".devcontainer" / "devcontainer.json"
    described = json.loads(container.read_text(encoding="utf-8"))
    assert (container.parent / described["build"]["dockerfile"]).resolve() == ROOT / "Dockerfile"
