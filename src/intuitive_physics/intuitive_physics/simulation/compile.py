"""Compile the kernels ahead of time, so that no node and no call ever waits for them."""

from __future__ import annotations

import gc
import multiprocessing
import time
from concurrent.futures import ProcessPoolExecutor

from intuitive_physics.materials import StaticParameters
from intuitive_physics.scene import Environment, Plane, Scene, SceneObject
from intuitive_physics.shapes import Sphere
from intuitive_physics.simulation.choose import make_simulator
from intuitive_physics.simulation.event_driven.roots import first_fall_quadratic
from intuitive_physics.state import ObjectState

ENGINES = ("event_driven", "stepped")
"""Those whose kernels are compiled."""


def warm_up() -> None:
    """Roll out one small scene with each engine, which compiles all the kernels it needs."""
    for engine in ENGINES:
        warm_up_engine(engine)
    # Predicting free flight takes this one without an engine.
    first_fall_quadratic(1.0, 0.0, -9.81)


def warm_up_engine(engine: str) -> None:
    """Roll out one small scene with an engine.

    Shapes, primitives and what is asked for are numbers to the kernels and not types: one call
    compiles them for all.
    """
    scene = Scene(
        Environment([Plane("floor", "floor", (0, 0, 1), 0.0)]),
        (SceneObject("ball", "ball", Sphere(0.05)),),
        (ObjectState((0, 0, 0.1)),),
    )
    parameters = StaticParameters.uniform(["ball", "floor"])
    make_simulator(engine).rollout([scene], parameters, [0.0, 0.5])


def main() -> None:
    """Compile every kernel into Numba's cache, each engine's in a process of its own."""
    start = time.perf_counter()
    # The processes begin with what is imported here already.
    fork = multiprocessing.get_context("fork")
    with ProcessPoolExecutor(len(ENGINES), fork, initializer=_spare_garbage) as pool:
        list(pool.map(warm_up_engine, ENGINES))
    warm_up()
    print(f"simulation kernels ready after {time.perf_counter() - start:.1f} s")


def _spare_garbage() -> None:
    # The compiler makes millions of objects that live as long as it does. To look through them
    # for garbage again and again takes a twelfth of the time and finds little.
    gc.disable()
    gc.freeze()


if __name__ == "__main__":
    main()
