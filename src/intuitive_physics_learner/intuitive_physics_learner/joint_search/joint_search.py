"""The search that estimates θ_s and initial states jointly, by Levenberg and Marquardt's method."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from intuitive_physics.materials import StaticParameters
from intuitive_physics.prior_knowledge.initial_spins import InitialSpins
from intuitive_physics_learner.cost.wrapped_costs import CachedCost
from intuitive_physics_learner.joint_estimation.joint_fit import JointFit
from intuitive_physics_learner.joint_estimation.profiles import (
    curvature_simulations,
    move_simulations,
)
from intuitive_physics_learner.joint_estimation.several_starts import LEFT, STARTS, drawn_starts
from intuitive_physics_learner.joint_search.identifiability import (
    Identifiability,
    identifiability_by_fit,
)
from intuitive_physics_learner.joint_search.staged_fit import StagedFit
from intuitive_physics_learner.search.convergence import ConvergenceCriteria
from intuitive_physics_learner.search.learning_task import LearningTask
from intuitive_physics_learner.search.parameter_search import ParameterSearch, Search
from intuitive_physics_learner.search.update_rules.cma_es import CmaEs
from intuitive_physics_learner.segmented_estimation.segmented_fit import (
    SegmentedFit,
    segment_simulations,
)

EVALUATED_SHARE = 0.05
"""Simulations for J, as a share of those of a fit, above which J is not evaluated after a step: it
only shows the progress of the fit; set by hand."""

LARGEST_MISFIT_SHARE = 0.3
"""Mean share of observations with a misfit above which the simulation must lack an effect: just
below the third that a fit horizon counts which advances twice and retreats once for ever."""

MISFIT_STEPS = 3
"""Steps that this mean is over; set by hand."""

FEWEST_FOR_STARTS = 1000
"""Evaluations of J below which a fit has one start: on 85 recorded throws of a ball four of them
take 300 until the worse are dropped, and find in 1000 what one does in 300; set by hand."""

HALF_SHARE = 0.75
"""Time of the fit to half of the observations in that of the fit to all from one start: few at a
time take longer each."""

SEGMENT_SHARE = 0.5
"""Share of the time left that the fit of one object in segments may take to its end, where others
are to be fitted with it; set by hand."""

LONE_SEGMENT_SHARE = 2.0
"""The same of the fit of an object that is by itself: it is of use from about half of its steps on.
"""

SEGMENT_STAGE_SHARE = 0.25
"""Share of the time left that all fits in segments may take where others follow, which collisions
need; what they have by then is used. With all of it the mean excess of three sets of ten objects
was the same, and fewer parameters were identified."""

LONE_SEGMENT_STAGE_SHARE = 0.7
"""The same where an object is by itself: states are then fitted to what was learned; set by hand.
"""

SEARCH_SHARE = 0.5
"""Share of a time limit in which fits from several starts should end. The rest is left for choosing
among them and for computing the uncertainty of θ_s; set by hand."""

FOLLOWED_SHARE = 0.1
"""Part of a limit of time that is left for following undisturbed motions, by which disturbed
observations are found; with 0.2 as many were found in twelve sets of one object, and θ_s of five
sets of ten, for which less time was left, had errors a tenth larger."""

SEGMENTED_FOLLOWED_SHARE = 0.2
"""The same where all observations are fitted in segments: what tumbles has many motions to follow,
and nothing else is left to learn. With 0.1 half of the motions were followed to their ends."""


class JointSearch(Search):
    """Fits all trajectories, and lowers J where they cannot be fitted.

    A step is one of `StagedFit`; it takes as many simulations as some dozen evaluations of J and is
    not divided, so it may exceed the limit it is given. It is counted as the evaluations of J that
    take as many simulations.

    Where the share of trajectories that cannot be fitted is so large that the simulation must lack
    an effect, there are no true θ_s and initial states to be found: from then on J itself is
    lowered by CMA-ES, from the observed initial states and the θ_s of the lowest J so far.

    Parameters
    ----------
    task : what to learn
    generator : of the starts of fits
    """

    remembered = (
        *Search.remembered,
        "_evaluations",
        "_evaluated",
        "_misfits",
        "_lowest",
        "_lowest_cost",
    )

    def __init__(self, task: LearningTask, generator: np.random.Generator) -> None:
        super().__init__()
        fit_task = task.fit_task
        self._cost = task.cost
        self._space = fit_task.space
        drawn = drawn_starts(fit_task.prior, STARTS - 1, generator)
        starts = np.array([fit_task.prior.mean, *drawn])
        self._begin = fit_task.prior.mean
        self._staged = StagedFit(fit_task, starts, self._in_segments)
        self._simulator, self._generator = task.simulator, generator
        self._time_limit, self._began = np.inf, time.monotonic()
        self._segments_end = np.inf
        self._evaluations = 0
        # An evaluation of J simulates as much as all of them.
        self._motions = len(fit_task.influence)
        self._seed = int(generator.integers(2**62))
        self._lowering: ParameterSearch | None = None
        self._misfits: list[float] = []
        self._evaluated = self._lowest = self.fit.unit
        self._lowest_cost = np.inf

    @property
    def fit(self) -> JointFit:
        """The fit to all trajectories."""
        return self._staged.joint

    @property
    def lowers_cost(self) -> bool:
        """Whether the simulation lacks an effect, so that J itself is lowered."""
        return self._lowering is not None

    @property
    def fits_trajectories(self) -> bool:
        """Whether the result is that of `fit`, whose posterior then gives the uncertainties."""
        return not self.lowers_cost and self._staged.steps > 0

    @property
    def followed_share(self) -> float:
        """Part of a limit of time to leave for following undisturbed motions from where fits stop.

        By these, disturbed observations are found.
        """
        return FOLLOWED_SHARE if self._staged.task.counted.any() else SEGMENTED_FOLLOWED_SHARE

    @property
    def best_parameters(self) -> StaticParameters:
        if self._lowering is not None:
            return self._lowering.best_parameters
        return self._space.to_parameters(self.fit.unit)

    def plan(self, criteria: ConvergenceCriteria) -> None:
        most = criteria.max_iterations
        if most is not None and most < FEWEST_FOR_STARTS:
            self._staged.jointly.keep(1)
        self._began = time.monotonic()
        if criteria.time_limit is not None:
            self._time_limit = criteria.time_limit

    def step(self, limit: int) -> int:
        before = self.iterations
        if self._advance(limit) and self.iterations == before:
            # What simulates less than J does is an evaluation all the same.
            self._record(self.best_cost)
        return self.iterations - before

    def _advance(self, limit: int) -> bool:
        """Take a step; return whether there was one to take."""
        if self._lowering is not None:
            return self._lower(self._lowering, limit)
        if self._staged.settled:
            return False
        if time.monotonic() > self._segments_end:
            self._staged.end_segments()
        self._step_fits()
        self._follow()
        self._misfits = [*self._misfits, self.fit.misfits][-MISFIT_STEPS:]
        enough = len(self._misfits) == MISFIT_STEPS or self._staged.settled
        if enough and np.mean(self._misfits) > LARGEST_MISFIT_SHARE:
            self._evaluate_present()
            (cost,) = self._cost.costs([self._space.to_parameters(self._begin)])
            if cost < self._lowest_cost:
                self._lowest, self._lowest_cost = self._begin, float(cost)
            self._lowering = self._handed_over()
            self._lower(self._lowering, limit)
        return True

    def _lower(self, lowering: ParameterSearch, limit: int) -> bool:
        """Evaluate J up to `limit` times; return whether anything was left to evaluate."""
        evaluated = lowering.step(limit)
        self._count(lowering.best_cost)
        return evaluated > 0

    def _handed_over(self) -> ParameterSearch:
        """Return the search that lowers J, from the point of the lowest J so far."""
        generator = np.random.default_rng(self._seed)
        rule = CmaEs(self._space.size, generator, self._lowest)
        return ParameterSearch(CachedCost(self._cost).costs, self._space, rule)

    def _step_fits(self) -> None:
        """Take a step; after the first one, drop starts where there is no time for several."""
        jointly, began = self._staged.jointly, time.monotonic()
        self._staged.step()
        if jointly.steps == 1 and len(jointly.fits) > 1:
            each = jointly.seconds_of_one(time.monotonic() - began)
            if LEFT * each > SEARCH_SHARE * self._time_limit:
                jointly.keep(1)

    def conclude(self) -> None:
        """Choose among the fits from several starts, or take over those in segments."""
        if not self.fits_trajectories:
            return
        self._staged.conclude()
        self._evaluate_present()

    def keep_start(self, task: LearningTask) -> bool:
        if self._lowering is not None:
            return self._lowering.keep_start(task)
        return self.fit.return_if_better(task.begin)

    def identifiability(
        self, task: LearningTask, seconds_left: Callable[[], float]
    ) -> Identifiability:
        """Return which parameters the observations determine, and how well, by the fit."""
        return identifiability_by_fit(self._staged, task, seconds_left)

    def identifiability_seconds(self, task: LearningTask, seconds: float) -> float:
        """How long `identifiability` will take, if the search has taken `seconds`."""
        judged = HALF_SHARE * self._staged.repeated_simulations + 1.5 * curvature_simulations(
            self.fit
        )
        judged += move_simulations(self.fit) + self._staged.jointly.choice_simulations
        if task.start_was_learned:
            judged += self.fit.held_simulations
        simulated = self._staged.simulations + self._evaluations * self._motions
        return seconds * judged / simulated

    def initial_spins(self) -> InitialSpins:
        """From the posterior of each initial spin; unknown where J was lowered instead."""
        return InitialSpins() if self.lowers_cost else self.fit.spin_evidence().initial_spins()

    def state(self) -> dict[str, Any]:
        lowering = self._lowering and self._lowering.state()
        return {**super().state(), "fit": self._staged.state(), "lowering": lowering}

    def load_state(self, state: Mapping[str, Any]) -> None:
        super().load_state(state)
        self._staged.load_state(state["fit"])
        if state["lowering"] is not None:
            self._lowering = self._handed_over()
            self._lowering.load_state(state["lowering"])

    def _in_segments(self, fit: JointFit) -> SegmentedFit | None:
        """Return a fit in segments of throws of one object, where there is time for it."""
        if self._simulator is None:
            return None
        spent = time.monotonic() - self._began
        seconds = segment_simulations(fit) * spent / max(self._staged.simulations, 1.0)
        lone, left = fit is self.fit, self._time_limit - spent
        if seconds > (LONE_SEGMENT_SHARE if lone else SEGMENT_SHARE) * left:
            return None
        stage = (LONE_SEGMENT_STAGE_SHARE if lone else SEGMENT_STAGE_SHARE) * left
        self._segments_end = time.monotonic() + stage
        return SegmentedFit(fit, self._simulator, self._generator.spawn(1)[0])

    def _follow(self) -> None:
        """Evaluate J where that takes little beside the fit, and count its simulations."""
        if self._evaluations * self._motions > EVALUATED_SHARE * self._staged.simulations:
            self._count(self.best_cost)
        else:
            self._evaluate()

    def _evaluate_present(self) -> None:
        """Evaluate J of the estimate unless that was done."""
        if (self.fit.unit != self._evaluated).any():
            self._evaluate()

    def _evaluate(self) -> None:
        (cost,) = self._cost.costs([self.best_parameters]).tolist()
        self._evaluations += 1
        self._evaluated = self.fit.unit
        if cost < self._lowest_cost:
            self._lowest, self._lowest_cost = self.fit.unit, cost
        self._count(cost)

    def _count(self, cost: float) -> None:
        """Count simulations as evaluations of J, the last of which found `cost` m."""
        fits = self._staged.simulations / self._motions
        lowered = 0 if self._lowering is None else self._lowering.iterations
        while self.iterations - self._evaluations < fits + lowered:
            self._record(cost)
