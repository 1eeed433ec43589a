"""Rules that move one current point (Sec. III-D): descent by one or all parameters, and 1D-MH."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_learner.search.update_rules.grid_and_random_search import grid_levels
from intuitive_physics_learner.search.update_rules.update_rule import UpdateRule


class ClimbingRule(UpdateRule):
    """A rule that has one current point, at first a random one, and moves where J is lower.

    Attributes
    ----------
    point : (n,) current point of the unit cube; None before the first
    cost : J in m at the current point
    """

    def _prepare(self) -> None:
        self.point: NDArray[np.float64] | None = None
        self.cost = np.inf

    def continue_from(self, point: NDArray[np.float64], cost: float) -> None:
        """Take over a point, (n,) of the unit cube, with its J in m."""
        self.point = point.copy()
        self.cost = cost

    def propose(self) -> NDArray[np.float64]:
        if self.point is None:
            return self._random_points(1)
        return self._neighbours(self.point)

    def update(self, points: NDArray[np.float64], costs: NDArray[np.float64]) -> None:
        first = self.point is None
        best = int(np.argmin(costs))
        gained = bool(costs[best] < self.cost)
        if gained:
            self.continue_from(points[best], float(costs[best]))
        if not first:
            self._after(gained)

    @abstractmethod
    def _neighbours(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return candidates, shape (k, n), made from the current point, shape (n,)."""

    def _after(self, gained: bool) -> None:
        """Prepare what comes next, knowing whether the last candidates brought a gain."""


class CoordinateDescent(ClimbingRule):
    """Sweeps over all parameters, each sweep in a new random order."""

    name = "coordinate_descent"

    defaults: ClassVar[Mapping[str, float]] = {"increment": 0.05}
    """increment: δp, step of a parameter on the unit interval."""

    def _prepare(self) -> None:
        super()._prepare()
        self._levels = grid_levels(self.settings["increment"])
        self._order: list[int] = self._generator.permutation(self.size).tolist()
        self._position = 0

    def _neighbours(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        points = np.tile(point, (self._levels.size, 1))
        points[:, self._order[self._position]] = self._levels
        return points

    def _after(self, gained: bool) -> None:
        self._position += 1
        if self._position == self.size:
            self._order = self._generator.permutation(self.size).tolist()
            self._position = 0


class ParameterGradientSearch(ClimbingRule):
    """Adds δp to one parameter as long as J falls, else turns around with half the step.

    Attributes
    ----------
    targets_done : how many parameters were followed to their end
    """

    name = "parameter_gradient"

    defaults: ClassVar[Mapping[str, float]] = {"learning_rate": 0.1, "smallest_step": 0.001}
    """learning_rate: α, first step on the unit interval; smallest_step: β, below which the next
    parameter is targeted."""

    def _prepare(self) -> None:
        super()._prepare()
        self._step = self.settings["learning_rate"]
        self._target = int(self._generator.integers(self.size))
        self.targets_done = 0

    def _neighbours(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        moved = point.copy()
        moved[self._target] = np.clip(moved[self._target] + self._step, 0.0, 1.0)
        return moved[None, :]

    def _after(self, gained: bool) -> None:
        if gained:
            return
        self._step = -0.5 * self._step
        if abs(self._step) < self.settings["smallest_step"]:
            self._step = self.settings["learning_rate"]
            self._target = int(self._generator.integers(self.size))
            self.targets_done += 1


class AdaptiveRandomSearch(ClimbingRule):
    """Adds δp = U(-ε, ε) to all parameters at once, ε being J of the current point.

    ε is the number of metres, taken as a part of the unit interval. A coordinate that would leave
    the interval stays at its end. Table I gives this rule an α and a β that the paper's text does
    not use; `BoundedAdaptiveRandomSearch` has them.
    """

    name = "adaptive_random"

    def _neighbours(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        epsilon = self._epsilon()
        steps = self._generator.uniform(-epsilon, epsilon, (1, self.size))
        return np.clip(point + steps, 0.0, 1.0)

    def _epsilon(self) -> float:
        """Largest step on the unit interval."""
        return self.cost


class BoundedAdaptiveRandomSearch(AdaptiveRandomSearch):
    """Adaptive random search whose ε is held between β and α.

    With J of decimetres, steps of ε = J reach over the whole interval and nothing adapts; a J near
    0 leaves no step. Table I names an α and a β for adaptive random search; this reads them as
    they are meant in parameter gradient search, the largest and the smallest step.
    """

    name = "bounded_adaptive_random"

    defaults: ClassVar[Mapping[str, float]] = {"learning_rate": 0.1, "smallest_step": 0.001}
    """learning_rate: α, largest ε on the unit interval; smallest_step: β, smallest ε."""

    def _epsilon(self) -> float:
        smallest = self.settings["smallest_step"]
        return float(np.clip(self.cost, smallest, max(self.settings["learning_rate"], smallest)))


class MetropolisHastings(ClimbingRule):
    """Adds δp = U(-α, α) to one random parameter and accepts as Metropolis and Hastings do.

    A candidate of cost J' replaces the current one of cost J with the chance
    min(1, exp((J - J') / temperature)); the paper names no temperature.
    """

    name = "metropolis_hastings"

    defaults: ClassVar[Mapping[str, float]] = {"learning_rate": 0.05, "temperature": 0.001}
    """learning_rate: α, largest step on the unit interval; temperature: m of cost by which a
    candidate is accepted with the chance 1/e."""

    def _neighbours(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        alpha = self.settings["learning_rate"]
        moved = point.copy()
        target = self._generator.integers(self.size)
        # Reflected at the bounds, not clipped: else the chain would not be symmetric and stick.
        there = np.abs(moved[target] + self._generator.uniform(-alpha, alpha)) % 2.0
        moved[target] = min(there, 2.0 - there)
        return moved[None, :]

    def update(self, points: NDArray[np.float64], costs: NDArray[np.float64]) -> None:
        rise = max(float(costs[0]) - self.cost, 0.0)
        if self._generator.random() < np.exp(-rise / self.settings["temperature"]):
            self.continue_from(points[0], float(costs[0]))
