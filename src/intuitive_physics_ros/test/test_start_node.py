"""A node's executable ends clean at a signal before its own module is imported."""

from __future__ import annotations

import ast
import os
import signal
import stat
import sys
from pathlib import Path

import pytest

from intuitive_physics.processes import ChildProcess

PATIENCE = 30.0
"""s to wait for what takes well under one, on a machine that is busy with other things."""

SOURCE = Path(__file__).parents[2]

EXECUTABLE = f"""#!{sys.executable}
import sys
from intuitive_physics_ros.lifecycle.start_node import main
sys.exit(main())
"""

NODE = """
import sys, time
if "--slow" in sys.argv:
    print("imports", flush=True)
    time.sleep(60)

def main():
    return 3
"""


@pytest.fixture
def executable(tmp_path):
    """Make the executable of an installed node, and the environment it is installed in."""
    folder = tmp_path / "any_package-1.0.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: any_package\nVersion: 1.0\n")
    (folder / "entry_points.txt").write_text(
        "[intuitive_physics.nodes]\nany_node = any_module:main"
    )
    (tmp_path / "any_module.py").write_text(NODE)

    def make(name="any_node"):
        file = tmp_path / name
        file.write_text(EXECUTABLE)
        file.chmod(file.stat().st_mode | stat.S_IXUSR)
        return file

    return make


def run(file, *arguments):
    path = os.pathsep.join([str(file.parent), os.environ.get("PYTHONPATH", "")])
    return ChildProcess([str(file), *arguments], environment={**os.environ, "PYTHONPATH": path})


def test_executable_runs_the_node_of_its_name(executable):
    process = run(executable())
    assert process.wait(PATIENCE) == 3
    assert process.output == ""


def test_another_name_is_one_clear_line(executable):
    process = run(executable("other_node"))
    assert process.wait(PATIENCE) == 1
    assert process.output.startswith("other_node: error: no node has this name; expected one of ")
    assert "any_node" in process.output


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_while_it_is_imported_ends_it_clean(executable, number):
    process = run(executable(), "--slow")
    process.wait_for("imports\n", PATIENCE)
    assert process.stop(number) == 0
    assert process.output == "imports\n"


def entry_points(setup):
    for node in ast.walk(ast.parse(setup.read_text())):
        if isinstance(node, ast.keyword) and node.arg == "entry_points":
            return ast.literal_eval(node.value)
    return {}


def test_every_node_is_started_so():
    nodes = {}
    for setup in sorted(SOURCE.glob("*/setup.py")):
        found = entry_points(setup)
        for one in found.get("intuitive_physics.nodes", []):
            name, _, target = one.partition(" = ")
            nodes[name] = target
            assert (
                f"{name} = intuitive_physics_ros.lifecycle.start_node:main"
                in found["console_scripts"]
            )
    assert sorted(nodes) == [
        *("learner_node", "perception_node", "pose_bridge_node", "predictor_node", "replay_node")
    ]
    for target in nodes.values():
        module, _, function = target.partition(":")
        package = module.split(".")[0]
        file = SOURCE / package / Path(*module.split(".")).with_suffix(".py")
        assert f"def {function}()" in file.read_text()
