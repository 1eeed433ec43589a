"""RGBD in, learned parameters and distributions out: real nodes, a real bag, real middleware."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from intuitive_physics_msgs.srv import GetStaticParameters

from intuitive_physics_bringup.connections import module
from intuitive_physics_ros.scripting import NodeProcess, Peer

pytestmark = [pytest.mark.long, pytest.mark.timeout(400)]

DEMO = [sys.executable, "-m", "intuitive_physics_experiments.demo"]


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    """A small demo: three throws to learn from, one to predict."""
    folder = tmp_path_factory.mktemp("demo")
    command = [*DEMO, "--output", str(folder), "--throws", "3", "--iterations", "1200"]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    return folder, json.loads(ended.stdout.splitlines()[-1])


def test_the_demo_sees_learns_and_predicts(demo):
    folder, numbers = demo
    assert numbers["demo"] == "ok"
    assert set(numbers) == {
        "demo",
        "perception_rmse_mm",
        "learned_J_m",
        "oracle_J_m",
        "prediction_error_m",
        "prediction_rate_hz",
    }
    # A depth camera of this kind is good to about a centimetre at 3 m.
    assert numbers["perception_rmse_mm"] < 15.0
    # Learning fits noise too, so it may beat the truth a little; it must come near.
    assert numbers["learned_J_m"] < 1.5 * numbers["oracle_J_m"] + 0.01
    # The rate depends on the machine: the demo is "ok" from 50 Hz on.
    for name in ("report.html", "demo.png", "demo.gif"):
        assert (folder / name).stat().st_size > 10_000
    # GitHub and a reader's patience bear no more at the top of a page.
    assert (folder / "demo.gif").stat().st_size < 3_000_000


def test_no_node_of_the_demo_wrote_a_traceback(demo):
    folder, _ = demo
    logs = sorted(folder.glob("*_node.log"))
    assert len(logs) == 3
    for log in logs:
        assert "Traceback" not in log.read_text(encoding="utf-8"), log


def test_learned_parameters_outlive_the_learner(demo):
    """A learner that is killed and started again publishes what it had learned."""
    folder, _ = demo
    arguments = ["-p", f"database:={folder / 'learner.sqlite3'}", "-p", "online:=false"]
    versions = []
    for number in (signal.SIGKILL, signal.SIGINT):
        learner = NodeProcess(module("learner_node"), arguments)
        with Peer("asker") as peer:
            answer = peer.call(
                GetStaticParameters,
                "/learner_node/get_static_parameters",
                GetStaticParameters.Request(),
            )
        versions.append(answer.static_parameters.version)
        learner.stop(number)
    assert versions[0] >= 1
    assert versions[0] == versions[1]


def test_an_impossible_demo_ends_with_a_clear_word(tmp_path):
    file = tmp_path / "file"
    file.write_text("")
    ended = subprocess.run(
        [*DEMO, "--output", str(Path(file) / "below")],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert ended.returncode == 1
    assert "demo failed" in ended.stderr
    assert "Traceback" not in ended.stderr
    assert json.loads(ended.stdout.splitlines()[-1])["demo"] == "failed"
