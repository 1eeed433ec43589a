"""Engines by name."""

from __future__ import annotations

from collections.abc import Callable

from intuitive_physics.errors import UnknownNameError
from intuitive_physics.simulation.simulator import Simulator


def _event_driven() -> Simulator:
    from intuitive_physics.simulation.event_driven import EventDrivenSimulator

    return EventDrivenSimulator()


def _bullet() -> Simulator:
    from intuitive_physics.simulation.bullet import BulletSimulator

    return BulletSimulator()


# Imported late: Numba and PyBullet each take a moment, and PyBullet may not be installed.
SIMULATORS: dict[str, Callable[[], Simulator]] = {
    "event_driven": _event_driven,
    "bullet": _bullet,
}


def make_simulator(name: str) -> Simulator:
    """Return the engine of that name.

    Raises
    ------
    UnknownNameError
        When the name is none of `SIMULATORS`.
    """
    if name not in SIMULATORS:
        raise UnknownNameError(f"simulator is {name!r}; expected one of {', '.join(SIMULATORS)}")
    return SIMULATORS[name]()
