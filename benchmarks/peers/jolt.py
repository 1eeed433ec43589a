"""Jolt Physics, through a C++ program; there is no wheel, so its library is made of its source."""

from __future__ import annotations

import hashlib
import os
import re
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from benchmarks.peers.engine import Engine, MissingPeerError, Prepared
from benchmarks.peers.rollout_program import PROGRAMS, PreparedProgram, compile_program, compiler
from benchmarks.scenes import Instance

VARIABLE = "JOLT_SOURCE"  # environment variable with the folder of the source
UPSTREAM = "https://github.com/jrouwe/JoltPhysics"
# What Jolt's own build sets for a machine with AVX2, but for optimisation across modules
OPTIONS = (
    *("-std=c++17", "-O3", "-DNDEBUG", "-fno-rtti", "-pthread", "-w"),
    *("-mavx2", "-mbmi", "-mpopcnt", "-mlzcnt", "-mf16c", "-mfma"),
)


class Jolt(Engine):
    """Jolt at its defaults, without damping; μ_d only, no rolling friction, single precision.

    All simulations are rooms of one world, 40 m apart, or have a `world_each`.
    """

    optional = True

    def __init__(self, *, sleeping: bool = True, world_each: bool = False) -> None:
        place = "a world each" if world_each else "rooms apart"
        self.name = f"Jolt, {place}, {'sleeping' if sleeping else 'awake'}"
        worlds = "a world for each simulation" if world_each else "one world, rooms 40 m apart"
        self.how = (
            f"{worlds}; μ_d only, no rolling friction, single precision; least speed of bouncing "
            f"0.1 m/s{_version()}"
        )
        self._flags = (sleeping, world_each)

    def prepare(self, instance: Instance, steps: int, time_step: float) -> Prepared:
        source = _source()
        library = _library(source)
        program = compile_program(
            "jolt_rollout",
            [*OPTIONS, f"-I{source}", str(library)],
            f"expected a source of Jolt 5.5 in {VARIABLE}={source}",
            inputs=[library],
        )
        return PreparedProgram(program, instance, self._flags, steps, time_step)


def _source() -> Path:
    """Return the folder of Jolt's source, or raise `MissingPeerError`."""
    named = os.environ.get(VARIABLE)
    if not named:
        raise MissingPeerError(
            f"Jolt is missing: git clone {UPSTREAM}, and name the folder: {VARIABLE}=FOLDER"
        )
    source = Path(named).resolve()
    if not (source / "Jolt/Jolt.h").is_file():
        raise MissingPeerError(
            f"{VARIABLE} is {named}; expected the folder of a clone of {UPSTREAM}, with Jolt/Jolt.h"
        )
    return source


def _version() -> str:
    """Return "; version …" of the source, or nothing where there is none."""
    try:
        text = (_source() / "Jolt/Core/Core.h").read_text(encoding="utf-8")
    except (MissingPeerError, OSError):
        return ""
    numbers = re.findall(r"#define JPH_VERSION_(?:MAJOR|MINOR|PATCH) (\d+)", text)
    return f"; version {'.'.join(numbers)}"


def _library(source: Path) -> Path:
    """Return Jolt's library, compiled once for a folder of its source: some minutes."""
    key = hashlib.sha256(f"{source} {OPTIONS}".encode()).hexdigest()[:12]
    folder = PROGRAMS / f"jolt_{key}"
    library = folder / "libJolt.a"
    if library.exists():
        return library
    print(f"── compiling Jolt of {source}, which takes minutes once", file=sys.stderr)
    folder.mkdir(parents=True, exist_ok=True)
    files = sorted((source / "Jolt").rglob("*.cpp"))
    objects = [folder / f"{i}_{path.stem}.o" for i, path in enumerate(files)]
    with ThreadPoolExecutor(len(os.sched_getaffinity(0))) as pool:
        command = [compiler(), *OPTIONS, f"-I{source}", "-c"]
        list(
            pool.map(
                _run,
                ([*command, str(f), "-o", str(o)] for f, o in zip(files, objects, strict=True)),
            )
        )
    # The library appears when it is whole.
    unfinished = library.with_suffix(".new")
    _run(["ar", "rcs", str(unfinished), *map(str, objects)])
    return unfinished.rename(library)


def _run(command: list[str]) -> None:
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode != 0:
        raise MissingPeerError(f"Jolt does not compile: {' '.join(command)}\n{done.stderr}")
