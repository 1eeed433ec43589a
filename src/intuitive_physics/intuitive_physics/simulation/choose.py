"""Engines by name, and one call for who simulates once."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from numpy.typing import ArrayLike

from intuitive_physics.errors import UnknownNameError
from intuitive_physics.materials import StaticParameters
from intuitive_physics.scene import Scene
from intuitive_physics.simulation.rollout import Rollout
from intuitive_physics.simulation.simulator import Simulator


def _event_driven(threads: int) -> Simulator:
    from intuitive_physics.simulation.core.engines import EventDrivenSimulator

    return EventDrivenSimulator(threads=threads)


def _stepped(threads: int) -> Simulator:
    from intuitive_physics.simulation.core.engines import SteppedSimulator

    return SteppedSimulator(threads=threads)


def _bullet(threads: int) -> Simulator:
    from intuitive_physics.simulation.bullet import BulletSimulator

    return BulletSimulator()


# Imported late: Numba and PyBullet each take a moment, and PyBullet may not be installed.
SIMULATORS: dict[str, Callable[[int], Simulator]] = {
    "auto": _event_driven,
    "event_driven": _event_driven,
    "stepped": _stepped,
    "bullet": _bullet,
}
"""Makers of engines by name."""

ENGINE_GUIDE = (
    "event_driven, which is also auto: closed forms where motion has one, as for spheres without "
    "air, and steps elsewhere; stepped: steps for all contacts, to compare with; bullet: PyBullet, "
    "to compare with"
)
"""Purpose of each engine, in the words that nodes and the command line show users."""


def make_simulator(name: str, threads: int = 1) -> Simulator:
    """Return the engine of that name.

    Parameters
    ----------
    name : one of `SIMULATORS`
    threads : worker threads over the worlds of a batch; bullet always uses one

    Raises
    ------
    UnknownNameError
        When the name is none of `SIMULATORS`.
    """
    if name not in SIMULATORS:
        raise UnknownNameError(f"simulator is {name!r}; expected one of {', '.join(SIMULATORS)}")
    return SIMULATORS[name](threads)


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
