"""`pip install .` brings what the packages declare for colcon; `.venv` runs src/ itself."""

from __future__ import annotations

import importlib.util
import os
import sys
from collections import defaultdict
from pathlib import Path

import pytest
from tools.link_packages import console_scripts, described
from tools.source_tree import PYTHON_PACKAGES

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).parent.parent
ROS_PACKAGES = {"intuitive_physics_ros", "intuitive_physics_bringup"}
"""Packages that import ROS anywhere."""

WITHOUT_ROS = [name for name in PYTHON_PACKAGES if name not in ROS_PACKAGES]
SETUPS = {name: described(ROOT / "src" / name) for name in PYTHON_PACKAGES}
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PROJECT = PYPROJECT["project"]
WHEEL = PYPROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]


def test_install_has_all_packages_without_ros():
    assert WHEEL["packages"] == [f"src/{name}/{name}" for name in WITHOUT_ROS]
    assert WHEEL["dev-mode-dirs"] == [f"src/{name}" for name in PYTHON_PACKAGES]


def test_install_requires_the_requirements_of_the_packages():
    required = {one for name in WITHOUT_ROS for one in SETUPS[name]["install_requires"]}
    # Only ament asks for setuptools.
    assert PROJECT["dependencies"] == sorted(required - set(WITHOUT_ROS) - {"setuptools"})
    assert {SETUPS[name]["python_requires"] for name in WITHOUT_ROS} == {PROJECT["requires-python"]}


def test_install_has_the_extras_of_the_packages():
    extras = defaultdict(set)
    for name in WITHOUT_ROS:
        for extra, required in SETUPS[name]["extras_require"].items():
            extras[extra] |= set(required)
    assert PROJECT["optional-dependencies"] == {name: sorted(of) for name, of in extras.items()}


def test_install_has_the_entry_points_of_the_packages():
    groups = defaultdict(dict)
    for name in WITHOUT_ROS:
        for group, lines in SETUPS[name].get("entry_points", {}).items():
            groups[group].update(line.split(" = ") for line in lines)
    # Executables of nodes are for `ros2 run`.
    executables = {
        name: target
        for name, target in groups.pop("console_scripts").items()
        if ".nodes." not in target and target.split(".")[0] not in ROS_PACKAGES
    }
    assert PROJECT["scripts"] == executables
    assert PROJECT["entry-points"] == groups


@pytest.mark.parametrize("package", PYTHON_PACKAGES)
def test_a_change_in_a_package_needs_no_build(package):
    source = ROOT / "src" / package
    spec = importlib.util.find_spec(package)
    assert Path(spec.origin) == source / package / "__init__.py"
    for place, files in SETUPS[package]["data_files"]:
        for file in files:
            installed = Path(sys.prefix) / place / Path(file).name
            assert installed.resolve() == source / file
    programs = Path(sys.prefix) / "lib" / package
    for name, module, _ in console_scripts(SETUPS[package]):
        assert os.access(programs / name, os.X_OK)
        assert f"from {module} import" in (programs / name).read_text(encoding="utf-8")


def test_a_change_in_an_example_needs_no_build():
    package = "intuitive_physics_examples"
    for source in (ROOT / "src" / package / "nodes").glob("*.py"):
        assert (Path(sys.prefix) / "lib" / package / source.name).resolve() == source
