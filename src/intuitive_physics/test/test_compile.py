"""What set-up compiles is all that any call needs, so that no call waits for a compiler."""

from __future__ import annotations

import importlib
import pkgutil

import numpy as np
from numba.core.dispatcher import Dispatcher

import intuitive_physics.simulation
from intuitive_physics.kernels.warm_up import main
from intuitive_physics.scene import Plane
from intuitive_physics.shapes import Box, Capsule, Sphere
from intuitive_physics.simulation import compile as compilation
from intuitive_physics.simulation import pack_worlds
from intuitive_physics.simulation.core.engines import EventDrivenSimulator, SteppedSimulator

from .laws_scenes import Body, coefficients, make_scene

SHEET = Plane("sheet", "ground", (0, 0, 1), 0, [(-1, -1, 0), (1, -1, 0), (0, 1, 0)])
STATIC_BOX = ((0, 0, -0.5), (1, 1, 1))
BALL = Body(Sphere(0.05), (0, 0, 1))
BALLS = [
    make_scene(BALL),
    make_scene(BALL, Body(Sphere(0.1), (1, 0, 1))),
    make_scene(BALL, planes=()),
    make_scene(BALL, planes=[SHEET]),
    make_scene(BALL, planes=(), boxes=[STATIC_BOX]),
]
OTHERS = [
    make_scene(Body(Box((0.1, 0.2, 0.3)), (0, 0, 1)), planes=[SHEET], boxes=[STATIC_BOX]),
    make_scene(Body(Capsule(0.05, 0.2), (0, 0, 1), air={"drag_coefficient": 0.5})),
]


def kept_kernels() -> dict[str, Dispatcher]:
    """All kernels of the simulation whose code Numba keeps in files, by name."""
    package = intuitive_physics.simulation
    kernels = {}
    for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
        if "bullet" not in module.name:
            for thing in vars(importlib.import_module(module.name)).values():
                if isinstance(thing, Dispatcher) and thing.stats.cache_path is not None:
                    kernels[f"{thing.__module__}.{thing.__name__}"] = thing
    return kernels


def call_in_all_ways(simulator, scenes):
    """Simulate as users do: few or many, all or some outputs, packed, chosen, repeated."""
    theta = coefficients(e=0.5)
    unchangeable = np.linspace(0.0, 0.1, 3)
    unchangeable.setflags(write=False)
    simulator.rollout(scenes, theta, [1])
    simulator.rollout(scenes, [theta] * len(scenes), unchangeable, orientations=False)
    simulator.rollout(scenes[:1], theta, np.linspace(0.0, 0.2, 9)[::2])
    worlds = pack_worlds(scenes, theta)
    simulator.rollout_batch(worlds, [[0.0, 0.1], [0.1, np.nan]] + [[0.0, 0.1]] * (worlds.size - 2))
    simulator.rollout_batch(worlds.crossed([theta] * 100), [0.1], orientations=False)
    simulator.rollout_batch(worlds.taken(np.array([1, 0])), [0.1])
    one = pack_worlds(scenes[:1], theta)
    view = np.ones((3, 2, 1)) * one.states
    simulator.rollout_batch(one.taken(np.zeros(3, dtype=np.int64), states=view[:, :1]), [0.1])
    states = np.asfortranarray(np.repeat(one.states, 3, axis=0), dtype=np.float32)
    simulator.rollout_batch(one.repeated(states, [theta] * 3), [0.1])


def test_no_call_compiles_what_set_up_has_not():
    # A kernel is compiled for the types of its arguments, and once more for each new type. The
    # warm-up is one of the calls: where there is one compiled version, it is that of the warm-up.
    compilation.warm_up()
    for threads in (1, 2):
        call_in_all_ways(EventDrivenSimulator(threads=threads), BALLS)
        call_in_all_ways(SteppedSimulator(threads=threads), BALLS + OTHERS)
    kernels = kept_kernels()
    assert len(kernels) >= 3
    assert {name: len(kernel.signatures) for name, kernel in kernels.items()} == dict.fromkeys(
        kernels, 1
    )


def test_the_command_compiles_in_processes_of_its_own(capsys):
    main(["intuitive_physics.simulation.compile"])
    assert "kernels ready after" in capsys.readouterr().out
