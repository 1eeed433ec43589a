"""The process that learns in the background: started, watched, stopped, killed."""

import json
import os
import signal
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.kernels.cache import KernelCache
from intuitive_physics.processes import ChildProcess
from intuitive_physics_learner.online import worker
from intuitive_physics_learner.online.background_learning import BackgroundLearning
from intuitive_physics_learner.online.online_state import OnlineState
from intuitive_physics_learner.online.options import OnlineOptions
from intuitive_physics_learner.online.worker import FAILED, WAITING
from intuitive_physics_learner.store.online_record import OnlineRecord

PATIENCE = 60.0
"""s for what takes about one, on a machine that is busy with other things."""

OPTIONS = OnlineOptions()


@pytest.fixture
def background(store):
    improved = threading.Event()
    made = BackgroundLearning(store.path, "event_driven", improved.set)
    made.improved = improved
    yield made
    made.stop()


def wait_until(holds, patience=PATIENCE):
    deadline = time.monotonic() + patience
    while not holds():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.005)


def ended(process):
    return process.poll() is not None


def test_learns_as_observations_arrive(store, background, throws, true_parameters):
    background.start(OPTIONS, cores=1, priority="normal")
    assert background.running
    for observation in throws(6, 0, noise=0.003, state_noise=0.01):
        store.add(observation)
        background.notify()
    assert background.improved.wait(PATIENCE), background.report
    wait_until(lambda: background.report.state == WAITING and background.report.processed == 6)
    assert background.report.pending == 0
    newest = store.newest_parameters()
    assert newest.version == background.report.version
    got = newest.parameters.pair("ball", "floor")["restitution"]
    assert got == pytest.approx(true_parameters.pair("ball", "floor")["restitution"], abs=0.02)


def saved(store):
    text = OnlineRecord(store.database).state()
    return 0 if text is None else OnlineState.from_json(text).processed


def test_killed_learning_resumes_exactly(store, background, throws):
    observed = throws(40, 0, noise=0.003, state_noise=0.01, times=20)
    store.add_all(observed)
    reports = []
    while saved(store) < len(observed):
        background.start(OPTIONS, cores=1, priority="normal")
        before = saved(store)
        wait_until(lambda least=before: saved(store) > least)
        process = background._process
        background.stop()
        wait_until(lambda stopped=process: ended(stopped))
        reports.append(saved(store))
        # The state and the version that goes with it: both or none.
        state = OnlineState.from_json(OnlineRecord(store.database).state())
        assert state.published.version == store.newest_version()
    assert reports == sorted(reports)
    assert len(reports) >= 2


@pytest.mark.parametrize(
    ("priority", "niceness", "policy"),
    [("idle", 19, os.SCHED_IDLE), ("low", 19, os.SCHED_OTHER), ("normal", 0, os.SCHED_OTHER)],
)
def test_leaves_the_cores_to_others(background, priority, niceness, policy):
    background.start(OPTIONS, cores=1, priority=priority)
    pid = background._process.pid
    assert os.getpriority(os.PRIO_PROCESS, pid) == max(niceness, os.nice(0))
    assert os.sched_getscheduler(pid) == policy
    assert len(os.sched_getaffinity(pid)) == 1


def test_ends_with_the_process_that_started_it(store, background, throws):
    store.add_all(throws(3, 0))
    background.start(OPTIONS, cores=1, priority="normal")
    wait_until(lambda: background.report.processed > 0)
    process = background._process
    # What the end of this process would do.
    process.stdin.close()
    wait_until(lambda: ended(process))


def process_state(pid):
    """Letter of proc(5), or None where there is no such process."""
    with suppress(FileNotFoundError, ProcessLookupError):
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]


def test_killed_parent_ends_a_worker_that_does_not_run(store):
    # As at idle priority on a machine whose cores are all taken: it never reads its input.
    code = f"""
import sys, time
from pathlib import Path
from intuitive_physics_learner.online.background_learning import BackgroundLearning
from intuitive_physics_learner.online.options import OnlineOptions
learning = BackgroundLearning(Path({str(store.path)!r}), "event_driven", lambda: None)
learning.start(OnlineOptions(), cores=1)
print(learning._process.pid)
time.sleep({PATIENCE})
"""
    with ChildProcess([sys.executable, "-u", "-c", code], name="a learner") as learner:
        learner.wait_for("\n", PATIENCE)
        worker = int(learner.output)
        # It imports, so it is bound to its parent already.
        wait_until(lambda: "numpy" in Path(f"/proc/{worker}/maps").read_text())
        os.kill(worker, signal.SIGSTOP)
        learner.process.kill()
        wait_until(lambda: process_state(worker) in ("Z", None))


def test_ctrl_c_is_left_to_the_process_that_started_it(store, background, throws):
    store.add_all(throws(3, 0, times=20))
    background.start(OPTIONS, cores=1, priority="normal")
    wait_until(lambda: background.report.processed == 3)
    background._process.send_signal(signal.SIGINT)
    store.add_all(throws(1, 1, times=20))
    background.notify()
    wait_until(lambda: background.report.processed == 4)


def test_dead_worker_is_reported_and_restarted(store, background, throws):
    background.start(OPTIONS, cores=1, priority="normal")
    store.add_all(throws(3, 0))
    background._process.kill()
    wait_until(lambda: background.report.state == FAILED)
    assert "ended with code -9" in background.report.message
    store.add_all(throws(1, 1))
    background.notify()
    wait_until(lambda: background.report.processed == 4)


def test_reports_why_it_cannot_start(tmp_path):
    garbage = tmp_path / "garbage"
    garbage.write_bytes(np.random.default_rng(0).bytes(5000))
    background = BackgroundLearning(garbage, "event_driven", lambda: None)
    background.start(OPTIONS, cores=1, priority="normal")
    wait_until(lambda: background.report.state == FAILED)
    assert "is not an SQLite database" in background.report.message
    assert "Traceback" not in background.report.message
    background.stop()


def test_reports_unusable_observations_and_continues(store, background, throws, boxed):
    store.add(boxed)
    store.add_all(throws(1, 0, times=20))
    background.start(OPTIONS, cores=1, priority="normal")
    wait_until(lambda: background.report.state == WAITING and background.report.processed == 2)
    assert "bounded one among the last" in background.report.message
    assert background.report.doubtful == 1
    assert store.newest_version() == 1


def test_reports_compilation_of_kernels(store, monkeypatch, capsys):
    class Compiles:
        """Learning whose first step compiles a kernel, and which fails then."""

        def __init__(self, *_):
            pass

        def advance(self):
            KernelCache.listeners[threading.get_ident()]()
            raise InvalidInputError("the end")

    reading, _writing = os.pipe()
    monkeypatch.setattr(worker, "StoredOnlineLearning", Compiles)
    monkeypatch.setattr(sys, "stdin", os.fdopen(reading))
    made = worker.Worker(store, "event_driven", 1, OPTIONS)
    threading.Thread(target=made.run, daemon=True).start()
    said = ""
    while said.count("\n") < 2:
        said += capsys.readouterr().out
        time.sleep(0.01)
    states = [json.loads(line)["state"] for line in said.splitlines()]
    assert states == [worker.COMPILING, FAILED]
