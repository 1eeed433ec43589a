"""The layout's rules: arrows point down only, ROS stays in its rooms, manifests are whole."""

from __future__ import annotations

import ast
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

SOURCE = Path(__file__).parent.parent / "src"
PACKAGES = sorted(path.parent.name for path in SOURCE.glob("*/package.xml"))
PYTHON_PACKAGES = sorted(path.parent.name for path in SOURCE.glob("*/setup.py"))

LIBRARY = {"intuitive_physics"}
MAY_IMPORT: dict[str, set[str]] = {
    "intuitive_physics": set(),
    "intuitive_physics_ros": LIBRARY,
    "intuitive_physics_perception": LIBRARY,
    "intuitive_physics_learner": LIBRARY,
    "intuitive_physics_predictor": LIBRARY,
    "intuitive_physics_recordings": LIBRARY,
    "intuitive_physics_cli": set(PYTHON_PACKAGES)
    - {"intuitive_physics_ros", "intuitive_physics_bringup"},
    "intuitive_physics_experiments": set(PYTHON_PACKAGES),
    "intuitive_physics_bringup": {"intuitive_physics_ros"},
}
ROS_ROOMS = {"intuitive_physics_ros", "intuitive_physics_bringup"}
ROS_MODULES = {"rclpy", "rcl_interfaces", "builtin_interfaces", "launch", "launch_ros"}


def modules(package: str) -> list[Path]:
    return sorted((SOURCE / package / package).rglob("*.py"))


def imported(path: Path) -> set[str]:
    """Top-level names that a module imports, anywhere in it."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names.add(node.module.split(".")[0])
    return names


@pytest.mark.parametrize("package", PYTHON_PACKAGES)
def test_arrows_point_down_only(package):
    for path in modules(package):
        allowed = MAY_IMPORT[package] | {package}
        if path.parent.name == "nodes":
            allowed = allowed | {"intuitive_physics_ros", "intuitive_physics_msgs"}
        if package in ROS_ROOMS:
            allowed = allowed | {"intuitive_physics_msgs"}
        ours = {name for name in imported(path) if name in PACKAGES}
        assert ours <= allowed, f"{path} imports {ours - allowed}"


@pytest.mark.parametrize("package", sorted(set(PYTHON_PACKAGES) - ROS_ROOMS))
def test_ros_stays_in_its_rooms(package):
    for path in modules(package):
        if path.parent.name != "nodes":
            ros = {n for n in imported(path) if n in ROS_MODULES or n.endswith("_msgs")}
            assert not ros, f"{path} imports {ros}"


@pytest.mark.parametrize("package", PACKAGES)
def test_manifest_is_whole(package):
    root = ElementTree.parse(SOURCE / package / "package.xml").getroot()
    assert root.findtext("name") == package
    assert root.findtext("license") == "Apache-2.0"
    assert root.findtext("version") == "0.1.0"
    assert root.findtext("description")
    assert root.find("maintainer") is not None
    declared = {element.text for tag in ("depend", "exec_depend") for element in root.findall(tag)}
    if package in PYTHON_PACKAGES:
        used = set().union(*(imported(path) for path in modules(package))) & set(PACKAGES)
        assert used - {package} <= declared, f"{package} lacks {used - declared}"
        assert (SOURCE / package / "resource" / package).exists()
