"""Scenes, parameters and times in, trajectories out."""

from __future__ import annotations

from collections.abc import Sequence

from numpy.typing import ArrayLike

from intuitive_physics.materials import StaticParameters
from intuitive_physics.scene import Scene
from intuitive_physics.simulation.choose import make_simulator
from intuitive_physics.simulation.rollout import Rollout


def simulate(
    scenes: Sequence[Scene],
    static_parameters: StaticParameters | Sequence[StaticParameters],
    times: ArrayLike,
    *,
    engine: str = "auto",
    threads: int = 1,
) -> Rollout:
    """Simulate each scene from its initial states.

    Whoever simulates again and again makes the engine once, by `make_simulator`.

    Parameters
    ----------
    scenes : n_worlds scenes
    static_parameters : one θ_s for all scenes, or one for each
    times : (n_times,) s after the initial states, strictly increasing, none negative
    engine : one of `SIMULATORS`
    threads : worker threads over the scenes

    Returns
    -------
    Rollout
        `positions` (n_worlds, n_objects, n_times, 3) m, `orientations` likewise with (x, y, z, w),
        and the status of each world.

    Raises
    ------
    UnknownNameError
        When there is no such engine.
    InvalidInputError
        When there is no scene, a material is unknown, the times are not as above or objects of a
        scene overlap at its beginning by more than a quarter of the smaller one's inradius.
    UnsupportedSceneError
        When the engine cannot express a scene.
    """
    return make_simulator(engine, threads).rollout(scenes, static_parameters, times)
