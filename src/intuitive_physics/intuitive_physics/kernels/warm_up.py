"""Compile kernels ahead of time, so that no node and no call ever waits for a compiler.

A package with kernels has a module with `WARM_UPS`: functions without arguments, each of which
calls some of the kernels with all types of arguments that they will ever get.

    python -m intuitive_physics.kernels.warm_up MODULE...

calls the functions of these modules, each in a process of its own, and so fills Numba's cache.
"""

from __future__ import annotations

import argparse
import gc
import importlib
import multiprocessing
import os
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor

from intuitive_physics.errors import UnknownNameError
from intuitive_physics.kernels.cache import KernelCache

WarmUp = Callable[[], None]
"""Calls some kernels, which compiles them or loads them from the cache."""


def compile_kernels(warm_ups: Sequence[WarmUp]) -> None:
    """Call each function in a process of its own, then all of them here.

    Parameters
    ----------
    warm_ups : functions of modules, each once
    """
    # The processes begin with what is imported here already.
    fork = multiprocessing.get_context("fork")
    with ProcessPoolExecutor(len(warm_ups), fork, initializer=_spare_garbage) as pool:
        for compiled in [pool.submit(warm_up) for warm_up in warm_ups]:
            compiled.result()
    for warm_up in warm_ups:
        warm_up()


def _spare_garbage() -> None:
    # The compiler makes millions of objects that live as long as it does. To look through them
    # for garbage again and again takes a twelfth of the time and finds little.
    gc.disable()
    gc.freeze()


def main(arguments: Sequence[str] | None = None) -> None:
    """Compile the kernels of the modules that the command line names into Numba's cache.

    Raises
    ------
    UnknownNameError
        When a module has no `WARM_UPS`.
    """
    parser = argparse.ArgumentParser(description="Compile kernels into Numba's cache.")
    parser.add_argument("modules", nargs="+", metavar="MODULE", help="module with WARM_UPS")
    names = parser.parse_args(arguments).modules
    start = time.perf_counter()
    found = [warm_up for name in names for warm_up in _warm_ups(name)]
    compile_kernels(list(dict.fromkeys(found)))
    kept = f"below {os.path.commonpath(KernelCache.used)}" if KernelCache.used else "nowhere"
    print(f"kernels ready after {time.perf_counter() - start:.1f} s, kept {kept}")


def _warm_ups(name: str) -> Sequence[WarmUp]:
    warm_ups = getattr(importlib.import_module(name), "WARM_UPS", ())
    if not warm_ups:
        raise UnknownNameError(
            f"module {name} has no WARM_UPS; expected functions that call its kernels"
        )
    return warm_ups


if __name__ == "__main__":
    main()
