"""What is started is read, limited, and ends with the run that started it."""

from __future__ import annotations

import fcntl
import os
import signal
import sys
import time
import uuid
from pathlib import Path

import pytest

from intuitive_physics.processes import ChildProcess, ProcessFailedError, segments, watchdog

PATIENCE = 30.0
"""s to wait for what takes well under one, on a machine that is busy with other things."""

MOMENT = 2.0
"""s after which nothing of a run may be left."""


def python(code: str, **options) -> ChildProcess:
    return ChildProcess([sys.executable, "-u", "-c", code], name="the child", **options)


def test_waits_for_what_is_written():
    with python("print('one'); print('two'); import time; time.sleep(60)") as child:
        child.wait_for("two\n", PATIENCE)
        assert child.output == "one\ntwo\n"
        with pytest.raises(ProcessFailedError, match=r"has not written .three. after 0 s"):
            child.wait_for("three", 0.1)


def test_what_was_written_before_the_end_is_found():
    child = python("print('ready')")
    child.wait()
    child.wait_for("ready")
    with pytest.raises(ProcessFailedError, match="the child ended with code 0:\nready"):
        child.wait_for("more")


def test_is_stopped_and_if_need_be_killed():
    stubborn = "import signal, time; signal.signal(2, signal.SIG_IGN); print('up'); time.sleep(60)"
    with python("import time; print('up'); time.sleep(60)") as child, python(stubborn) as other:
        child.wait_for("up")
        other.wait_for("up")
        assert child.stop(signal.SIGTERM) == -signal.SIGTERM
        assert other.stop(timeout=0.2) == -signal.SIGKILL
        assert other.stop() == -signal.SIGKILL


def test_ends_at_its_limit():
    assert python("import time; time.sleep(60)", longest=0.3).wait(PATIENCE) == -signal.SIGKILL


def test_a_grandchild_that_holds_the_output_holds_nobody(monkeypatch):
    monkeypatch.setattr("intuitive_physics.processes.child_process.READ_TIMEOUT", 0.2)
    code = "import subprocess; print(subprocess.Popen(['sleep', '60']).pid)"
    child = python(code, own_group=True)
    assert child.wait(PATIENCE) == 0
    os.kill(int(child.output), signal.SIGKILL)


def test_a_signal_reaches_the_group():
    code = "import subprocess, time; subprocess.Popen(['sleep', '60']); print('up'); time.sleep(60)"
    with python(code, own_group=True) as child:
        child.wait_for("up")
        child.stop(signal.SIGKILL)
        # The end of its output: nobody holds it any more.
        child._reader.join(PATIENCE)
        assert not child._reader.is_alive()


RUN = """
import os, subprocess, sys, time
from intuitive_physics.processes import guard_run
guard_run()
try:
    subprocess.Popen([sys.executable, "-c", "while True: pass"], start_new_session=True)
    subprocess.Popen("setsid sleep 300 & sleep 300", shell=True)
    stopped = subprocess.Popen(["sleep", "300"])
    stopped.send_signal(19)
    if os.fork() == 0:
        time.sleep(300)
        os._exit(0)
    print("up", flush=True)
    {busy}
    time.sleep(300)
finally:
    print("tidied", flush=True)
"""


def processes_of(mark: str) -> list[str]:
    """Return the command lines of processes that were started with this mark."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            if mark.encode() in (folder / "environ").read_bytes():
                found.append((folder / "cmdline").read_text())
        except OSError:  # it has ended, or belongs to another user
            continue
    return found


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
@pytest.mark.parametrize("busy", ["pass", "sum(range(10**12))"])
def test_what_a_run_has_started_ends_with_it(number, busy):
    mark = uuid.uuid4().hex
    with python(RUN.format(busy=busy), environment={**os.environ, "CUT_OFF": mark}) as run:
        run.wait_for("up", PATIENCE)
        # The run, its watchdog, a busy loop, a shell and two that sleep, a stopped one, a forked
        # one; the shell takes a moment to start its own.
        end = time.monotonic() + PATIENCE
        while len(processes_of(mark)) < 7 and time.monotonic() < end:
            time.sleep(0.05)
        assert len(processes_of(mark)) >= 7
        run.send_signal(number)
        time.sleep(MOMENT)
        assert processes_of(mark) == []
        # A run that Python cannot interrupt is killed.
        is_tidy = number == signal.SIGTERM and busy == "pass"
        assert ("tidied" in run.output) is is_tidy
        assert run.wait() == (143 if is_tidy else -signal.SIGKILL)


def test_a_child_that_is_forked_as_the_run_is_killed_ends():
    code = """
import os, time
from intuitive_physics.processes import guard_run

os.register_at_fork(after_in_child=lambda: time.sleep(0.5))  # a busy machine
guard_run()
if os.fork() == 0:
    time.sleep(300)
print("up", flush=True)
time.sleep(300)
"""
    mark = uuid.uuid4().hex
    run = python(code, environment={**os.environ, "CUT_OFF": mark})
    run.wait_for("up", PATIENCE)
    run.send_signal(signal.SIGKILL)
    time.sleep(MOMENT)
    assert processes_of(mark) == []


def test_a_run_ends_with_its_make(tmp_path):
    (tmp_path / "run.py").write_text(RUN.format(busy="pass"))
    (tmp_path / "Makefile").write_text(f"all:\n\t@{sys.executable} run.py; true\n")
    mark = uuid.uuid4().hex
    environment = {**os.environ, "CUT_OFF": mark}
    environment.pop("MAKELEVEL", None)
    make = ChildProcess(["make"], folder=tmp_path, environment=environment)
    make.wait_for("up", PATIENCE)
    make.send_signal(signal.SIGKILL)
    time.sleep(MOMENT)
    assert processes_of(mark) == []


def test_a_run_that_ends_well_leaves_nothing_either():
    mark = uuid.uuid4().hex
    code = RUN.format(busy="sys.exit(0)")
    run = python(code, environment={**os.environ, "CUT_OFF": mark})
    assert run.wait(PATIENCE) == 0
    time.sleep(MOMENT)
    assert processes_of(mark) == []


@pytest.fixture
def shared_memory(tmp_path, monkeypatch):
    monkeypatch.setattr(segments, "FOLDER", tmp_path)

    def make(name, age=60.0):
        for file in (name, f"{name}_el"):
            (tmp_path / file).write_bytes(b"x" * 1000)
            os.utime(tmp_path / file, (time.time() - age,) * 2)
        return tmp_path / f"{name}_el"

    return make


def test_only_segments_that_nobody_holds_are_removed(shared_memory, tmp_path):
    dead, living, young = (f"fastrtps_{digit * 16}" for digit in "abc")
    shared_memory(dead)
    lock = shared_memory(living)
    shared_memory(young, age=0.0)
    shared_memory("fastrtps_port7412")
    (tmp_path / "other").write_text("")
    with lock.open() as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        assert segments.remove_abandoned_segments() == 2000
        assert sorted(file.name for file in tmp_path.iterdir()) == sorted(
            [living, f"{living}_el", young, f"{young}_el"]
            + ["fastrtps_port7412", "fastrtps_port7412_el", "other"]
        )
        assert segments.remove_abandoned_segments(ports=True, settled=0.0) == 4000
    assert sorted(file.name for file in tmp_path.iterdir()) == [living, f"{living}_el", "other"]


def test_a_segment_without_a_lock_is_removed_once_it_is_old(shared_memory, tmp_path):
    shared_memory(f"fastrtps_{'a' * 16}").unlink()
    shared_memory(f"fastrtps_{'b' * 16}", age=0.0).unlink()
    assert segments.remove_abandoned_segments() == 1000
    assert [file.name for file in tmp_path.iterdir()] == [f"fastrtps_{'b' * 16}"]


HOLD = """
import fcntl, sys, time, numpy
lock = open(sys.argv[1], "w")
fcntl.flock(lock, fcntl.LOCK_EX)
memory = numpy.ones(100_000_000)
print("up", flush=True)
time.sleep(60)
"""


def test_a_process_that_is_ending_holds_its_locks_and_is_waited_for(tmp_path):
    # A process that is killed has no environment at once; its files are closed after its memory,
    # here 0.8 GB, is free.
    lock, mark = tmp_path / "lock", uuid.uuid4().hex
    environment = {**os.environ, "CUT_OFF": mark}
    child = ChildProcess([sys.executable, "-c", HOLD, str(lock)], environment=environment)
    child.wait_for("up", PATIENCE)
    child.send_signal(signal.SIGKILL)
    watchdog.end_all(mark.encode())
    with lock.open() as held:
        fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
    child.wait()


def test_without_shared_memory_nothing_is_removed(monkeypatch, tmp_path):
    monkeypatch.setattr(segments, "FOLDER", tmp_path / "none")
    assert segments.remove_abandoned_segments() == 0
