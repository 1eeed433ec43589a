"""Fits to objects that moved alone, each object by itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from intuitive_physics.observation import Observation
from intuitive_physics.shapes import Sphere
from intuitive_physics_learner.joint_estimation.fit_horizons import FIRST_DURATION
from intuitive_physics_learner.joint_estimation.joint_fit import JointEstimationSettings, JointFit
from intuitive_physics_learner.joint_estimation.several_starts import durations
from intuitive_physics_learner.search.gaussian import Gaussian
from intuitive_physics_learner.search.learning_task import FitTask

SEPARATE_STEPS = 20
"""Steps at most of the fits to objects that moved alone, each object by itself, before all
observations are fitted jointly; in the same time 20 and 40 gave the same excess on four sets of ten
objects."""

SMALLEST_SEPARATE_SHARE = 0.3
"""Share of the observations that are of objects alone from which on these are fitted first; half of
those of the paper's sets are, where that is better; set by hand; 1: jointly from the beginning
unless all moved alone."""

TUMBLING_STEPS = 12
"""Steps from which on a separate fit shows whether an object tumbles, and then ends."""

LARGEST_TUMBLING_SHARE = 0.4
"""Mean share that a fit of single states explains of the time that it could in `SEPARATE_STEPS`, up
to which an object tumbles: of 70 objects (seeds 600 on) after twelve steps at most 0.29 for boxes,
at least 0.51 for others."""

FEWEST_IN_SEGMENTS = 4
"""Throws of an object from which on they are fitted in segments."""


@dataclass(frozen=True, eq=False)
class FitOf:
    """A fit of some observations over some parameters.

    Parameters
    ----------
    members : (n_members,) indices of the observations
    parameters : (k,) indices of the parameters
    fit : of these
    """

    members: NDArray[np.int64]
    parameters: NDArray[np.int64]
    fit: JointFit

    @staticmethod
    def of(task: FitTask, members: NDArray[np.int64]) -> FitOf:
        """Return a fit of some observations of a task, over the parameters that they depend on.

        `members` (n_members,) indices of the observations.
        """
        parameters = np.flatnonzero(task.influence[members].any(axis=0))
        fit = JointFit(task.part(members, parameters), JointEstimationSettings())
        return FitOf(members, parameters, fit)


class SeparateFits:
    """One fit for each group of observations of single objects without a common parameter.

    `end_early` : whether the fit to an object that tumbles ends as soon as that shows.

    Attributes
    ----------
    parts : the fits; none where too few observations are of single objects
    """

    def __init__(self, task: FitTask, *, end_early: bool) -> None:
        self._count, self._end_early = len(task.influence), end_early
        groups = separable(task.cost.observations, task.influence)
        if sum(map(len, groups)) < SMALLEST_SEPARATE_SHARE * len(task.cost.observations):
            groups = []
        self.parts = [FitOf.of(task, members) for members in groups]

    @property
    def others(self) -> NDArray[np.bool_]:
        """Which observations are not fitted separately, (n_observations,)."""
        others = np.ones(self._count, dtype=bool)
        for part in self.parts:
            others[part.members] = False
        return others

    @property
    def unfinished(self) -> list[FitOf]:
        """The fits that have not found what they can."""
        return [part for part in self.parts if not self.has_ended(part.fit)]

    def has_ended(self, fit: JointFit) -> bool:
        """Return whether a fit to objects alone has found what it can."""
        if fit.settled or fit.steps >= SEPARATE_STEPS:
            return True
        return self._end_early and fit.steps >= TUMBLING_STEPS and tumbles(fit)

    def knowledge(self, task: FitTask) -> Gaussian:
        """Return what is known of θ_s by a task with the same observations, and by these fits.

        Those of observations that do not count say nothing.
        """
        known = task.prior
        for part in self.parts:
            if task.counted[part.members].any():
                said = Gaussian.nothing(part.fit.unit.size).plus(
                    part.fit.likelihoods(), part.fit.weights
                )
                known = known.joined(said.among(part.parameters, known.mean.size))
        return known

    def state(self) -> list[dict[str, Any]]:
        """Return the states of the fits, as plain JSON data."""
        return [part.fit.state() for part in self.parts]

    def load_state(self, states: Sequence[Mapping[str, Any]]) -> None:
        """Continue from the states of the fits."""
        for part, part_state in zip(self.parts, states, strict=True):
            part.fit.load_state(part_state)


def may_tumble(fit: JointFit) -> bool:
    """Whether a fit is to enough throws of single objects, none of them a sphere."""
    observations = fit.model.cost.observations
    if len(observations) < FEWEST_IN_SEGMENTS or not all_alone(observations):
        return False
    return not any(isinstance(each.objects[0].object.shape, Sphere) for each in observations)


def tumbles(fit: JointFit) -> bool:
    """Whether a fit got so little far in throws of single objects that motion must be chaotic."""
    if not may_tumble(fit):
        return False
    possible = FIRST_DURATION + SEPARATE_STEPS * fit.model.largest_advance
    share = (fit.horizons / np.minimum(durations(fit), possible)).mean()
    return float(share) < LARGEST_TUMBLING_SHARE


def all_alone(observations: Sequence[Observation]) -> bool:
    """Whether each of the observations is of a single object."""
    return all(len(observation.objects) == 1 for observation in observations)


def separable(
    observations: Sequence[Observation], influence: NDArray[np.bool_]
) -> list[NDArray[np.int64]]:
    """Find groups of observations of single objects that have no parameter in common.

    `influence` (n_observations, n) bool, which observation can depend on which parameter. Returns
    arrays (n_members,) of indices of observations; none where they would all be in one group, which
    a joint fit is for.
    """
    alone = np.array([len(observation.objects) == 1 for observation in observations])
    lone = np.flatnonzero(alone & influence.any(axis=1))
    if not lone.size:
        return []
    shared = csr_array(influence[lone].astype(np.int64))
    count, labels = connected_components(shared @ shared.T, directed=False)
    if count == 1:
        return []
    return [lone[labels == k] for k in range(count)]
