"""Descent of J itself, from the observed initial states, where trajectories cannot be fitted.

Where the simulation lacks an effect that the observations have (air, a spin, an inexact shape), no
θ_s and no initial states explain them within their noise, and the best θ_s is that of the lowest J.
J is a sum of distances and not of their squares, so Gauss-Newton steps weigh each point by one over
its distance (Weiszfeld); only a step that lowers J is taken. Trying each parameter over its whole
range leaves local optima.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_learner.cost.cost_function import chunks
from intuitive_physics_learner.cost.trials import Trials
from intuitive_physics_learner.joint_estimation.linearisation import separate_groups
from intuitive_physics_learner.joint_estimation.normal_equations import bounded_step
from intuitive_physics_learner.joint_estimation.observation_blocks import LARGEST_BLOCK
from intuitive_physics_learner.joint_estimation.scans import (
    SCAN_LEVELS,
    compatible_moves,
    scan_candidates,
)
from intuitive_physics_learner.search.learning_task import FitTask
from intuitive_physics_learner.search.plain_state import Resumable

DESCENT_DAMPINGS = (1e-3, 1e-2, 0.1, 1.0, 10.0)
"""Dampings, parts of the diagonal, that are tried in one step; set by hand."""

DESCENT_LENGTHS = (0.5, 1.0, 2.0)
"""Factors on each damped step that are tried: J has kinks, which a step may fall short of; set by
hand."""

FIRST_WIDTH = 0.1
"""Width of the differences for the first slopes of a descent of J, widths: wide against the kinks
of single contacts; set by hand."""

WIDTH_FACTOR = 0.4
"""Factor on that width when steps along slopes gain nothing; set by hand."""

SMALLEST_WIDTH = 0.002
"""Width of the differences below which a descent of J takes no more slopes, widths; set by hand."""

NEIGHBOURS = (-3.0, -1.0, -0.3, 0.3, 1.0, 3.0)
"""Distances, in that width, at which each parameter is tried when steps along slopes gain nothing;
set by hand."""

SMALLEST_GAIN = 1e-4
"""Part of J by which it must fall to be a gain; set by hand."""

SHORT_LENGTH = 0.1
"""Part of the median distance below which distances count as squares: a sum of distances has no
slope at zero; set by hand."""


class CostDescent(Resumable):
    """Gauss-Newton steps on J, from the best of some points.

    Attributes
    ----------
    unit : (n,) the point of the unit cube with the lowest J so far
    cost : that J in m; infinite before it has begun
    simulations : of single observations, so far
    finished : whether the descent has ended
    """

    remembered = ("unit", "cost", "finished", "simulations", "_width", "_scan_next")

    def __init__(self, task: FitTask) -> None:
        self._cost = task.cost
        self._space = task.space
        self._influence = task.influence
        self._groups = separate_groups(task.influence)
        self.unit = np.full(task.space.size, 0.5)
        self.cost = np.inf
        self.finished = False
        self.simulations = 0
        self._width = FIRST_WIDTH
        self._scan_next = True

    def take_best(self, points: NDArray[np.float64]) -> None:
        """Begin at the best of points (k, n) of the unit cube, or take it over if it is better."""
        candidates = [self._space.to_parameters(point) for point in points]
        costs = self._cost.costs(candidates)
        self.simulations += len(candidates) * len(self._cost.observations)
        best = int(np.argmin(costs))
        if costs[best] < self.cost:
            self.unit, self.cost = np.array(points[best]), float(costs[best])

    def step(self) -> None:
        """Try to lower J: over the range of each parameter first, then along slopes."""
        if self._scan_next:
            self._scan_next = False
            self._scan(np.tile(SCAN_LEVELS, (self._space.size, 1)))
        else:
            self._descend_or_narrow()
            self.finished = self._width < SMALLEST_WIDTH

    def _descend_or_narrow(self) -> None:
        before = self.cost
        self._descend()
        if self._gained(before):
            return
        beside = self.unit[:, None] + self._width * np.array(NEIGHBOURS)
        self._scan(np.clip(beside, 0.0, 1.0))
        if not self._gained(before):
            self._width *= WIDTH_FACTOR

    def _gained(self, before: float) -> bool:
        """Whether J is lower than before by enough to count."""
        return self.cost < before * (1.0 - SMALLEST_GAIN)

    def _descend(self) -> None:
        """Take the best of some damped Gauss-Newton steps."""
        parts = list(self._linearised())
        lengths = np.concatenate([np.linalg.norm(residuals, axis=1) for _, residuals, _ in parts])
        if lengths.size == 0:
            return
        short = max(SHORT_LENGTH * float(np.median(lengths)), np.finfo(float).tiny)
        information, scores = np.zeros((self._space.size,) * 2), np.zeros(self._space.size)
        for columns, residuals, slopes in parts:
            lengths = np.linalg.norm(residuals, axis=1)
            # Every observation counts as in J, whatever its number of points.
            weights = 1.0 / (lengths.size * np.maximum(lengths, short))
            weighted = slopes * weights[:, None]
            information[np.ix_(columns, columns)] += np.einsum("kpi,lpi->kl", weighted, slopes)
            scores[columns] += np.einsum("kpi,pi->k", weighted, residuals)
        # What no point depends on stays where it is.
        still_there = np.diag(information) <= 0.0
        information[still_there, still_there] = 1.0
        steps = [
            bounded_step(self.unit, information, scores, damping) for damping in DESCENT_DAMPINGS
        ]
        tried = [self.unit + length * step for step in steps for length in DESCENT_LENGTHS]
        self.take_best(np.clip(tried, 0.0, 1.0))

    def _linearised(
        self,
    ) -> Iterator[tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]]:
        """Yield each one's k parameters, residuals (P, 3) m and slopes (k, P, 3) m per width."""
        below = np.maximum(self.unit - self._width, 0.0)
        above = np.minimum(self.unit + self._width, 1.0)
        levels = np.column_stack([below, above])
        moved, places = scan_candidates(self.unit, self._groups, self._space, levels)
        candidates = [self._space.to_parameters(self.unit), *moved]
        columns = [np.flatnonzero(row) for row in self._influence]
        for members in chunks(np.arange(len(columns)), LARGEST_BLOCK):
            index = [np.append(0, 1 + places[columns[i]].T) for i in members]
            sizes = [each.size for each in index]
            trials = Trials(candidates, np.concatenate(index), np.repeat(members, sizes))
            self.simulations += trials.size
            every = self._cost.trial_residuals(trials)
            for i, own in zip(members, np.split(every, np.cumsum(sizes)[:-1]), strict=True):
                # No point is there, or the simulation failed.
                residuals = own[:, np.isfinite(own).all(axis=(0, 2))]
                here, down, up = np.split(residuals, [1, 1 + columns[i].size])
                yield columns[i], here[0], (up - down) / (above - below)[columns[i], None, None]

    def _scan(self, levels: NDArray[np.float64]) -> None:
        """Move parameters to those of their levels (n, n_levels) where J is lower."""
        candidates, index = scan_candidates(self.unit, self._groups, self._space, levels)
        count = len(self._cost.observations)
        self.simulations += len(candidates) * count
        here = self._cost.observation_costs([self._space.to_parameters(self.unit)])[0]
        there = self._cost.observation_costs(candidates) - here
        changes = np.array(
            [(there[index[k]] * self._influence[:, k]).sum(axis=1) for k in range(self._space.size)]
        )
        best = np.argmin(changes, axis=1)
        least_gain = SMALLEST_GAIN * self.cost
        moves = compatible_moves(-changes.min(axis=1), self._influence, least_gain)
        if not moves:
            return
        moved = self.unit.copy()
        moved[moves] = levels[moves, best[moves]]
        self.take_best(moved[None])
