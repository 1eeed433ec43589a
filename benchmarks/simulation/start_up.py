"""How long the kernels take to compile, and to load from a cache that is there.

Measured in a process of its own: from when NumPy and Numba are imported until every engine has been
imported and has answered its first rollout, as set-up compiles them (on two cores where there are)
and as any other process loads them.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass

from intuitive_physics.simulation.compile import warm_up

_CHILD = """
import time
import numba, numpy
start = time.perf_counter()
from intuitive_physics.kernels.warm_up import main
from intuitive_physics.simulation.compile import warm_up
{call}
print(time.perf_counter() - start)
"""
"""Program of a process that measures the call that is put in."""


@dataclass(frozen=True)
class StartUp:
    """Seconds until every engine has answered, with an empty cache and with a full one.

    They begin when NumPy and Numba are imported; beside them are those of the whole process.
    """

    compile_s: float
    load_s: float
    compile_process_s: float
    load_process_s: float


def start_up(loads: int) -> StartUp:
    """Compile once and load `loads` times, of which the quickest counts."""
    with tempfile.TemporaryDirectory() as cache:
        compiled = _run(f"main([{warm_up.__module__!r}])", cache)
        loaded = min(_run("warm_up()", cache) for _ in range(loads))
    return StartUp(compiled[0], loaded[0], compiled[1], loaded[1])


def _run(call: str, cache: str) -> tuple[float, float]:
    """Return what the child measured and its whole wall time, in s."""
    start = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-c", _CHILD.format(call=call)],
        env={**os.environ, "NUMBA_CACHE_DIR": cache},
        check=True,
        stdout=subprocess.PIPE,
        text=True,
    )
    return float(done.stdout.split()[-1]), time.perf_counter() - start
