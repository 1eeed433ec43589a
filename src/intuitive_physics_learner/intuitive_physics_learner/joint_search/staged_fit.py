"""The order of fits: objects alone first, in segments where they tumble, then all jointly.

Levenberg and Marquardt's method damps a step alike in all unknowns, by what lowers the whole loss
most. Observations without a common parameter are problems that have nothing to do with each other,
and one damping suits none of them. Motions of single objects are such problems: an object depends
on its own pair with each material of the room, and on no other object. Fitted each by itself they
converge in fewer steps and to better optima, and collisions, which depend on three times as many
parameters, come in where what an object does alone is known already.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from operator import methodcaller
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from intuitive_physics.observation import Observation
from intuitive_physics.shapes import Sphere
from intuitive_physics.simulation.shares import mapped_in_shares
from intuitive_physics_learner.joint_estimation.fit_horizons import FIRST_DURATION
from intuitive_physics_learner.joint_estimation.joint_fit import (
    JointEstimationSettings,
    JointFit,
    ObservationFit,
)
from intuitive_physics_learner.joint_estimation.several_starts import SeveralStarts, durations
from intuitive_physics_learner.search.gaussian import Gaussian
from intuitive_physics_learner.search.learning_task import NEGLIGIBLE_WEIGHT, FitTask
from intuitive_physics_learner.search.plain_state import Resumable
from intuitive_physics_learner.segmented_estimation.segmented_fit import SegmentedFit

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

TOGETHER_STEPS = 20
"""Steps at most of the fit to observations of several objects, before all are fitted jointly; set
by hand."""

FEWEST_IN_SEGMENTS = 4
"""Throws of an object from which on they are fitted in segments."""


@dataclass(frozen=True, eq=False)
class _FitOf:
    """A fit of some observations (n_members,) over some parameters (k,), both by index."""

    members: NDArray[np.int64]
    parameters: NDArray[np.int64]
    fit: JointFit


@dataclass(frozen=True, eq=False)
class _SegmentsOf:
    """A fit in segments, likewise."""

    members: NDArray[np.int64]
    parameters: NDArray[np.int64]
    fit: SegmentedFit


class StagedFit(Resumable):
    """Fits objects that moved alone, each by itself, and then all observations jointly.

    Where nothing is fitted separately, the joint fit has several starts. Separate fits have one:
    with more, less time is left for collisions. Objects that tumble, of which a fit of single
    states explains little, are then fitted in segments (`segmented_fit`). Their result becomes part
    of the prior of the joint fit, in which these throws no longer count.

    `starts` (n_starts, n) points of the unit cube; None: only the prior's mean; `in_segments` makes
    a fit in segments of one to an object alone, or None where there shall be none; None: nothing is
    fitted in segments.

    Attributes
    ----------
    task : what is fitted jointly, with what is known of θ_s beforehand
    jointly : fits to all observations
    steps : taken so far, in all stages
    segment_steps : how many of them in segments
    """

    remembered = (
        "steps",
        "segment_steps",
        "_segments_ended",
        "_together_ended",
        "_simulations_before",
        "_known",
    )

    def __init__(
        self,
        task: FitTask,
        starts: NDArray[np.float64] | None = None,
        in_segments: Callable[[JointFit], SegmentedFit | None] | None = None,
    ) -> None:
        settings = JointEstimationSettings()
        self.task, self._in_segments = task, in_segments
        starts = task.prior.mean[None] if starts is None else starts
        groups = separable(task.cost.observations, task.influence)
        if sum(map(len, groups)) < SMALLEST_SEPARATE_SHARE * len(task.cost.observations):
            groups = []
        # A scan takes as long as four steps, and separate fits have scanned their parameters.
        self._ahead = replace(settings, scan_steps=()) if groups else settings
        self.jointly = SeveralStarts(task, self._ahead, starts[:1] if groups else starts)
        self.steps = self.segment_steps = 0
        self._separate = []
        for members in groups:
            parameters = np.flatnonzero(task.influence[members].any(axis=0))
            fit = JointFit(task.part(members, parameters), settings)
            self._separate.append(_FitOf(members, parameters, fit))
        self._lone_group = not groups and _all_alone(task.cost.observations)
        self._segments: list[_SegmentsOf] = []
        self._segments_ended = in_segments is None or not (groups or self._lone_group)
        self._together: _FitOf | None = None
        self._together_ended = not 0 < sum(map(len, groups)) < len(task.cost.observations)
        self._simulations_before = 0.0
        self._known: list[dict[str, Any]] = []

    @property
    def joint(self) -> JointFit:
        """The best fit to all; before its own steps it holds what the separate ones have found."""
        return self.jointly.best

    @property
    def simulations(self) -> float:
        """Simulations of single observations so far."""
        in_segments = sum(part.fit.simulations for part in self._segments)
        earlier = self._simulations_before + in_segments
        return earlier + self.jointly.simulations + self._simulations_of_parts(self._parts)

    @property
    def repeated_simulations(self) -> float:
        """Simulations of single observations from one start, of those that a fit to half repeats.

        Those fitted in segments count no more for it.
        """
        counted = self.task.counted
        for part in self._segments:
            counted[part.members] = False
        repeated = [part for part in self._parts if counted[part.members].any()]
        joint = self.joint.model.simulations * float(counted.mean())
        return self._simulations_of_parts(repeated) + joint

    @property
    def settled(self) -> bool:
        """Whether all stages have converged: more steps would change nothing."""
        ended = not self._unfinished() and self._segments_ended and self._together_ended
        return ended and self.jointly.settled

    def step(self) -> None:
        """Take a step of each fit of the present stage."""
        self.steps += 1
        unfinished = self._unfinished()
        if unfinished:
            self._step_all([part.fit for part in unfinished])
            self._take_over(self._separate)
        elif self._fitting_segments():
            self.segment_steps += 1
            self._step_all([part.fit for part in self._segments if not part.fit.finished])
            if all(part.fit.finished for part in self._segments):
                self._end_segments()
        elif (together := self._fit_together()) is not None:
            together.fit.step()
            self._take_over([together])
            self._together_ended = together.fit.settled or together.fit.steps >= TOGETHER_STEPS
        else:
            self.jointly.step()

    def conclude(self) -> None:
        """Use the fits in segments as far as they are, or choose among several starts."""
        if self._segments:
            self._end_segments()
        elif not self._known:
            self.jointly.choose()

    def state(self) -> dict[str, Any]:
        return {
            **super().state(),
            "joint": self.jointly.state(),
            "separate": [part.fit.state() for part in self._separate],
            "together": self._together and self._together.fit.state(),
        }

    def load_state(self, state: Mapping[str, Any]) -> None:
        """Continue from a state; fits in segments repeat the steps that they had taken."""
        super().load_state(state)
        self._load_separate(state["separate"])
        if self._known:
            self._begin_with_knowledge()
        self.jointly.load_state(state["joint"])
        if state["together"] is not None:
            self._together = self._begun_together()
            self._together.fit.load_state(state["together"])
            # What the separate fits say has been simulated once more.
            self._load_separate(state["separate"])
        if self.segment_steps and not self._segments_ended:
            for _ in range(self.segment_steps):
                self._fitting_segments()
                self._step_all([part.fit for part in self._segments if not part.fit.finished])

    def _load_separate(self, states: Sequence[Mapping[str, Any]]) -> None:
        for part, part_state in zip(self._separate, states, strict=True):
            part.fit.load_state(part_state)

    def _unfinished(self) -> list[_FitOf]:
        return [part for part in self._separate if not self._has_ended(part.fit)]

    def _has_ended(self, fit: JointFit) -> bool:
        """Whether a fit to objects alone has found what it can."""
        if fit.settled or fit.steps >= SEPARATE_STEPS:
            return True
        return self._in_segments is not None and fit.steps >= TUMBLING_STEPS and tumbles(fit)

    def _step_all(self, fits: Sequence[JointFit] | Sequence[SegmentedFit]) -> None:
        mapped_in_shares(methodcaller("step"), fits, self.joint.model.cost.threads)

    @property
    def _parts(self) -> list[_FitOf]:
        """The fits of parts of the observations from single states."""
        return [*self._separate, *filter(None, [self._together])]

    @staticmethod
    def _simulations_of_parts(parts: Sequence[_FitOf]) -> float:
        return sum(part.fit.model.simulations for part in parts)

    def _take_over(self, parts: Sequence[_FitOf]) -> None:
        """Let the joint fit begin at what fits of parts have found."""
        joint, fits = self.joint, self.joint.observation_fits()
        unit, deviations = joint.unit.copy(), joint.deviations.copy()
        for part in parts:
            unit[part.parameters] = part.fit.unit
            deviations[part.parameters] = part.fit.deviations
            joint.responsive[part.parameters] |= part.fit.responsive
            for member, fit in zip(part.members, part.fit.observation_fits(), strict=True):
                fits[member] = fit
        joint.begin_at(unit, deviations, fits)
        counts = [part.members.size for part in self._parts]
        joint.misfits = float(np.average([p.fit.misfits for p in self._parts], weights=counts))

    def _fit_together(self) -> _FitOf | None:
        """Return the fit to observations of several objects as long as it is time for it."""
        if self._together is None and not self._together_ended:
            self._together = self._begun_together()
        return None if self._together_ended else self._together

    def _begun_together(self) -> _FitOf:
        """Return the fit to what is not fitted separately, with what the separate fits say."""
        others = np.ones(len(self.task.influence), dtype=bool)
        prior, size = self.task.prior, self.joint.unit.size
        for part in self._separate:
            others[part.members] = False
            if self.task.counted[part.members].any():
                said = Gaussian.nothing(part.fit.unit.size).plus(
                    part.fit.likelihoods(), part.fit.weights
                )
                prior = prior.joined(said.among(part.parameters, size))
        members = np.flatnonzero(others)
        parameters = np.flatnonzero(self.task.influence[members].any(axis=0))
        task = replace(self.task, prior=prior).part(members, parameters)
        fit = JointFit(task, JointEstimationSettings())
        before = self.joint.observation_fits()
        fit.begin_at(
            self.joint.unit[parameters],
            np.minimum(self.joint.deviations[parameters], task.prior.deviations),
            [before[member] for member in members],
        )
        return _FitOf(members, parameters, fit)

    def _fitting_segments(self) -> bool:
        """Whether it is time for fits in segments, which then begin."""
        if self._segments_ended or self._segments:
            return not self._segments_ended
        fits = self._separate
        if self._lone_group:
            if not self._has_ended(self.joint):
                return False
            self.jointly.choose()
            members, parameters = (np.arange(size) for size in self.task.influence.shape)
            fits = [_FitOf(members, parameters, self.joint)]
        for part in fits:
            begun = self._begun_in_segments(part.fit)
            if begun is not None:
                self._segments.append(_SegmentsOf(part.members, part.parameters, begun))
        self._segments_ended = not self._segments
        if self._segments:
            self.jointly.keep(1)
        return bool(self._segments)

    def _begun_in_segments(self, fit: JointFit) -> SegmentedFit | None:
        return None if self._in_segments is None or not tumbles(fit) else self._in_segments(fit)

    def _end_segments(self) -> None:
        """Take over what fits in segments say; one that has not got far enough is left out."""
        for part in self._segments:
            self._simulations_before += part.fit.simulations
            if part.fit.usable:
                said = part.fit.knowledge()
                self._known.append(
                    {
                        "members": part.members.tolist(),
                        "parameters": part.parameters.tolist(),
                        "precision": said.precision.tolist(),
                        "pull": said.pull.tolist(),
                    }
                )
        self._segments, self._segments_ended = [], True
        if self._known:
            self._begin_with_knowledge()

    def _begin_with_knowledge(self) -> None:
        """Restart the joint fit, with the results of the fits in segments in its prior."""
        before = self.joint
        unit, fits = before.unit.copy(), list(before.observation_fits())
        states: list[ObservationFit | None] = [*fits]
        prior, weights, size = self.task.prior, self.task.weights.copy(), unit.size
        for known in self._known:
            members, parameters = np.array(known["members"]), np.array(known["parameters"])
            said = Gaussian(np.array(known["precision"]), np.array(known["pull"]))
            prior = prior.joined(said.among(parameters, size))
            weights[members] *= NEGLIGIBLE_WEIGHT
            unit[parameters] = np.clip(prior.mean[parameters], 0.0, 1.0)
            for member in known["members"]:
                states[member] = None
        self._simulations_before += self.jointly.simulations
        self.task = replace(self.task, prior=prior, given_weights=weights)
        starts = np.where(unit == before.unit, self.jointly.starts[:1], unit)
        self.jointly = SeveralStarts(self.task, self._ahead, starts)
        self.joint.begin_at(unit, np.minimum(before.deviations, prior.deviations), states)
        self.joint.responsive |= before.responsive
        self.joint.misfits = before.misfits


def tumbles(fit: JointFit) -> bool:
    """Whether a fit got so little far in throws of single objects that motion must be chaotic."""
    observations = fit.model.cost.observations
    if len(observations) < FEWEST_IN_SEGMENTS or not _all_alone(observations):
        return False
    if any(isinstance(each.objects[0].object.shape, Sphere) for each in observations):
        return False
    horizons = np.array([each.horizon for each in fit.observation_fits()])
    possible = FIRST_DURATION + SEPARATE_STEPS * fit.model.largest_advance
    share = (horizons / np.minimum(durations(fit), possible)).mean()
    return float(share) < LARGEST_TUMBLING_SHARE


def _all_alone(observations: Sequence[Observation]) -> bool:
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
