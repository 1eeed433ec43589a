"""Compile the kernels ahead of time, so that no node and no call ever waits for them."""

from __future__ import annotations

import time

from intuitive_physics.materials import StaticParameters
from intuitive_physics.scene import Environment, Plane, Scene, SceneObject
from intuitive_physics.shapes import Sphere
from intuitive_physics.simulation.choose import make_simulator
from intuitive_physics.state import ObjectState


def main() -> None:
    """Roll out one small scene, which compiles every kernel into Numba's cache."""
    start = time.perf_counter()
    scene = Scene(
        Environment([Plane("floor", "floor", (0, 0, 1), 0.0)]),
        (SceneObject("ball", "ball", Sphere(0.05)),),
        (ObjectState((0, 0, 0.1)),),
    )
    parameters = StaticParameters.uniform(["ball", "floor"])
    make_simulator("event_driven").rollout([scene], parameters, [0.0, 0.5])
    print(f"simulation kernels ready after {time.perf_counter() - start:.1f} s")


if __name__ == "__main__":
    main()
