"""Needs of tests beyond set-up: each asks for it by name, as `pytest.mark.needs("chromium")`.

A test whose needs are not met is skipped with one sentence. A module asks by `pytestmark`, which is
read before the module is imported, so that it can import what it asks for.
"""

from __future__ import annotations

import ast
import importlib.util
import os
import shutil
import subprocess
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent

RECORDINGS = ROOT.parent / "shared" / "data" / "real"
"""Recordings of others, beside the clone."""

BROWSER = shutil.which("chromium") or shutil.which("chromium-browser")
"""Path of a browser that runs without a display."""


@dataclass(frozen=True)
class Need:
    """Something a test needs beyond set-up: whether it is there, and what brings it."""

    is_met: Callable[[], bool]
    remedy: str


def _module(name: str, remedy: str) -> Need:
    return Need(lambda: importlib.util.find_spec(name) is not None, remedy)


def _in_a_clone() -> bool:
    asked = ["git", "-C", str(ROOT), "rev-parse"]
    return bool(shutil.which("git")) and not subprocess.run(asked, capture_output=True).returncode


ROS_TOOLS = "../shared/ros/install_tools.sh .venv"

NEEDS = {
    "chromium": Need(lambda: BROWSER is not None, "apt-get install chromium"),
    "clone": Need(_in_a_clone, "git clone"),
    "emcee": _module("emcee", "tools/bench_packages.sh emcee"),
    "foxglove": _module("foxglove", "pip install foxglove-sdk"),
    "openssl": Need(lambda: shutil.which("openssl") is not None, "apt-get install openssl"),
    "rclpy": _module("rclpy", "make setup"),
    "recordings": Need(RECORDINGS.exists, f"put them into {RECORDINGS}"),
    "rerun": _module("rerun", "pip install rerun-sdk"),
    "root": Need(lambda: os.geteuid() == 0, "run the test as root"),
    "ros2launch": _module("ros2launch", ROS_TOOLS),
    "tf2_msgs": _module("tf2_msgs", ROS_TOOLS),
    "tf2_ros": _module("tf2_ros", ROS_TOOLS),
    "vision_msgs": _module("vision_msgs", ROS_TOOLS),
}
"""All that tests may ask for."""


def asked_by(expressions: Iterable[ast.expr]) -> set[str]:
    """Return the names that marks in expressions of a source text ask for."""
    return {
        str(argument.value)
        for expression in expressions
        for node in ast.walk(expression)
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "pytest.mark.needs"
        for argument in node.args
        if isinstance(argument, ast.Constant)
    }


def asked_by_module(tree: ast.Module) -> set[str]:
    """Return the names that a module asks for as a whole, by its `pytestmark`."""
    return asked_by(
        statement.value
        for statement in tree.body
        if isinstance(statement, ast.Assign) and ast.unparse(statement.targets[0]) == "pytestmark"
    )


def lacking(names: Iterable[str]) -> str:
    """Return one sentence on those needs that are not met, an empty text where all are."""
    needs = sorted(names)
    if unknown := [name for name in needs if name not in NEEDS]:
        raise pytest.UsageError(
            f"a test needs {', '.join(unknown)}; expected some of {', '.join(NEEDS)}"
        )
    missing = [name for name in needs if not NEEDS[name].is_met()]
    remedies = dict.fromkeys(NEEDS[name].remedy for name in missing)
    return f"lacks {', '.join(missing)}; to bring it: {'; '.join(remedies)}" if missing else ""


def pytest_make_collect_report(collector: pytest.Collector) -> pytest.CollectReport | None:
    """Skip a module that lacks what it asks for before it is imported."""
    if not isinstance(collector, pytest.Module):
        return None
    tree = ast.parse(collector.path.read_text(encoding="utf-8"))
    if sentence := lacking(asked_by_module(tree)):
        place = (str(collector.path), 1, f"Skipped: {sentence}")
        return pytest.CollectReport(collector.nodeid, "skipped", place, [])
    return None


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Skip each test that lacks what it asks for."""
    for item in items:
        asked = {name for mark in item.iter_markers("needs") for name in mark.args}
        if sentence := lacking(asked):
            item.add_marker(pytest.mark.skip(reason=sentence))
