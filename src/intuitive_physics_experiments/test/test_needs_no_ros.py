"""Everything outside a `nodes/` folder works where ROS is not installed."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path

import pytest

LIBRARIES = (
    "intuitive_physics",
    "intuitive_physics_perception",
    "intuitive_physics_learner",
    "intuitive_physics_predictor",
    "intuitive_physics_recordings",
    "intuitive_physics_cli",
    "intuitive_physics_experiments",
)

WITHOUT_ROS = """
import sys

class NoRos:
    def find_spec(self, name, path=None, target=None):
        top = name.split(".")[0]
        if top in ("rclpy", "intuitive_physics_ros") or top.endswith(("_msgs", "_interfaces")):
            raise ImportError(name)

sys.meta_path.insert(0, NoRos())
"""


def modules(package: str) -> list[str]:
    spec = importlib.util.find_spec(package)
    assert spec is not None
    assert spec.origin is not None
    folder = Path(spec.origin).parent
    paths = (path.relative_to(folder.parent) for path in folder.rglob("*.py"))
    return [
        ".".join(path.with_suffix("").parts)
        for path in sorted(paths)
        if "nodes" not in path.parts and path.stem not in ("__main__", "__init__")
    ]


@pytest.mark.parametrize("package", LIBRARIES)
def test_libraries_need_no_ros(package):
    code = WITHOUT_ROS + "".join(f"import {name}\n" for name in modules(package))
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
