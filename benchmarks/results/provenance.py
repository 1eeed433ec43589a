"""What a run records of its command, its commit and its machine."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import subprocess
from collections.abc import Sequence
from datetime import datetime, timezone
from pathlib import Path

from benchmarks.results.result import Machine, Run

REPOSITORY = Path(__file__).resolve().parents[2]  # whose commit is recorded
# Python libraries whose versions are recorded where they are installed
LIBRARIES = (
    *("numpy", "scipy", "numba", "dask"),
    *("pybullet", "mujoco", "rapier3d", "open3d", "pyransac3d", "emcee"),
)


def started_run(name: str, arguments: Sequence[str]) -> Run:
    """Return the record of a benchmark's run that starts now, with these command line arguments."""
    commit = _output("git", "-C", str(REPOSITORY), "rev-parse", "HEAD")
    changes = _output("git", "-C", str(REPOSITORY), "status", "--porcelain", "-uno")
    return Run(
        command=_command(name, arguments),
        commit=commit or "",
        dirty=None if changes is None else bool(changes),
        date=datetime.now(timezone.utc).isoformat(timespec="seconds"),
        machine=Machine(
            processor=_processor(),
            cores=len(os.sched_getaffinity(0)),
            system=platform.platform(),
            python=platform.python_version(),
            libraries=_libraries(),
        ),
    )


def _command(name: str, arguments: Sequence[str]) -> str:
    """Return the command as it was given: make sets MAKELEVEL for the commands it starts."""
    options = " ".join(arguments)
    if "MAKELEVEL" not in os.environ:
        return f"python -m benchmarks.{name} {options}".rstrip()
    quoted = f'"{options}"' if len(arguments) > 1 else options
    target = name if name == "torture" else f"bench-{name}"
    return f"make {target}" + (f" options={quoted}" if options else "")


def _processor() -> str:
    lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()


def _libraries() -> dict[str, str]:
    versions = {}
    for name in LIBRARIES:
        try:
            versions[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    ode = _output("pkg-config", "--modversion", "ode")
    return {**versions, "ODE": ode} if ode else versions


def _output(*command: str) -> str | None:
    """Return what a program prints; None where it fails or does not exist."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return None
    return done.stdout.strip()
