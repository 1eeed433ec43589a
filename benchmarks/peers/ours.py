"""This project's engines, through the interface that everybody has."""

from __future__ import annotations

import time

import numpy as np

from benchmarks.peers.engine import Engine, Prediction, Prepared
from benchmarks.scenes import Instance
from intuitive_physics.simulation import Simulator, make_simulator, pack_worlds

NAMES = ("event_driven", "stepped")  # our engines, of which the first is `auto`


class Ours(Engine):
    """One of our simulators, by its name; orientations are asked of no peer."""

    def __init__(self, simulator: str, *, orientations: bool = False, threads: int = 1) -> None:
        options = {"orientations": orientations, f"{threads} threads": threads > 1}
        self.name = ", ".join([simulator, *(name for name, on in options.items() if on)])
        self.how = f"rollout_batch(worlds.repeated(states), times, orientations={orientations})"
        self._simulator = simulator
        self._orientations = orientations
        self._threads = threads

    def prepare(self, instance: Instance, steps: int, time_step: float) -> Prepared:
        simulator = make_simulator(self._simulator, threads=self._threads)
        return _Prepared(simulator, instance, steps, time_step, self._orientations)


class _Prepared(Prepared):
    def __init__(
        self,
        simulator: Simulator,
        instance: Instance,
        steps: int,
        time_step: float,
        orientations: bool,
    ) -> None:
        self._simulator = simulator
        self._world = pack_worlds([instance.scene], instance.static_parameters)
        self._starts = instance.starts
        self._times = time_step * np.arange(1, steps + 1)
        self._orientations = orientations

    def predict(self) -> Prediction:
        start = time.perf_counter()
        rollout = self._simulator.rollout_batch(
            self._world.repeated(self._starts), self._times, orientations=self._orientations
        )
        seconds = time.perf_counter() - start
        if rollout.status.any():
            raise RuntimeError(
                f"{self._simulator.name} answered the status {rollout.status.tolist()}; "
                "expected all simulations to end OK"
            )
        return Prediction(seconds, rollout.positions)
