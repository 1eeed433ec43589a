"""The page that walks a newcomer through a session says what the real commands answer."""

from __future__ import annotations

import os
import re
import shlex
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import pytest
from benchmarks.robot.ros2_process import COMMAND, Ros2Process, environment, ros2

from intuitive_physics_experiments.rendering.rendered_bag import RenderSettings, render_bag

pytestmark = [pytest.mark.long, pytest.mark.needs("ros2launch")]

PAGE = (Path(__file__).parent.parent / "docs" / "first_session.md").read_text(encoding="utf-8")

PID = "4321"
"""Process id of the learner on the page."""

TIMEOUT = 60.0
"""s until a command must have answered as the page says; it is asked again until then."""

LONGEST_ANSWER = 20.0
"""s after which a command is ended: `ros2` has been seen to answer and not to end."""


@dataclass(frozen=True)
class Step:
    """A command of the page and what it answers, with … for what differs."""

    command: str
    answer: str

    def wait_for(self, written: Callable[[], str]) -> None:
        """Wait until what was written is what the page says."""
        expected = "".join(map(pattern, self.answer.replace(PID, "…").splitlines()))
        end = time.monotonic() + TIMEOUT
        while not re.fullmatch(expected, tidy(text := written())):
            assert time.monotonic() < end, f"{self.command}\n{text}\nThe page: {self.answer}"
            time.sleep(0.1)


def pattern(line: str) -> str:
    """What a line of the page stands for: any lines, or one."""
    if line == "…":
        return r"(?:.*\n)*"
    return ".*".join(re.escape(part) for part in line.split("…")) + r"\n"


def tidy(text: str) -> str:
    """Return a text without empty lines and without spaces at the ends of lines."""
    return "".join(f"{line.rstrip()}\n" for line in text.strip().splitlines() if line.strip())


def steps() -> Iterator[Step]:
    for block in re.findall(r"^```console\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL):
        for part in re.split(r"^(?:\$ |(?=\^C))", block, flags=re.MULTILINE)[1:]:
            command, _, answer = part.partition("\n")
            yield Step(command, tidy(answer))


def answer_to(home: Path, command: str) -> str:
    """Run a command as a shell does, its home and folder `home`; return what it wrote."""
    limit = ["timeout", "--kill-after=5", f"{LONGEST_ANSWER:g}"]
    done = subprocess.run(
        command.replace("ros2", shlex.join([*limit, *COMMAND]), 1),
        shell=True,
        env=environment(home),
        cwd=home,
        capture_output=True,
        text=True,
        timeout=TIMEOUT,
    )
    return done.stdout + done.stderr


def test_the_page_is_true(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    first, *others = steps()
    assert first.command == "intuitive-physics render throws --throws 3"
    render_bag(tmp_path / "throws", RenderSettings(throws=3))
    started: list[Ros2Process] = []
    with ExitStack() as running:
        for step in others:
            if step.command == "^C":
                started[0].interrupt()
                step.wait_for(lambda: started[0].output)
            elif step.command == f"kill -9 {PID}":
                os.kill(started[0].pid_of("learner_node"), signal.SIGKILL)
            elif step.command.startswith(("ros2 launch", "ros2 run")):
                started.append(Ros2Process(tmp_path, *shlex.split(step.command)[1:]))
                running.enter_context(started[-1])
                if step.answer:
                    step.wait_for(lambda: started[-1].output)
            else:
                step.wait_for(lambda step=step: answer_to(tmp_path, step.command))
    assert len(others) > 20
    ros2(tmp_path, "daemon", "stop")
