"""The interface of all engines that are compared."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.scenes import TIME_STEP, Instance, dropped


class MissingPeerError(Exception):
    """A peer is not installed; the message says how to get it."""


@dataclass(frozen=True, eq=False)
class Prediction:
    """Positions (n_simulations, n_objects, n_steps, 3) m after each step of one instance.

    The seconds are the wall time of setting initial states, simulating and writing positions.
    """

    seconds: float
    positions: NDArray[np.float64]


class Prepared(AbstractContextManager["Prepared"], ABC):
    """An engine with an instance's world built, ready to simulate it again and again."""

    @abstractmethod
    def predict(self) -> Prediction:
        """Simulate all starts of the instance once."""

    def __exit__(self, *_: object) -> None:
        """Release what the engine holds."""


class Engine(ABC):
    """Simulates instances on one thread at equal time steps; `how` says how it is set up.

    An `optional` engine is left out where it is missing.
    """

    name: str
    how: str
    optional = False

    @abstractmethod
    def prepare(self, instance: Instance, steps: int, time_step: float) -> Prepared:
        """Build the world, which is not measured."""


def present(engines: Sequence[Engine]) -> tuple[list[Engine], list[str]]:
    """Return the engines that are there, and the words of the optional ones that are missing.

    Raises
    ------
    MissingPeerError : one is missing that is not optional
    """
    there: list[Engine] = []
    words: list[str] = []
    for engine in engines:
        try:
            with engine.prepare(dropped(1.0, 0.5), 1, TIME_STEP):
                there.append(engine)
        except MissingPeerError as missing:
            if not engine.optional:
                raise
            words.append(f"left out: {missing}")
    return there, list(dict.fromkeys(words))
