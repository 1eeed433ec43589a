"""Throws that something happened to: kicked in mid-flight, held, taken for another object."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.materials import StaticParameters
from intuitive_physics.scene import Scene
from intuitive_physics.simulation import Simulator, WorldStatus
from intuitive_physics.state import ObjectState
from intuitive_physics_experiments.paper.paper_dataset import PaperRun, observed_run

# s after the initial states between which something happens; runs last 5 s
EARLIEST, LATEST = 0.5, 3.5
# m that a disturbed motion departs from the true one at least: ten standard deviations of the
# noise of a position
LEAST_DEVIATION = 0.2
KICK_SPEEDS = (1.0, 4.0)  # m/s, slowest and fastest change of velocity by a kick
KICK_SPIN = 5.0  # rad/s, standard deviation of the angular velocity after a kick, on each axis
VELOCITY_STEP = 1e-3  # s over which velocities are differences of positions
# m, shortest and longest way that a hand carries an object before it holds it still
CARRY_DISTANCES = (0.3, 1.0)
CARRY_DURATION = 0.7  # s that a hand takes for it
MOST_ATTEMPTS = 100  # number of draws after which no disturbance is expected to depart far enough
Motion = NDArray[np.float64]  # positions (n_objects, n_times, 3) m
# Returns all positions, given a run, an object's index and that of the time from which something
# happens; None where this draw cannot be carried out
Disturb = Callable[[PaperRun, int, int, np.random.Generator], Motion | None]


class Disturber:
    """Disturbs runs of one set, given its true θ_s and all its runs; `kinds` are named functions.

    The simulator moves objects on after a kick; objects of all runs may be mistaken for one
    another.
    """

    def __init__(
        self, parameters: StaticParameters, simulator: Simulator, others: Sequence[PaperRun]
    ) -> None:
        self._parameters = parameters
        self._simulator = simulator
        self._others = others
        self.kinds: dict[str, Disturb] = {
            "kicked": self._kicked,
            "held": _held,
            "mistracked": self._mistracked,
        }

    def disturb(self, run: PaperRun, kind: str, rng: np.random.Generator) -> PaperRun:
        """Return a run in which one object was disturbed after `EARLIEST`, with noise drawn again.

        Raises an `InvalidInputError` when no draw departs far enough from the true motion.
        """
        times = run.observation.objects[0].trajectory.times
        first, last = np.searchsorted(times, (EARLIEST, LATEST))
        for _ in range(MOST_ATTEMPTS):
            begin = int(rng.integers(first, last))
            number = int(rng.integers(len(run.positions)))
            moved = self.kinds[kind](run, number, begin, rng)
            if moved is None:
                continue
            if np.linalg.norm(moved - run.positions, axis=2).max() >= LEAST_DEVIATION:
                return observed_run(run.scene, times, moved, "three_points", rng)
        raise InvalidInputError(
            f"none of {MOST_ATTEMPTS} draws of a throw that is {kind} departs by "
            f"{LEAST_DEVIATION:g} m; expected another seed to do better"
        )

    def _kicked(
        self, run: PaperRun, number: int, begin: int, rng: np.random.Generator
    ) -> Motion | None:
        """Change the velocity of the object at once, and simulate on."""
        times = run.observation.objects[0].trajectory.times
        at = [times[begin], times[begin] + VELOCITY_STEP]
        before = self._simulator.rollout([run.scene], self._parameters, at)
        velocities = (before.positions[0, :, 1] - before.positions[0, :, 0]) / VELOCITY_STEP
        velocities[number] += rng.uniform(*KICK_SPEEDS) * _direction(rng)
        orientations = np.asarray(before.orientations)[0, :, 0]
        states = tuple(
            ObjectState(
                before.positions[0, i, 0],
                orientations[i],
                velocities[i],
                rng.normal(0.0, KICK_SPIN, 3),
            )
            for i in range(len(velocities))
        )
        scene = Scene(run.scene.environment, run.scene.objects, states)
        since = times[begin:] - times[begin]
        after = self._simulator.rollout([scene], self._parameters, since, orientations=False)
        if before.status[0] != WorldStatus.OK or after.status[0] != WorldStatus.OK:
            return None
        return np.concatenate([run.positions[:, :begin], after.positions[0]], axis=1)

    def _mistracked(
        self, run: PaperRun, number: int, begin: int, rng: np.random.Generator
    ) -> Motion:
        """Continue with the positions of an object of another throw."""
        other = self._others[int(rng.integers(len(self._others)))].positions
        moved = run.positions.copy()
        moved[number, begin:] = other[int(rng.integers(len(other))), begin:]
        return moved


def _held(run: PaperRun, number: int, begin: int, rng: np.random.Generator) -> Motion:
    """Let a hand catch the object, carry it upwards and hold it still to the end."""
    moved = run.positions.copy()
    times = run.observation.objects[0].trajectory.times
    share = np.clip((times[begin:] - times[begin]) / CARRY_DURATION, 0.0, 1.0)
    smooth = share**2 * (3.0 - 2.0 * share)
    way = rng.uniform(*CARRY_DISTANCES) * _direction(rng)
    moved[number, begin:] = moved[number, begin] + smooth[:, None] * way
    return moved


def _direction(rng: np.random.Generator) -> NDArray[np.float64]:
    """Draw a unit vector (3,) that does not point downwards."""
    vector = rng.normal(size=3)
    vector[2] = abs(vector[2])
    return vector / np.linalg.norm(vector)
