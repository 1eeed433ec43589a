"""Joint fits: of the window after new observations, and at times of all that are kept."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.observation import Observation
from intuitive_physics.simulation import Simulator
from intuitive_physics_learner.cost.cost_function import TrajectoryCost
from intuitive_physics_learner.cost.point_noise import detected
from intuitive_physics_learner.joint_estimation.joint_fit import JointEstimationSettings, JointFit
from intuitive_physics_learner.joint_estimation.profiles import curvature_posterior, one_sided_moves
from intuitive_physics_learner.joint_estimation.several_starts import (
    DROP_STEPS,
    STARTS,
    drawn_starts,
)
from intuitive_physics_learner.joint_search.separate_fits import (
    all_alone,
    may_tumble,
    separable,
    tumbles,
)
from intuitive_physics_learner.joint_search.staged_fit import StagedFit
from intuitive_physics_learner.online.change_point import change_probability
from intuitive_physics_learner.online.lone_fit import LARGEST_ADVANCE
from intuitive_physics_learner.online.memory import RECENT, age_weight
from intuitive_physics_learner.online.online_state import Member, OnlineState, Refitted
from intuitive_physics_learner.online.options import OnlineOptions
from intuitive_physics_learner.online.publication import FEWEST_COMPARED, has_moved_far
from intuitive_physics_learner.search.gaussian import Gaussian, LocalLikelihood
from intuitive_physics_learner.search.learning_task import FitTask
from intuitive_physics_learner.segmented_estimation.segmented_fit import (
    SegmentedFit,
    segment_simulations,
)

WINDOW_STEPS = 8
"""Joint steps of all observations of the window after new ones; set by hand."""

REFIT_STEPS = 60
"""Joint steps of a fit to all observations that are kept from what was known before them; 16 boxes
take 21 to 55."""

CONTINUED_STEPS = 20
"""Joint steps of one that begins at an estimate; set by hand."""

WINDOW_SHARE = 0.5
"""Part of the time for new observations in which the window is fitted after them. The rest is saved
up for refits, which otherwise had none left where a window takes long; set by hand."""

COMPARED_BEYOND = (0.5, np.inf)
"""Times beyond the longest fit horizons up to which fits from different starts are compared, s: on
three chaotic sets these two together chose the better one more often than each alone."""


@dataclass(frozen=True, eq=False)
class JointProblem:
    """A fit of some of the observations that are kept.

    Parameters
    ----------
    state : whose observations they are
    members : the observations
    parameters : (k,) indices, among all n, of the parameters that any of them depends on
    prior : of all n parameters, without these observations
    task : the fit over those parameters
    """

    state: OnlineState
    members: list[Member]
    parameters: NDArray[np.int64]
    prior: Gaussian
    task: FitTask

    def fit_from(self, known: Gaussian, settings: JointEstimationSettings) -> JointFit:
        """Return a fit that begins at what is known, with the initial states found last."""
        fit = JointFit(self.task, settings)
        unit = np.clip(known.mean, 0.0, 1.0)[self.parameters]
        states = [member.fit for member in self.members]
        fit.begin_at(unit, known.deviations[self.parameters], states)
        return fit

    def part_of(self, fit: JointFit, whole: JointProblem) -> JointFit:
        """Return a fit that begins at another's present estimate.

        `fit` of the problem `whole`, which contains these observations and parameters.
        """
        places = np.searchsorted(whole.parameters, self.parameters)
        rows = [whole.members.index(member) for member in self.members]
        fits = fit.observation_fits()
        part = JointFit(self.task, JointEstimationSettings(scan_steps=()))
        part.begin_at(fit.unit[places], fit.deviations[places], [fits[row] for row in rows])
        part.weights = fit.weights[rows]
        return part

    def take_over(self, fit: JointFit) -> None:
        """Let what a fit has found of the members be what is known of them."""
        state, parameters, prior = self.state, self.parameters, self.prior
        # Parameters that the members do not depend on follow those that they correlate with.
        rest = np.setdiff1d(np.arange(state.unit.size), parameters)
        across = prior.precision[np.ix_(rest, parameters)] @ (fit.unit - prior.mean[parameters])
        gains = np.linalg.solve(prior.precision[np.ix_(rest, rest)], across)
        state.unit[parameters] = fit.unit
        state.unit[rest] = np.clip(prior.mean[rest] - gains, 0.0, 1.0)
        for member, observation_fit, likelihood, weight in zip(
            self.members,
            fit.observation_fits(),
            fit.likelihoods(),
            fit.weights.tolist(),
            strict=True,
        ):
            member.fit, member.weight = observation_fit, weight
            own = parameters[likelihood.parameters]
            member.likelihood = replace(likelihood, parameters=own)
            member.in_segments = False
        state.add_up()

    def take_over_segments(self, fit: SegmentedFit) -> None:
        """Let what a fit in segments says be what is known, each of the members saying a part."""
        state, parameters, count = self.state, self.parameters, len(self.members)
        said = fit.knowledge()
        unit = self.task.prior.joined(said).mean
        scores = said.precision @ unit - said.pull
        for member in self.members:
            member.likelihood = LocalLikelihood(
                parameters, unit, said.precision / count, scores / count, 0.0
            )
            member.weight, member.in_segments = 1.0, True
        state.unit[parameters] = np.clip(unit, 0.0, 1.0)
        state.flatness[parameters] = 1.0
        state.free[parameters] = 0.0
        state.add_up()


def lone_groups(problem: JointProblem) -> list[list[Member]]:
    """Return the observations of single objects, in groups without a common parameter."""
    observations, count = problem.task.cost.observations, len(problem.members)
    groups = separable(observations, problem.task.influence)
    if not groups and all_alone(observations):
        groups = [np.arange(count)]
    return [[problem.members[k] for k in group.tolist()] for group in groups]


@dataclass(frozen=True, eq=False)
class JointFits:
    """Fits what a state keeps; `seconds_left` of CPU time is called between steps."""

    state: OnlineState
    simulator: Simulator
    options: OnlineOptions
    seconds_left: Callable[[], float]

    def fit_window(self, observations: Mapping[str, Observation], new: int) -> None:
        """Fit the window jointly and take over; `new` have come since it was fitted last.

        Objects that are known by throws in segments wait for the next refit: fits of single states
        would say too little of them, and that too surely.
        """
        state, left = self.state, self.seconds_left()
        known, before, fitted = state.known_in_segments, state.before_window(), []
        for member in state.window:
            if member.in_segments:
                before = before.plus([member.likelihood], [member.weight])
            elif known[member.likelihood.parameters].all():
                member.weight = 0.0
            else:
                fitted.append(member)
        if not fitted:
            state.add_up()
            return
        problem = self._problem(fitted, observations, before)
        settings = JointEstimationSettings(largest_advance=LARGEST_ADVANCE, scan_steps=())
        fit = problem.fit_from(self._present, settings)
        saved = left - WINDOW_SHARE * self.options.seconds * new if np.isfinite(left) else 0.0
        self._run(fit, WINDOW_STEPS, saved)
        problem.take_over(fit)

    def refit(self, observations: Mapping[str, Observation]) -> None:
        """Fit all observations that are kept as a search does, and begin again from the best fit.

        Throws of objects that tumble are fitted in segments, each object by itself, and the others
        by what these say.
        """
        state = self.state
        learned = state.used - state.begun
        state.next_refit = 2 * learned
        if not state.kept:
            return
        problem = self._problem(state.kept, observations, state.ground)
        before = self.seconds_left()
        continued = self._continued(problem)
        simulated = sum(fit.model.simulations for fit in continued)
        seconds = (before - self.seconds_left()) / simulated if np.isfinite(before) else 0.0
        state.spread = np.zeros(state.unit.size)
        known, others = state.ground, problem.members
        for members in lone_groups(problem):
            alone = self._problem(members, observations, known)
            if self._fitted_in_segments(alone, alone.part_of(continued[0], problem), seconds):
                known = known.plus([member.likelihood for member in members], [1.0] * len(members))
                others = [member for member in others if member not in members]
        if len(others) < len(problem.members):
            state.next_refit = learned + max(RECENT, learned // 4)
            if not others:
                self._note_refit(state.unit.copy(), state.prior.deviations)
                return
            rest = self._problem(others, observations, known)
            problem, continued = rest, [rest.part_of(fit, problem) for fit in continued]
        self._refit_from_several_starts(problem, continued)

    def _continued(self, problem: JointProblem) -> list[JointFit]:
        """Return fits from the present estimate, and from what is published if that is far away."""
        begun = [self._present]
        if self.state.published is not None and has_moved_far(self.state):
            begun.append(self.state.published_information.bounded(self.state.centre))
        fits = [problem.fit_from(each, JointEstimationSettings(scan_steps=())) for each in begun]
        for fit in fits:
            self._run(fit, CONTINUED_STEPS)
        return fits

    def _refit_from_several_starts(
        self, problem: JointProblem, continued: Sequence[JointFit]
    ) -> None:
        """Fit observations from what was known before all and points drawn from that, too.

        The best of these fits and those from present estimates is taken over.
        """
        state, prior = self.state, problem.task.prior
        drawn = drawn_starts(prior, STARTS - 1, np.random.default_rng(state.used))
        staged = StagedFit(problem.task, np.array([prior.mean, *drawn]))
        self._run(staged, REFIT_STEPS)
        begun_anew = staged.joint
        if staged.jointly.steps < DROP_STEPS:
            # Where there was no time for new starts, they have not begun to explain anything.
            staged.jointly.keep(0)
        for fit in continued:
            staged.jointly.add(fit)
        staged.jointly.choose(COMPARED_BEYOND)
        state.spread[problem.parameters] = staged.jointly.spread
        problem.take_over(staged.joint)
        self._follow_profiles(problem, staged.joint)
        self._forget_what_disagrees()
        noted = begun_anew if begun_anew in staged.jointly.fits else staged.joint
        unit, deviations = state.unit.copy(), state.prior.deviations
        unit[problem.parameters] = noted.unit
        deviations[problem.parameters] = noted.deviations
        self._note_refit(unit, deviations)

    def _fitted_in_segments(self, problem: JointProblem, fit: JointFit, seconds: float) -> bool:
        """Fit throws of an object that tumbles in segments, from a fit to them.

        `seconds` that a simulation of one of them has taken. Returns whether that is taken over:
        where there is not enough time, it is not.
        """
        # From what segments have led to, a fit of single states may get far.
        began_there = any(member.in_segments for member in problem.members)
        if not (tumbles(fit) or (began_there and may_tumble(fit))):
            return False
        if self.seconds_left() < segment_simulations(fit) * seconds:
            return False
        segments = SegmentedFit(fit, self.simulator, np.random.default_rng(self.state.used))
        while not segments.finished and self.seconds_left() > 0.0:
            segments.step()
        if not segments.usable:
            return False
        problem.take_over(fit)
        problem.take_over_segments(segments)
        return True

    def _follow_profiles(self, problem: JointProblem, fit: JointFit) -> None:
        """Note where the loss is flatter than slopes say; it takes as long as a few steps."""
        state, parameters = self.state, problem.parameters
        deviations = curvature_posterior(fit).deviations
        state.free[parameters], ends = one_sided_moves(fit, deviations)
        state.flatness[parameters] = ends / deviations

    def _note_refit(self, unit: NDArray[np.float64], deviations: NDArray[np.float64]) -> None:
        """Remember what all observations led to, both (n,), beside what more of them lead to.

        It has explained them better than what is published.
        """
        state, count = self.state, len(self.state.kept)
        state.refitted = [*state.refitted[-1:], Refitted(state.used, unit, deviations)]
        if count >= FEWEST_COMPARED:
            state.begin_trial(count)

    @property
    def _present(self) -> Gaussian:
        """What is known, about the present estimate."""
        return Gaussian.about(self.state.unit, self.state.prior.precision)

    def _problem(
        self, members: list[Member], observations: Mapping[str, Observation], known: Gaussian
    ) -> JointProblem:
        """Return the fit of some members, to what is known without them."""
        state = self.state
        points = [detected(observations[member.id]) for member in members]
        cost = TrajectoryCost(points, self.simulator, state.materials)
        tau = self.options.time_constant
        ages = np.array([age_weight(state, member, tau) for member in members])
        prior = known.bounded(state.centre)
        parameters, task = state.fit_task(cost, prior, ages)
        return JointProblem(state, members, parameters, prior, task)

    def _forget_what_disagrees(self) -> None:
        """Keep of observations that are gone only what agrees with those that are kept.

        What they say was linearised where the estimate was then.
        """
        state = self.state
        if state.retired.equals(state.ground):
            return
        likelihoods = [member.likelihood for member in state.kept]
        weights = [member.weight for member in state.kept]
        for parameters in state.families.values():
            prior = state.retired.bounded(state.centre)
            probability = change_probability(prior, likelihoods, parameters, weights)
            if probability < self.options.false_alarm_rate:
                state.forget_pair(parameters, ground=False)
        state.add_up()

    def _run(self, fit: JointFit | StagedFit, steps: int, saved: float = 0.0) -> None:
        """Take steps, at least one, until the fit has settled or all time but `saved` s is over."""
        for _ in range(steps):
            if fit.settled or (fit.steps and self.seconds_left() <= saved):
                break
            fit.step()
