"""Engines that experiments know by name: the library's, and MuJoCo."""

from __future__ import annotations

from intuitive_physics.errors import UnknownNameError
from intuitive_physics.simulation import SIMULATORS, Simulator, make_simulator

EXPERIMENT_ENGINES = (*SIMULATORS, "mujoco")


def make_experiment_simulator(name: str, threads: int = 1) -> Simulator:
    """Return the engine of that name.

    Raises
    ------
    UnknownNameError
        When the name is none of `EXPERIMENT_ENGINES`.
    """
    if name == "mujoco":
        # Imported late: MuJoCo may not be installed.
        from intuitive_physics_experiments.engines.mujoco_simulator import MujocoSimulator

        return MujocoSimulator()
    if name not in SIMULATORS:
        raise UnknownNameError(
            f"simulator is {name!r}; expected one of {', '.join(EXPERIMENT_ENGINES)}"
        )
    return make_simulator(name, threads)
