"""Questions that a throw shall answer: parameters, or the answer to a query."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError, UnknownNameError
from intuitive_physics.materials import StaticParameters, parameter_places
from intuitive_physics.parameter_posterior import ParameterPosterior
from intuitive_physics.regions import Region
from intuitive_physics.scene import Scene
from intuitive_physics.simulation import Simulator
from intuitive_physics.simulation.world_batch import pack_worlds
from intuitive_physics.validation import positive_float
from intuitive_physics_learner.cost.parameter_influence import influence_on_worlds
from intuitive_physics_learner.design.expected_information import Reduction
from intuitive_physics_learner.given_parameters import parameter_indices

QUERY_DRAWS = 256
"""Draws of θ_s by which the dependence of a query's answer on θ_s is found; set by hand."""

RATE = 60.0
"""1/s at which a simulated trajectory is held against a region."""

SMALLEST_SHARE = 1e-12
"""Share of a variance below which it is rounding."""

SMALLEST_CHANGE = 1e-9
"""Change of an answer (m, or without a unit) over all draws below which it is rounding."""


class Question(ABC):
    """Asks for r linear functions of θ_s."""

    @abstractmethod
    def information(self, reduction: Reduction) -> NDArray[np.float64]:
        """Information (W,), nat, that each throw is worth."""

    @abstractmethod
    def functions(self, posterior: ParameterPosterior) -> list[tuple[str, float]]:
        """Name of each function, and its unit: what it changes by, in SI, where it grows by one."""

    @abstractmethod
    def directions(
        self, posterior: ParameterPosterior, simulator: Simulator, rng: np.random.Generator
    ) -> NDArray[np.float64]:
        """Slopes (r, n) of the functions per width of each of the n parameters."""


@dataclass(frozen=True)
class AboutParameters(Question):
    """Which values have these parameters?

    Parameters
    ----------
    names : as in `parameter_names`, a pair's materials in any order; at least one
    resolution : widths, differences of a parameter below which are of no interest, so that a throw
        is chosen for what is not known well enough yet
    """

    names: tuple[str, ...]
    resolution: float = 0.01

    def __post_init__(self) -> None:
        positive_float(self.resolution, "resolution")

    def information(self, reduction: Reduction) -> NDArray[np.float64]:
        """Half the fall of ln det beyond the resolution, (W,) nat."""
        return np.asarray(0.5 * reduction.determinant_fall(self.resolution))

    def functions(self, posterior: ParameterPosterior) -> list[tuple[str, float]]:
        """The parameters by name, with the change of each in its SI unit per width."""
        slopes = np.diag(posterior.space.slopes(posterior.mean))
        names = posterior.space.names
        return [(names[k], float(slopes[k])) for k in self.indices(names)]

    def directions(
        self, posterior: ParameterPosterior, simulator: Simulator, rng: np.random.Generator
    ) -> NDArray[np.float64]:
        """One for each parameter asked about, zero for others: (r, n) units per width."""
        return np.eye(posterior.mean.size)[self.indices(posterior.space.names)]

    def indices(self, all_names: Sequence[str]) -> list[int]:
        """Return the index of each among the names of all parameters."""
        indices = parameter_indices(self.names, all_names)
        if not indices or len(set(indices)) != len(indices):
            raise InvalidInputError(
                f"parameters asked for are {list(self.names)}; expected at least one, each once"
            )
        return indices


@dataclass(frozen=True, eq=False)
class AboutMotion(Question):
    """The question where an object will be, or whether it will have been in a region.

    The answer is not linear in θ_s: whether a ball clears a box hardly changes, and then all at
    once. So its slopes are those of the linear function that comes closest to it over draws of θ_s
    from the posterior (least squares), not its derivatives at one place.

    Parameters
    ----------
    scene : with its initial states
    object_id : of the object asked about
    time : s after the start
    region : whether the object's centre enters it by then is the answer, 0 or 1; None: the answer
        is where the object is then, m
    """

    scene: Scene
    object_id: str
    time: float
    region: Region | None = None

    def __post_init__(self) -> None:
        positive_float(self.time, "time of the query")
        ids = [item.id for item in self.scene.objects]
        if self.object_id not in ids:
            raise UnknownNameError(f"object is {self.object_id!r}; expected one of {ids}")

    def information(self, reduction: Reduction) -> NDArray[np.float64]:
        """Half the fall of the logarithm of the summed variance, (W,) nat."""
        start, end = np.trace(reduction.before), reduction.variances.sum(axis=1)
        if start <= 0.0:
            return np.zeros(end.shape)
        return np.asarray(0.5 * np.log(start / np.maximum(end, SMALLEST_SHARE * start)))

    def functions(self, posterior: ParameterPosterior) -> list[tuple[str, float]]:
        """The coordinates, m, or the probability of the region."""
        if self.region is not None:
            return [(f"{self.object_id} enters the region within {self.time:g} s", 1.0)]
        return [(f"{axis} of {self.object_id} at {self.time:g} s", 1.0) for axis in "xyz"]

    def directions(
        self, posterior: ParameterPosterior, simulator: Simulator, rng: np.random.Generator
    ) -> NDArray[np.float64]:
        """Slopes (r, n) per width of the linear function closest to the answer over draws."""
        scene_posterior = posterior.extended(self.scene.materials)
        units = scene_posterior.draw(QUERY_DRAWS, rng)
        answers = self._answers(
            [scene_posterior.space.to_parameters(unit) for unit in units], simulator
        )
        good = np.isfinite(answers).all(axis=1)
        if not good.any():
            raise InvalidInputError(
                "the query's scene cannot be simulated with any draw of the static parameters; "
                "expected another scene or time"
            )
        world = self.scene.environment, self.scene.objects
        matters = influence_on_worlds([world], self.scene.materials)[0]
        off = units[good] - units[good].mean(axis=0)
        change = answers[good] - answers[good].mean(axis=0)
        change[:, np.ptp(answers[good], axis=0) < SMALLEST_CHANGE] = 0.0
        answer_slopes = np.zeros((answers.shape[1], units.shape[1]))
        answer_slopes[:, matters] = np.linalg.lstsq(off[:, matters], change, rcond=None)[0].T
        old, new = parameter_places(scene_posterior.materials, posterior.materials)
        slopes = np.zeros((answers.shape[1], posterior.mean.size))
        slopes[:, new] = answer_slopes[:, old]
        return slopes

    def _answers(
        self, parameters: Sequence[StaticParameters], simulator: Simulator
    ) -> NDArray[np.float64]:
        """Answers (n_draws, r) under each θ_s; NaN where none was simulated."""
        worlds = pack_worlds([self.scene] * len(parameters), parameters)
        times = np.array([self.time])
        if self.region is not None:
            times = np.linspace(0.0, self.time, max(2, int(self.time * RATE)))
        rollout = simulator.rollout_batch(worlds, times, orientations=False)
        k = [item.id for item in self.scene.objects].index(self.object_id)
        positions = rollout.positions[:, k]
        if self.region is None:
            return positions[:, -1]
        enters = self.region.contains(positions).any(axis=1).astype(np.float64)
        return np.where(rollout.status == 0, enters, np.nan)[:, None]
