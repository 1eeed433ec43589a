"""The order of fits: first objects that moved alone, each by itself, then all observations jointly.

Levenberg and Marquardt's method damps a step alike in all unknowns, by what lowers the whole loss
most. Observations without a common parameter are problems that have nothing to do with each other,
and one damping suits none of them. Motions of single objects are such problems: an object depends
on its own pair with each material of the room, and on no other object. Fitted each by itself they
converge in fewer steps and to better optima, and collisions, which depend on three times as many
parameters, come in where what an object does alone is known already.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from intuitive_physics.observation import Observation
from intuitive_physics_learner.joint_estimation.joint_fit import JointEstimationSettings, JointFit
from intuitive_physics_learner.joint_estimation.several_starts import SeveralStarts
from intuitive_physics_learner.search.learning_task import FitTask

SEPARATE_STEPS = 20
"""Steps at most of the fits to objects that moved alone, each object by itself, before all
observations are fitted jointly; in the same time 20 and 40 gave the same excess on four sets of ten
objects."""

SMALLEST_SEPARATE_SHARE = 0.3
"""Share of the observations that are of objects alone from which on these are fitted first; half of
those of the paper's sets are, where that is better; set by hand; 1: jointly from the beginning
unless all moved alone."""


@dataclass(frozen=True, eq=False)
class SeparateFit:
    """A fit that has no parameter in common with the others of its stage.

    Parameters
    ----------
    members : (n_members,) indices of its observations
    parameters : (k,) indices of its parameters
    fit : to these observations, over these parameters
    """

    members: NDArray[np.int64]
    parameters: NDArray[np.int64]
    fit: JointFit


class StagedFit:
    """Fits objects that moved alone, each by itself, and then all observations jointly.

    Where nothing is fitted separately, the joint fit has several starts. Separate fits have one:
    with more, less time is left for collisions.

    `starts` (n_starts, n) points of the unit cube; None: only the prior's mean.

    Attributes
    ----------
    jointly : fits to all observations
    steps : taken so far, in both stages
    """

    def __init__(
        self,
        task: FitTask,
        starts: NDArray[np.float64] | None = None,
        settings: JointEstimationSettings | None = None,
    ) -> None:
        settings = settings or JointEstimationSettings()
        starts = task.prior.mean[None] if starts is None else starts
        groups = separable(task.cost.observations, task.influence)
        if sum(map(len, groups)) < SMALLEST_SEPARATE_SHARE * len(task.cost.observations):
            groups = []
        # A scan takes as long as four steps, and separate fits have scanned their parameters.
        ahead = replace(settings, scan_steps=()) if groups else settings
        self.jointly = SeveralStarts(task, ahead, starts[:1] if groups else starts)
        self.steps = 0
        self._separate = []
        for members in groups:
            parameters = np.flatnonzero(task.influence[members].any(axis=0))
            fit = JointFit(task.part(members, parameters), settings)
            self._separate.append(SeparateFit(members, parameters, fit))

    @property
    def joint(self) -> JointFit:
        """The best fit to all observations.

        Before it takes steps of its own it holds what the separate ones have found.
        """
        return self.jointly.best

    @property
    def simulations(self) -> float:
        """Simulations of single observations so far."""
        return self.jointly.simulations + self._separate_simulations

    @property
    def best_simulations(self) -> float:
        """Simulations of single observations from the best start alone."""
        return self.joint.model.simulations + self._separate_simulations

    @property
    def settled(self) -> bool:
        """Whether both stages have converged: more steps would change nothing."""
        return not self._unfinished() and self.jointly.settled

    def step(self) -> None:
        """Take a step of each separate fit, or once these have ended, of the joint one."""
        self.steps += 1
        unfinished = self._unfinished()
        for part in unfinished:
            part.fit.step()
        if unfinished:
            self._take_over()
        else:
            self.jointly.step()

    def choose(self) -> NDArray[np.float64]:
        """Let the joint fit be the one of the largest evidence.

        Returns (n,) widths², by how much fits from other starts differ from it where the
        observations cannot tell which is right.
        """
        return self.jointly.choose()

    def state(self) -> dict[str, Any]:
        """Return plain data from which a fit to the same observations continues exactly."""
        return {
            "steps": self.steps,
            "joint": self.jointly.state(),
            "separate": [part.fit.state() for part in self._separate],
        }

    def load_state(self, state: Mapping[str, Any]) -> None:
        """Continue from what `state` returned."""
        self.steps = state["steps"]
        self.jointly.load_state(state["joint"])
        for part, part_state in zip(self._separate, state["separate"], strict=True):
            part.fit.load_state(part_state)

    @property
    def _separate_simulations(self) -> float:
        return sum(part.fit.model.simulations for part in self._separate)

    def _unfinished(self) -> list[SeparateFit]:
        most = SEPARATE_STEPS
        return [part for part in self._separate if not part.fit.settled and part.fit.steps < most]

    def _take_over(self) -> None:
        """Let the joint fit begin at what the separate ones have found."""
        joint, fits = self.joint, self.joint.observation_fits()
        unit, deviations = joint.unit.copy(), joint.deviations.copy()
        for part in self._separate:
            unit[part.parameters] = part.fit.unit
            deviations[part.parameters] = part.fit.deviations
            joint.responsive[part.parameters] |= part.fit.responsive
            for member, fit in zip(part.members, part.fit.observation_fits(), strict=True):
                fits[member] = fit
        joint.begin_at(unit, deviations, fits)
        counts = [part.members.size for part in self._separate]
        joint.misfits = float(np.average([p.fit.misfits for p in self._separate], weights=counts))


def separable(
    observations: Sequence[Observation], influence: NDArray[np.bool_]
) -> list[NDArray[np.int64]]:
    """Find groups of observations of single objects that have no parameter in common.

    `influence` (n_observations, n) bool, which observation can depend on which parameter. Returns
    arrays (n_members,) of indices of observations; none where all observations would be in one
    group, which a joint fit is of anyway.
    """
    alone = np.array([len(observation.objects) == 1 for observation in observations])
    lone = np.flatnonzero(alone & influence.any(axis=1))
    if not lone.size:
        return []
    shared = csr_array(influence[lone].astype(np.int64))
    count, labels = connected_components(shared @ shared.T, directed=False)
    if count == 1 and lone.size == len(observations):
        return []
    return [lone[labels == k] for k in range(count)]
