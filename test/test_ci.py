"""What CI runs, with stages made up here: a red one hides no other, and nothing is left behind."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import time
from pathlib import Path

import pytest

from intuitive_physics.processes import ChildProcess

ROOT = Path(__file__).parent.parent

MAKEFILE = """\
test:
\t@echo alone in $(CURDIR); ls ..; {alone}
library-tests:
\t@echo libraries $(only) $(options); false
system-tests:
\t@echo "===== 3 passed in 0.10s ====="
"""

TOOLS = """\
#!/bin/sh
echo "tools into $1"
"""


@pytest.fixture
def started(tmp_path, monkeypatch):
    """Starts CI in a repository whose `make test` runs a given command."""
    temporary, programs, shared = (tmp_path / name for name in ("temporary", "bin", "shared/ros"))
    for folder in (temporary, programs, shared):
        folder.mkdir(parents=True)
    for path, text in ((programs / "chromium", ""), (shared / "install_tools.sh", TOOLS)):
        path.write_text(text)
        path.chmod(0o755)
    monkeypatch.setenv("PATH", f"{programs}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("TMPDIR", str(temporary))
    # As from a shell, not from the make that may run this test.
    for name in ("MAKELEVEL", "MAKEFLAGS"):
        monkeypatch.delenv(name, raising=False)

    def start(alone: str) -> ChildProcess:
        main = tmp_path / "main"
        segments = main / "src/intuitive_physics/intuitive_physics/processes/segments.py"
        segments.parent.mkdir(parents=True)
        segments.write_text("print('freed')\n")
        (main / "Makefile").write_text(MAKEFILE.format(alone=alone))
        shutil.copytree(ROOT / ".ci", main / ".ci")
        for command in ("init", "add --all", "-c user.name=x -c user.email=x commit -m x"):
            subprocess.run(["git", *command.split()], cwd=main, check=True, capture_output=True)
        return ChildProcess([str(main / ".ci" / "run")])

    yield start
    assert list(temporary.iterdir()) == []


def test_a_red_stage_hides_no_other(started, tmp_path):
    process = started("false")
    assert process.wait(60.0) == 1
    lines = process.output.splitlines()
    assert lines[0] == "freed"
    assert f"alone in {tmp_path}/temporary/ci-" in process.output
    # Nothing lies beside the clone when it stands alone.
    assert lines[lines.index("clone") + 1].startswith("make: ***")
    assert "shared" not in lines[: lines.index("── ci: tools")]
    assert "tools into " in process.output
    assert "libraries needs --deselect=test/test_torture.py" in process.output
    assert "===== 3 passed in 0.10s =====" in lines[-3:]
    assert lines[-1] == "ci: failed: alone needs"
    assert {path.stem for path in (tmp_path / "main/build/ci").iterdir()} == {
        *("alone", "tools", "needs")
    }


def test_a_run_that_is_cut_off_takes_its_stage_along(started, tmp_path):
    process = started("echo $$$$ > $(CURDIR)/../../pid; sleep 100")
    written = tmp_path / "temporary" / "pid"
    end = time.monotonic() + 30
    while not (written.exists() and written.read_text().strip()):
        assert time.monotonic() < end
        time.sleep(0.05)
    shell = int(written.read_text())
    written.unlink()
    assert process.stop(signal.SIGTERM, timeout=30.0) == 143
    with pytest.raises(ProcessLookupError):
        os.kill(shell, 0)
