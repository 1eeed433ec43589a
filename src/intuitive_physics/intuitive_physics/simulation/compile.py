"""Calls that compile all kernels of the simulation, so that no node and no call waits for them."""

from __future__ import annotations

from intuitive_physics.kernels.warm_up import WarmUp
from intuitive_physics.materials import StaticParameters
from intuitive_physics.scene import Environment, Plane, Scene, SceneObject
from intuitive_physics.shapes import Sphere
from intuitive_physics.simulation.choose import make_simulator
from intuitive_physics.simulation.spheres.roots import first_fall_quadratic
from intuitive_physics.state import ObjectState


def warm_up() -> None:
    """Compile all kernels of the simulation, or load them from the cache."""
    for function in WARM_UPS:
        function()


def warm_up_core() -> None:
    """Compile the kernels of the core.

    Shapes, primitives and what is asked for are numbers to the kernels and not types: one call
    compiles them for all.
    """
    scene = Scene(
        Environment([Plane("floor", "floor", (0, 0, 1), 0.0)]),
        (SceneObject("ball", "ball", Sphere(0.05)),),
        (ObjectState((0, 0, 0.1)),),
    )
    parameters = StaticParameters.uniform(["ball", "floor"])
    make_simulator("auto").rollout([scene], parameters, [0.0, 0.5])


def warm_up_free_flight() -> None:
    """Compile what the prediction of free flight takes without an engine."""
    first_fall_quadratic(1.0, 0.0, -9.81)


WARM_UPS: tuple[WarmUp, ...] = (warm_up_core, warm_up_free_flight)
"""Functions that `intuitive_physics.kernels.warm_up` calls, the longest first."""
