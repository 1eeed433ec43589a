"""Additions of other installed packages to the command line, by entry points.

A package adds commands, readers of recordings and engines without the command line knowing it, so
that a robot's installation needs nothing of it. In its `setup.py`:

```
entry_points={
    "intuitive_physics_cli.commands": ["render = my_package.render_command"],
    "intuitive_physics_cli.observation_readers": ["npz = my_package.recorded_data:load"],
    "intuitive_physics_cli.engines": ["mujoco = my_package.mujoco_simulator:MujocoSimulator"],
}
```
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

from intuitive_physics.errors import InvalidInputError, UnknownNameError
from intuitive_physics.observation import Observation
from intuitive_physics.simulation import SIMULATORS, Simulator, make_simulator

COMMANDS = "intuitive_physics_cli.commands"
"""Group of modules with a function `add_to(commands)`, as the command line's own have."""

OBSERVATION_READERS = "intuitive_physics_cli.observation_readers"
"""Group of functions from a path to title and observations; the name is the file's suffix."""

ENGINES = "intuitive_physics_cli.engines"
"""Group of functions that return a `Simulator`; the name is the engine's."""

Reader = Callable[[Path], tuple[str, list[Observation]]]


def command_modules() -> dict[str, Any]:
    """Return the modules of added commands by the commands' names.

    Those of a package that cannot be loaded are left out; one line on standard error says so.
    """
    modules: dict[str, Any] = {}
    left_out: dict[tuple[str, str], list[str]] = {}
    for entry in _installed(COMMANDS):
        try:
            modules[entry.name] = entry.load()
        # Whatever is wrong with another package, the commands of this one go on.
        except Exception as error:
            package = entry.module.partition(".")[0]
            reason = " ".join(f"{type(error).__name__}: {error}".split())
            left_out.setdefault((package, reason), []).append(entry.name)
    for (package, reason), names in left_out.items():
        print(
            f"intuitive-physics: warning: {', '.join(names)} of {package} cannot be loaded: "
            f"{reason}",
            file=sys.stderr,
        )
    return modules


def observation_reader(suffix: str) -> Reader | None:
    """Return what reads observations from files with a suffix such as ".npz", None without one."""
    for entry in _installed(OBSERVATION_READERS):
        if f".{entry.name}" == suffix:
            reader: Reader = _loaded(entry)
            return reader
    return None


def make_engine(name: str) -> Simulator:
    """Return the engine of that name, the library's or an added one."""
    if name in SIMULATORS:
        return make_simulator(name)
    added = {entry.name: entry for entry in _installed(ENGINES)}
    if name not in added:
        names = ", ".join([*SIMULATORS, *added])
        raise UnknownNameError(f"simulator is {name!r}; expected one of {names}")
    simulator: Simulator = _loaded(added[name])()
    return simulator


def _installed(group: str) -> list[EntryPoint]:
    """Return the entry points of a group by name; of two with one name the first."""
    entries: dict[str, EntryPoint] = {}
    for entry in sorted(entry_points(group=group), key=lambda entry: entry.name):
        entries.setdefault(entry.name, entry)
    return list(entries.values())


def _loaded(entry: EntryPoint) -> Any:
    try:
        return entry.load()
    except ImportError as error:
        raise InvalidInputError(
            f"{entry.name} needs {entry.module}, which cannot be imported: {error}; "
            "install what is missing"
        ) from None
