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
from dataclasses import replace
from operator import methodcaller
from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.simulation.shares import mapped_in_shares
from intuitive_physics_learner.joint_estimation.joint_fit import (
    JointEstimationSettings,
    JointFit,
    ObservationFit,
)
from intuitive_physics_learner.joint_estimation.several_starts import SeveralStarts
from intuitive_physics_learner.joint_search.segment_stage import SegmentStage
from intuitive_physics_learner.joint_search.separate_fits import FitOf, SeparateFits, all_alone
from intuitive_physics_learner.search.learning_task import FitTask
from intuitive_physics_learner.search.plain_state import Resumable
from intuitive_physics_learner.segmented_estimation.segmented_fit import SegmentedFit

TOGETHER_STEPS = 20
"""Steps at most of the fit to observations of several objects, before all are fitted jointly; set
by hand."""

FIRST_TOGETHER_STEPS = 4
"""Steps of that fit before objects are fitted in segments. As long as horizons are short they take
little time, and where it ends in the segments, states of these observations are fitted, as their
profiles need; set by hand."""


class StagedFit(Resumable):
    """Fits objects that moved alone, each by itself, and then all observations jointly.

    Where nothing is fitted separately, the joint fit has several starts. Separate fits have one:
    with more, less time is left for collisions. Objects that tumble, of which a fit of single
    states explains little, are then fitted in segments (`segment_stage`). Their result becomes part
    of the prior of the joint fit, in which these throws no longer count.

    `starts` (n_starts, n) points of the unit cube; None: only the prior's mean; `in_segments` as
    `SegmentStage`.

    Attributes
    ----------
    task : what is fitted jointly, with what is known of θ_s beforehand
    jointly : fits to all observations
    steps : taken so far, in all stages
    """

    remembered = ("steps", "_together_ended", "_simulations_before")

    def __init__(
        self,
        task: FitTask,
        starts: NDArray[np.float64] | None = None,
        in_segments: Callable[[JointFit], SegmentedFit | None] | None = None,
    ) -> None:
        self.task, self.steps = task, 0
        starts = task.prior.mean[None] if starts is None else starts
        self._separate = SeparateFits(task, end_early=in_segments is not None)
        has_parts = bool(self._separate.parts)
        settings = JointEstimationSettings()
        # A scan takes as long as four steps, and separate fits have scanned their parameters.
        self._ahead = replace(settings, scan_steps=()) if has_parts else settings
        self.jointly = SeveralStarts(task, self._ahead, starts[:1] if has_parts else starts)
        self._lone_group = not has_parts and all_alone(task.cost.observations)
        self._segments = SegmentStage(in_segments if has_parts or self._lone_group else None)
        self._together: FitOf | None = None
        self._together_ended = not (has_parts and self._separate.others.any())
        self._simulations_before = 0.0

    @property
    def joint(self) -> JointFit:
        """The best fit to all; before its own steps it holds what the separate ones have found."""
        return self.jointly.best

    @property
    def segment_steps(self) -> int:
        """How many of the steps were taken in segments."""
        return self._segments.steps

    @property
    def simulations(self) -> float:
        """Simulations of single observations so far."""
        earlier = self._simulations_before + self._segments.simulations
        return earlier + self.jointly.simulations + self._simulations_of_parts(self._parts)

    @property
    def doubted(self) -> NDArray[np.bool_]:
        """Parameters (n,) on which a motion depends that is not explained to its end.

        Those fitted in segments do not count. What explains all of a motion is no wrong optimum,
        and motion that can be followed so far is not chaotic.
        """
        return np.asarray(self.task.influence[self.jointly.ends_early].any(axis=0))

    @property
    def repeated_simulations(self) -> float:
        """Simulations of single observations from one start, of those that a fit to half repeats.

        Those fitted in segments count no more for it, and none do where nothing is doubted.
        """
        if not self.doubted.any():
            return 0.0
        counted = self.task.counted
        counted[self._segments.members] = False
        repeated = [part for part in self._parts if counted[part.members].any()]
        joint = self.joint.model.simulations * float(counted.mean())
        return self._simulations_of_parts(repeated) + joint

    @property
    def settled(self) -> bool:
        """Whether all stages have converged: more steps would change nothing."""
        ended = not self._separate.unfinished and self._segments.ended and self._together_ended
        return ended and self.jointly.settled

    def step(self) -> None:
        """Take a step of each fit of the present stage."""
        self.steps += 1
        unfinished = self._separate.unfinished
        if unfinished:
            fits = [part.fit for part in unfinished]
            mapped_in_shares(methodcaller("step"), fits, self._threads)
            self._take_over(self._separate.parts)
        elif self._begins_together:
            self._step_together()
        elif self._fitting_segments():
            if self._segments.step(self._threads):
                self.end_segments()
        elif not self._together_ended:
            self._step_together()
        else:
            self.jointly.step()

    def end_segments(self) -> None:
        """Use the fits in segments as far as they are, if they have begun."""
        if self._segments.has_begun:
            begun = self._segments.end()
            if self._segments.has_said:
                self._begin_with_knowledge(begun)

    def conclude(self) -> None:
        """Use the fits in segments as far as they are, or choose among several starts."""
        if self._segments.has_begun:
            self.end_segments()
        elif not self._segments.has_said:
            self.jointly.choose()

    def state(self) -> dict[str, Any]:
        return {
            **super().state(),
            "joint": self.jointly.state(),
            "separate": self._separate.state(),
            "segments": self._segments.state(),
            "together": self._together and self._together.fit.state(),
        }

    def load_state(self, state: Mapping[str, Any]) -> None:
        """Continue from a state; fits in segments repeat the steps that they had taken."""
        super().load_state(state)
        self._separate.load_state(state["separate"])
        self._segments.load_state(state["segments"])
        if self._segments.has_said:
            self._begin_with_knowledge({})
        self.jointly.load_state(state["joint"])
        if state["together"] is not None:
            self._together = self._begun_together()
            self._together.fit.load_state(state["together"])
            # What the separate fits say has been simulated once more.
            self._separate.load_state(state["separate"])
        if not self._segments.ended:
            taken, self._segments.steps = self._segments.steps, 0
            for _ in range(taken):
                self._fitting_segments()
                self._segments.step(self._threads)

    @property
    def _threads(self) -> int:
        return self.joint.model.cost.threads

    @property
    def _parts(self) -> list[FitOf]:
        """The fits of parts of the observations from single states."""
        return [*self._separate.parts, *filter(None, [self._together])]

    @staticmethod
    def _simulations_of_parts(parts: Sequence[FitOf]) -> float:
        return sum(part.fit.model.simulations for part in parts)

    def _take_over(self, parts: Sequence[FitOf]) -> None:
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

    @property
    def _begins_together(self) -> bool:
        """Whether the fit to observations of several objects takes its first steps."""
        taken = 0 if self._together is None else self._together.fit.steps
        begins = not self._together_ended and taken < FIRST_TOGETHER_STEPS
        return begins and not self._segments.has_begun

    def _step_together(self) -> None:
        if self._together is None:
            self._together = self._begun_together()
        fit = self._together.fit
        fit.step()
        self._take_over([self._together])
        self._together_ended = fit.settled or fit.steps >= TOGETHER_STEPS

    def _begun_together(self) -> FitOf:
        """Return the fit to what is not fitted separately, with what the separate fits say."""
        members = np.flatnonzero(self._separate.others)
        part = FitOf.of(replace(self.task, prior=self._separate.knowledge(self.task)), members)
        before, parameters = self.joint.observation_fits(), part.parameters
        part.fit.begin_at(
            self.joint.unit[parameters],
            np.minimum(self.joint.deviations[parameters], part.fit.prior.deviations),
            [before[member] for member in members],
        )
        return part

    def _fitting_segments(self) -> bool:
        """Whether it is time for fits in segments, which then begin."""
        if not self._segments.ended and not self._segments.has_begun:
            fits = self._separate.parts
            if self._lone_group:
                if not self._separate.has_ended(self.joint):
                    return False
                self.jointly.choose()
                members, parameters = (np.arange(size) for size in self.task.influence.shape)
                fits = [FitOf(members, parameters, self.joint)]
            self._segments.begin(fits)
            if self._segments.has_begun:
                self.jointly.keep(1)
        return not self._segments.ended

    def _begin_with_knowledge(self, begun: Mapping[int, ObservationFit | None]) -> None:
        """Restart the joint fit, with the results of the fits in segments in its prior.

        `begun` : how their throws began, by the index of the observation.
        """
        before = self.joint
        self._simulations_before += self.jointly.simulations
        if self._together is not None:
            self._simulations_before += self._together.fit.model.simulations
            self._together = None
        self.task = self._segments.informed(self.task)
        prior, known = self.task.prior, self._segments.known_parameters
        unit = before.unit.copy()
        unit[known] = np.clip(prior.mean[known], 0.0, 1.0)
        states: list[ObservationFit | None] = [*before.observation_fits()]
        for member in self._segments.known_members:
            states[member] = begun.get(member)
        starts = np.where(unit == before.unit, self.jointly.starts[:1], unit)
        self.jointly = SeveralStarts(self.task, self._ahead, starts)
        self.joint.begin_at(unit, np.minimum(before.deviations, prior.deviations), states)
        self.joint.responsive |= before.responsive
        self.joint.misfits = before.misfits
