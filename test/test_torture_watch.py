"""How `make torture` watches nodes: all that is a node's counts, is reached, and has to answer."""

from __future__ import annotations

import importlib
import sys
import traceback
from concurrent.futures import Future
from pathlib import Path
from types import SimpleNamespace

import pytest
from benchmarks.command import Outcome
from benchmarks.results.result import Column, Table
from benchmarks.torture import answers as answers_module
from benchmarks.torture.answers import LIMIT, Answers
from benchmarks.torture.early_end import EarlyEndError, noted, result_of, traceback_in
from benchmarks.torture.interfaces import FUZZED
from benchmarks.torture.nodes import blamed_on_death, megabytes, peak_megabytes
from benchmarks.torture.soak import Watched

from intuitive_physics.processes import ChildProcess
from intuitive_physics_ros.scripting import PeerTimeoutError

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "docs" / "_extensions"))
node_pages, ros_endpoints = (
    importlib.import_module(name) for name in ("node_pages", "ros_endpoints")
)

TAKEN = 100_000_000
"""Bytes that a grandchild of this test takes."""

ALONE = "import time; print('runs', flush=True); time.sleep(60)"

GRANDCHILD = f"held = b'x' * {TAKEN}; {ALONE}"

CHILD = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {GRANDCHILD!r}])"


@pytest.mark.parametrize("measured", [megabytes, peak_megabytes])
def test_memory_of_a_node_includes_that_of_its_children(measured):
    memory = []
    for program in (ALONE, CHILD):
        with ChildProcess([sys.executable, "-c", program]) as process:
            process.wait_for("runs")
            memory.append(measured(process.pid))
    assert memory[1] > memory[0] + TAKEN / 1e6


def type_name(kind: type) -> str:
    package, role = kind.__module__.split(".")[:2]
    return f"{package}/{role}/{kind.__name__}"


def test_all_that_the_reference_says_of_the_nodes_is_fuzzed():
    """The reference is made from the nodes' code; fuzz asks the running nodes too."""
    fuzzed: set[tuple[str, str, str]] = set()
    for node in FUZZED.values():
        name = node.module.rpartition(".")[2]
        for kinds in (node.topics, node.all_services(), node.actions):
            fuzzed |= {(name, one, type_name(kind)) for one, kind in kinds.items()}
    nodes = node_pages.node_classes(ROOT)
    assert {name for name, _, _ in fuzzed} == set(nodes)
    for module, node_class in nodes.items():
        plays = module == node_pages.BAG_TOPICS
        for one in ros_endpoints.endpoints(node_class, plays_a_bag=plays):
            known = one.name.replace("{name}", "object")
            # The packages of tf need not be installed.
            if one.role != "publishes" and known != "/tf":
                assert (module, known, one.type) in fuzzed


@pytest.mark.needs("tf2_msgs")
def test_transforms_are_fuzzed():
    for name in ("perception_of_compressed", "bridge_of_pose", "bridge_of_tf"):
        assert {"/tf", "/tf_static"} <= set(FUZZED[name].topics)


@pytest.fixture
def clock(monkeypatch):
    clock = SimpleNamespace(now=1000.0)
    clock.monotonic = lambda: clock.now
    monkeypatch.setattr(answers_module, "time", clock)
    return clock


def ask(answers: Answers, node: str = "node", what: str = "~/ask") -> Future:
    future: Future = Future()
    answers.watch(node, what, future, lambda: None)
    return future


def hangs(answers: Answers, clock: SimpleNamespace) -> list[str]:
    """The requests that were not answered in time."""
    clock.now += 1.1 * LIMIT
    assert answers.look()
    return answers.hangs


def test_request_that_is_not_answered_after_others_were_hangs(clock):
    answers = Answers()
    ask(answers).set_result(None)
    assert answers.look()
    ask(answers)
    ask(answers).set_result(None)
    assert not answers.look()
    assert not answers.hangs
    assert hangs(answers, clock) == ["node ~/ask"]


def test_service_that_never_answers_hangs(clock):
    answers = Answers()
    ask(answers)
    assert hangs(answers, clock) == ["node ~/ask"]


def test_first_answers_to_a_client_may_be_lost(clock):
    answers = Answers()
    ask(answers)
    ask(answers).set_result(None)
    assert not hangs(answers, clock)


def test_node_that_has_ended_owes_no_answer(clock):
    answers = Answers()
    ask(answers)
    ask(answers, what="~/change_state")
    ask(answers, node="other")
    answers.leave("node", but="~/change_state")
    assert hangs(answers, clock) == ["node ~/change_state", "other ~/ask"]


def test_death_of_a_node_is_named_in_place_of_what_follows_from_it():
    dying = [sys.executable, "-c", "print('all is well', flush=True); raise SystemExit(7)"]
    with ChildProcess(dying) as node:
        node.wait()
        died = r"learner died \(code 7\) .* all is well"
        with pytest.raises(EarlyEndError, match=died), blamed_on_death("learner", node):
            raise PeerTimeoutError("waited in vain")
        # What a check complains of is no consequence of the death.
        with pytest.raises(ValueError, match="lost"), blamed_on_death("learner", node):
            raise ValueError("two are lost")


def test_node_that_lives_is_not_blamed():
    with ChildProcess([sys.executable, "-c", ALONE]) as node:
        node.wait_for("runs")
        with pytest.raises(PeerTimeoutError), blamed_on_death("learner", node):
            raise PeerTimeoutError("waited in vain")


def test_early_end_is_one_line_with_the_place_of_what_nobody_expected():
    failures: list[str] = []
    with noted(failures):
        raise EarlyEndError("node died\nlong output\nlast words\n")
    with noted(failures):
        Path("/proc/none/task").read_text()
    assert failures[0] == "ended early: node died last words"
    assert failures[1].startswith("ended early: FileNotFoundError in ")
    assert result_of(lambda: [][0]).startswith("IndexError in test_torture_watch.py:")


def test_growth_is_that_since_the_second_minute():
    node = Watched()
    for minute, memory in enumerate((900.0, 400.0, 410.0, 405.0)):
        node.note(minute, memory - 50.0, 3, 5)
        node.note(minute, memory, 4, 5)
        node.note(minute, memory - 20.0, 3, 6)
    assert node.memory == [900.0, 400.0, 410.0, 405.0]
    assert (node.threads, node.files) == ([4] * 4, [6] * 4)
    assert node.growth() == 5.0


def test_part_that_ends_early_is_a_missed_bar_and_the_others_go_on(tmp_path, monkeypatch, capsys):
    torture = importlib.import_module("benchmarks.torture.__main__")
    monkeypatch.setattr("benchmarks.command.FOLDER", tmp_path)
    table = Table("cancels", [Column("cancelled")], [[3]])
    monkeypatch.setattr(torture, "kill", lambda *_: {}["no such"])
    monkeypatch.setattr(torture, "cancel", lambda *_: Outcome([table], {}))
    assert torture.main(["--only", "kills,cancels", "--write"]) == 1
    written = capsys.readouterr()
    assert "bench-torture: kills: ended early: KeyError in " in written.err
    assert "Traceback" not in written.err
    page = (tmp_path / "torture_kills_cancels.md").read_text()
    assert "**Bars missed**: kills: ended early" in page
    assert "## cancels" in page


def test_first_traceback_is_one_line_with_what_stands_before_it():
    assert traceback_in("all is well\n") == ""
    try:
        Path("/nowhere").read_bytes()
    except OSError:
        traced = traceback.format_exc()
    error = "FileNotFoundError: [Errno 2] No such file or directory: '/nowhere'"
    written = f"begun\nwriting failed\n{traced}ended\n"
    assert traceback_in(written) == f"a traceback: writing failed {error}"
    assert traceback_in(traced) == f"a traceback:  {error}"
