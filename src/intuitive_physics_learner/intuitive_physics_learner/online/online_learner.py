"""Recursive learning: each observation is predicted, then learned from, at a bounded cost."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import UnsupportedSceneError
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.materials import PAIR_COEFFICIENTS, material_pairs
from intuitive_physics.observation import Observation
from intuitive_physics.prior_knowledge.initial_spins import InitialSpins
from intuitive_physics.simulation import Simulator
from intuitive_physics_learner.assessment.reasons import Reason
from intuitive_physics_learner.cost.cost_function import TrajectoryCost
from intuitive_physics_learner.cost.parameter_influence import parameter_influence
from intuitive_physics_learner.joint_estimation.joint_fit import (
    LARGEST_VOTE,
    JointEstimationSettings,
    JointFit,
)
from intuitive_physics_learner.joint_estimation.point_noise import detected
from intuitive_physics_learner.joint_estimation.several_starts import STARTS, drawn_starts
from intuitive_physics_learner.joint_estimation.spin_evidence import SpinEvidence
from intuitive_physics_learner.joint_estimation.staged_fit import StagedFit
from intuitive_physics_learner.online.change_point import change_probability, find_change
from intuitive_physics_learner.online.fits import (
    BEYOND,
    JointProblem,
    LoneFit,
    most_evident,
    run,
    window_fit,
)
from intuitive_physics_learner.online.online_state import MEMBERS, Member, OnlineState
from intuitive_physics_learner.online.options import OnlineOptions
from intuitive_physics_learner.online.publication import (
    FEWEST_COMPARED,
    has_moved_far,
    has_won,
    is_new,
    is_on_trial,
    next_version,
)
from intuitive_physics_learner.search.gaussian import Gaussian
from intuitive_physics_learner.search.learning_task import FitTask
from intuitive_physics_learner.search.search_space import ActiveSpace
from intuitive_physics_learner.store.observation_entries import DOUBTFUL, USED, Assessment

FREE_SCANS = (2, 5)
"""Numbers of steps after which a lone fit that knows nothing of θ_s scans each parameter; set by
hand."""

WINDOW_STEPS = 8
"""Joint steps of all observations of the window after new ones; set by hand."""

REFIT_STEPS = 60
"""Joint steps of a fit to all observations that are kept from what was known before them; 16 boxes
take 21 to 55."""

CONTINUED_STEPS = 20
"""Joint steps of one that begins at an estimate; set by hand."""

MOST_KEPT = 100
"""Largest number of observations that are kept to be fitted again, if the window is not larger: the
newest, for what they say of the world of now."""

CONFLICT = 7.0
"""Logarithm of the ratio of evidences, of what is not bound by what is known to what is, from which
on an observation contradicts what is known: odds of a thousand to one."""

OUTWEIGHED = 0.01
"""Rate of false alarms where what is remembered counts less than what is set aside, so that it no
longer is what most observations agree on."""

SMALLEST_EXPLAINED = 0.6
"""Share of the last observations that can be explained from which on one that cannot be is
doubtful; where motion is too chaotic for that, most such observations are good ones; of clean
throws of tumbling bodies 0.6 to 0.7 can be, of balls 0.9."""

MEMORY = 20.0
"""Observations after which one counts 1/e of what it did in the share that can be explained; set by
hand."""

RECENT = 8
"""Number of last observations among which a change may begin."""

FEWEST_CHANGED = 4
"""Observations that must agree on a change: fewer may be disturbed alike by chance."""

LARGEST_DOUBTFUL_COUNT = 16
"""Largest number of doubtful observations that are kept to be fitted again."""

LARGEST_CHANGE_COUNT = 10
"""Largest number of changes that are kept."""

FEW = 2.0
"""Observations that could not be explained, imagined before the first: one success is no rule."""

FORGOTTEN = float(np.exp(-7.0))
"""Weight by its age below which an observation is not fitted any more: a thousandth."""

LARGEST_EXPONENT = 700.0
"""Largest argument of exp in double precision."""


@dataclass(frozen=True, eq=False)
class Doubt:
    """Why an observation is set aside.

    Parameters
    ----------
    fit : that knows nothing of θ_s
    assessment : to be noted
    disturbed : whether nothing explains it, so that it says nothing of any knowledge
    """

    fit: LoneFit
    assessment: Assessment
    disturbed: bool


class OnlineLearner:
    """Learns from one observation after the other; what it knows is `state`.

    Parameters
    ----------
    simulator : the engine that simulates candidates
    options : how to learn; None for the defaults
    state : of a learner to continue exactly; None to begin with nothing
    observations : `kept_observations` of that learner, in any order
    recall : returns earlier observations by their ids, those that are still to be learned from;
        None: what may be needed of them is kept here

    Attributes
    ----------
    state : to be stored after `learn_from_all`
    simulations : of single observations so far
    problem : why the last observation that was passed over cannot be simulated; empty if none was
    """

    def __init__(
        self,
        simulator: Simulator,
        options: OnlineOptions | None = None,
        state: OnlineState | None = None,
        observations: Iterable[Observation] = (),
        recall: Callable[[Sequence[str]], Iterable[Observation]] | None = None,
    ) -> None:
        self._simulator = simulator
        self._options = options or OnlineOptions()
        self.state = OnlineState.empty() if state is None else state
        self.simulations = 0.0
        self.problem = ""
        self._observations = {observation.id: observation for observation in observations}
        self._assessments: list[Assessment] = []
        self._recall = recall
        for name in ("window", "doubtful") if recall else MEMBERS:
            there = [
                member for member in getattr(self.state, name) if member.id in self._observations
            ]
            setattr(self.state, name, there)

    def learn_from(self, observation: Observation) -> LearnedParameters:
        """Learn from one more observation; return the newest published θ_s."""
        self.learn_from_all([observation])
        published = self.state.published
        return published or LearnedParameters.defaults(observation.materials)

    def learn_from_all(
        self,
        observations: Sequence[Observation],
        seconds_left: Callable[[], float] = lambda: np.inf,
    ) -> list[Assessment]:
        """Learn from new observations, in their order; those that are known are passed over.

        Parameters
        ----------
        observations : new ones
        seconds_left : called between steps; each observation takes its part in any case

        Returns
        -------
        What is to be noted about single observations, doubtful ones and those taken back.
        """
        self._assessments = []
        given = {observation.id for observation in observations}
        # Observations that a user includes again are fitted again.
        doubtful = [member for member in self.state.doubtful if member.id not in given]
        self.state.set_aside -= len(self.state.doubtful) - len(doubtful)
        self.state.processed -= len(self.state.doubtful) - len(doubtful)
        self.state.doubtful = doubtful
        kept = {member.id for member in (*self.state.kept, *self.state.doubtful)}
        for observation in observations:
            if observation.id not in kept:
                self._process(observation)
                kept.add(observation.id)
        self._retry_doubtful()
        self._fit(seconds_left)
        self._notice_change(seconds_left)
        self._publish()
        self._drop_observations()
        return self._assessments

    def adopt(self, learned: LearnedParameters, *, informed: bool) -> None:
        """Begin again from a version of θ_s that was stored by others.

        Parameters
        ----------
        learned : the version; it is what is published from now on
        informed : whether its uncertainty is knowledge to start with; otherwise only its values are
            a start, and the observations say the rest
        """
        self.state.know_materials(learned.materials)
        state = self.state
        whole = learned.extended(state.materials)
        state.published = whole
        posterior = whole.whole_posterior().within(state.space.bounds)
        information = Gaussian.of(posterior, state.held)
        state.centre, state.unit = information.mean.copy(), information.mean.copy()
        state.ground = information if informed else state.given()
        state.retired = state.posterior = state.ground
        state.window, state.past, state.doubtful = [], [], []
        state.count_from(0)
        state.retired_spins = SpinEvidence.about(
            whole.initial_spins if informed else InitialSpins()
        )
        state.published_information = information
        state.end_trial()
        self._drop_observations()

    @property
    def kept_observations(self) -> list[Observation]:
        """Observations that the state needs to continue, a bounded number."""
        return list(self._observations.values())

    def _influence(self, observations: Sequence[Observation]) -> NDArray[np.bool_]:
        """Which observation depends on which free parameter, (n_observations, n)."""
        influence = parameter_influence(observations, self.state.materials)
        return np.asarray(influence & ~self.state.held)

    def _process(self, observation: Observation) -> None:
        """Predict an observation, then take it into the window or set it aside."""
        state = self.state
        state.processed += 1
        state.know_materials(observation.materials)
        self._forget_until(observation.start_time)
        (influence,) = self._influence([observation])
        if not influence.any():
            return
        try:
            cost = TrajectoryCost([detected(observation)], self._simulator, state.materials)
            fit = self._lone_fit(cost, influence, state.prior)
            if fit.blocked:
                fit = self._lone_fit(cost, influence, state.prior, careful=True)
        except UnsupportedSceneError as error:
            self.problem = f"observation {observation.id} is passed over: {error}"
            self._assessments.append(Assessment(observation.id, 0.0, str(error), DOUBTFUL))
            state.set_aside += 1
            return
        self._observations[observation.id] = observation
        doubt = self._reason_for_doubt(cost, influence, fit)
        if doubt is None or not doubt.disturbed:
            self._score(fit)
        if doubt is None:
            state.window.append(self._member(observation, fit))
        else:
            self._set_aside(self._member(observation, doubt.fit), doubt.assessment)

    def _member(self, observation: Observation, fit: LoneFit) -> Member:
        number, stamp = self.state.processed, observation.start_time
        return Member(observation.id, number, stamp, fit.observation_fit, fit.likelihood())

    def _lone_fit(
        self,
        cost: TrajectoryCost,
        influence: NDArray[np.bool_],
        prior: Gaussian,
        scans: tuple[int, ...] = (),
        careful: bool = False,
    ) -> LoneFit:
        fit = LoneFit(
            cost,
            self.state.space,
            influence,
            prior,
            self.state.parameters,
            scans=scans,
            careful=careful,
        )
        fit.run()
        self.simulations += fit.simulations
        return fit

    def _reason_for_doubt(
        self, cost: TrajectoryCost, influence: NDArray[np.bool_], fit: LoneFit
    ) -> Doubt | None:
        """Compare with a fit that knows nothing; None when the observation is not doubtful."""
        state = self.state
        share = state.explained / (state.met + FEW)
        kept = np.exp(-1.0 / MEMORY)
        state.met = kept * state.met + 1.0
        state.explained = kept * state.explained + (0.0 if fit.blocked else 1.0)
        if not fit.blocked:
            return None
        (observation,) = cost.observations
        nothing = Gaussian.within_bounds(state.prior.mean)
        free = self._lone_fit(cost, influence, nothing, scans=FREE_SCANS)
        horizon = max(free.observation_fit.horizon, fit.observation_fit.horizon)
        gain = free.log_evidence(horizon) - fit.log_evidence(horizon)
        if gain > CONFLICT:
            weight = float(np.exp(-min(gain, LARGEST_EXPONENT)))
            odds = f"e^{gain:.0f} times as likely with other parameters"
            reason = f"{Reason.CONTRADICTORY.value}: {odds}"
            return Doubt(free, Assessment(observation.id, weight, reason, DOUBTFUL), False)
        if free.blocked and share > SMALLEST_EXPLAINED:
            reason = Reason.UNEXPLAINED.at(horizon)
            return Doubt(free, Assessment(observation.id, 1.0 - share, reason, DOUBTFUL), True)
        return None

    def _set_aside(self, member: Member, assessment: Assessment) -> None:
        state = self.state
        state.doubtful.append(replace(member, weight=0.0))
        del state.doubtful[:-LARGEST_DOUBTFUL_COUNT]
        state.set_aside += 1
        self._assessments.append(assessment)

    def _retry_doubtful(self) -> None:
        """Fit the doubtful observation whose last fit is oldest to the present knowledge."""
        state = self.state
        if not state.doubtful:
            return
        member = state.doubtful[0]
        if member.number > state.processed - RECENT:
            return
        observation = self._observations[member.id]
        (influence,) = self._influence([observation])
        cost = TrajectoryCost([detected(observation)], self._simulator, state.materials)
        fit = self._lone_fit(cost, influence, state.prior)
        del state.doubtful[0]
        if fit.blocked:
            state.doubtful.append(member)
        else:
            self._take_back(replace(member, fit=fit.observation_fit, likelihood=fit.likelihood()))

    def _take_back(self, member: Member) -> None:
        self.state.window.append(replace(member, weight=1.0))
        self.state.set_aside -= 1
        self._assessments.append(Assessment(member.id, 1.0, "agrees with later observations", USED))

    def _score(self, fit: LoneFit) -> None:
        """Add how much better the challenger predicted an observation than what is published.

        `fit` is to what is known now; both predictions begin where it ends.
        """
        state = self.state
        if state.challenger is None:
            return
        horizon = fit.observation_fit.horizon + BEYOND
        challenger, published = (
            fit.log_evidence(horizon, information.bounded(state.centre))
            for information in (state.challenger, state.published_information)
        )
        gain = np.clip(challenger - published, -LARGEST_VOTE, LARGEST_VOTE)
        state.score += float(gain)
        state.compared += 1

    def _forget_until(self, stamp: float) -> None:
        """Let what is known grow older, to the start time in s of a new observation."""
        state = self.state
        last, state.time = state.time, stamp if state.time is None else max(state.time, stamp)
        if last is not None and self._options.time_constant > 0.0:
            factor = float(np.exp(-(state.time - last) / self._options.time_constant))
            given = state.given()
            for name in ("ground", "retired", "posterior"):
                known = getattr(state, name).scaled(factor)
                setattr(state, name, known.joined(given, 1.0 - factor))
            state.retired_spins.discount(factor)
            for member in state.kept:
                member.weight *= factor

    def _age_weight(self, member: Member) -> float:
        """Weight of an observation by its age, 0 to 1."""
        if self._options.time_constant == 0.0 or self.state.time is None:
            return 1.0
        return float(np.exp(-(self.state.time - member.stamp) / self._options.time_constant))

    def _fit(self, seconds_left: Callable[[], float]) -> None:
        """Fit the window, or where that is due all observations that are kept."""
        for member in self.state.kept:
            if self._age_weight(member) < FORGOTTEN:
                self._let_go(member)
        if self.state.refit_is_due:
            self._refit(seconds_left)
            self._retire()
        else:
            self._retire()
            self._fit_window(seconds_left)

    def _fit_window(self, seconds_left: Callable[[], float]) -> None:
        """Fit the observations of the window jointly and take the posterior over."""
        state = self.state
        if not state.window:
            return
        problem = self._problem(state.window, self._observations, state.before_window())
        fit = window_fit(problem.task)
        self._begin_at_present(fit, problem)
        run(fit, WINDOW_STEPS, seconds_left)
        self.simulations += fit.model.simulations
        self._take_over(problem, fit, with_spins=False)

    def _refit(self, seconds_left: Callable[[], float]) -> None:
        """Fit all observations that are kept as a search does, and begin again from the best fit.

        The starts are the present estimate, what is published where that is far away, what was
        known before all observations, and points drawn from that.
        """
        state = self.state
        observations = self._recalled()
        state.next_refit = 2 * (state.used - state.begun)
        if not state.kept:
            return
        problem = self._problem(state.kept, observations, state.ground)
        settings = JointEstimationSettings(scan_steps=())
        continued = [JointFit(problem.task, settings)]
        self._begin_at_present(continued[0], problem)
        if state.published is not None and has_moved_far(state):
            continued.append(JointFit(problem.task, settings))
            published = state.published_information.bounded(state.centre)
            self._begin_at(continued[1], problem, published)
        for fit in continued:
            run(fit, CONTINUED_STEPS, seconds_left)
        prior = problem.task.prior
        drawn = drawn_starts(prior, STARTS - 1, np.random.default_rng(state.used))
        staged = StagedFit(problem.task, np.array([prior.mean, *drawn]))
        run(staged, REFIT_STEPS, seconds_left)
        staged.choose()
        fits = [*continued, staged.joint]
        self.simulations += sum(fit.model.simulations for fit in continued) + staged.simulations
        best = fits[most_evident(problem.task, fits)]
        self._take_over(problem, best, with_spins=True)
        self._forget_what_disagrees()
        if len(problem.members) >= FEWEST_COMPARED:
            # It has explained all observations better than what is published.
            state.challenger, state.compared = state.posterior, len(problem.members)
            state.score = len(problem.members) * LARGEST_VOTE

    def _recalled(self) -> dict[str, Observation]:
        """Return all observations that are kept, by id; those that are gone are not kept."""
        state = self.state
        missing = [member.id for member in state.past if member.id not in self._observations]
        recalled = dict(self._observations)
        if missing and self._recall is not None:
            recalled.update((observation.id, observation) for observation in self._recall(missing))
        state.past = [member for member in state.past if member.id in recalled]
        return recalled

    def _problem(
        self, members: list[Member], observations: Mapping[str, Observation], known: Gaussian
    ) -> JointProblem:
        """Return the fit of some members, to what is known without them."""
        state = self.state
        observed = [observations[member.id] for member in members]
        influence = self._influence(observed)
        active: NDArray[np.bool_] = np.asarray(influence.any(axis=0))
        parameters = np.flatnonzero(active)
        prior = known.bounded(state.centre)
        points = [detected(each) for each in observed]
        cost = TrajectoryCost(points, self._simulator, state.materials)
        space = ActiveSpace(state.space, active, state.parameters)
        ages = np.array([self._age_weight(member) for member in members])
        task = FitTask(cost, space, influence[:, active], prior.marginal(parameters), ages)
        return JointProblem(members, parameters, prior, task)

    def _begin_at_present(self, fit: JointFit, problem: JointProblem) -> None:
        known = Gaussian.about(self.state.unit, self.state.prior.precision)
        self._begin_at(fit, problem, known)

    def _begin_at(self, fit: JointFit, problem: JointProblem, known: Gaussian) -> None:
        """Let a fit begin at what is known, with the initial states that were found last."""
        unit = np.clip(known.mean, 0.0, 1.0)[problem.parameters]
        states = [member.fit for member in problem.members]
        fit.begin_at(unit, known.deviations[problem.parameters], states)

    def _forget_what_disagrees(self) -> None:
        """Keep of observations that are gone only what agrees with those that are kept.

        What they say was linearised where the estimate was then.
        """
        state = self.state
        if state.retired.equals(state.ground):
            return
        likelihoods = [
            replace(
                member.likelihood,
                information=member.weight * member.likelihood.information,
                scores=member.weight * member.likelihood.scores,
            )
            for member in state.kept
        ]
        for parameters in self._families().values():
            prior = state.retired.bounded(state.centre)
            probability = change_probability(prior, likelihoods, parameters)
            if probability < self._options.false_alarm_rate:
                state.forget_pair(parameters, ground=False)
        state.add_up()

    def _take_over(self, problem: JointProblem, fit: JointFit, *, with_spins: bool) -> None:
        """Let what a fit has found of its members be what is known of them.

        `with_spins`: also what they say of how balls are thrown, which takes as long as four steps.
        """
        state, parameters, prior = self.state, problem.parameters, problem.prior
        moved = np.zeros(state.unit.size, dtype=bool)
        moved[parameters] = True
        # Parameters that the members do not depend on follow those that they correlate with.
        rest = np.flatnonzero(~moved)
        across = prior.precision[np.ix_(rest, parameters)] @ (fit.unit - prior.mean[parameters])
        gains = np.linalg.solve(prior.precision[np.ix_(rest, rest)], across)
        state.unit[parameters] = fit.unit
        state.unit[rest] = np.clip(prior.mean[rest] - gains, 0.0, 1.0)
        for member, observation_fit, likelihood, weight in zip(
            problem.members,
            fit.observation_fits(),
            fit.likelihoods(look_for_spins=with_spins),
            fit.weights.tolist(),
            strict=True,
        ):
            member.fit, member.weight = observation_fit, weight
            spins = likelihood.spins if with_spins else member.likelihood.spins
            own = parameters[likelihood.parameters]
            member.likelihood = replace(likelihood, parameters=own, spins=spins)
        state.add_up()

    def _retire(self) -> None:
        """Let leave a window that is too full what says least, and go what left it first."""
        state = self.state
        while len(state.window) > self._options.window:
            covariance = state.prior.covariance
            newest = state.processed - RECENT
            old = [member for member in state.window if member.number <= newest] or state.window[:1]
            leaving = min(old, key=lambda member: self._worth(member, covariance))
            state.window = [each for each in state.window if each is not leaving]
            state.past.append(leaving)
        while len(state.past) > max(MOST_KEPT - self._options.window, 0):
            self._let_go(min(state.past, key=lambda member: member.number))

    def _worth(self, member: Member, covariance: NDArray[np.float64]) -> float:
        """Information of an observation on what is uncertain: tr(P Λ)."""
        parameters = member.likelihood.parameters
        part = covariance[np.ix_(parameters, parameters)]
        return member.weight * float(np.sum(part * member.likelihood.information))

    def _let_go(self, member: Member) -> None:
        """Keep of an observation only what it says of the parameters."""
        state = self.state
        state.retired = state.retired.plus([member.likelihood], [member.weight])
        state.retired_spins.add_all(member.likelihood.spins, member.weight)
        state.window = [each for each in state.window if each is not member]
        state.past = [each for each in state.past if each is not member]

    def _notice_change(self, seconds_left: Callable[[], float]) -> None:
        """Forget parameters that have changed, and learn them again."""
        state = self.state
        kept = [*state.window, *state.doubtful]
        newest = state.processed - RECENT
        kept = sorted((k for k in kept if k.number > newest), key=lambda k: k.number)
        families = self._families()
        change = find_change(
            state.posterior,
            state.centre,
            [(member.likelihood, member.weight) for member in kept],
            families,
            {family: self._count_of(members) for family, members in families.items()},
            OUTWEIGHED if self._is_outweighed() else self._options.false_alarm_rate,
            FEWEST_CHANGED,
        )
        if change is None:
            return
        state.changes.append((change, state.processed - change.length))
        del state.changes[:-LARGEST_CHANGE_COUNT]
        after = kept[-change.length :]
        for member in [member for member in state.kept if member not in after]:
            self._let_go(member)
        members = families[change.pair]
        state.forget_pair(members, ground=True)
        for member in [member for member in state.doubtful if member in after]:
            state.doubtful.remove(member)
            self._take_back(member)
        state.count_from(change.length)
        state.add_up()
        state.unit = np.clip(state.prior.mean, 0.0, 1.0)
        self._fit_window(seconds_left)
        # Observations that agree on a change have compared it with what is published.
        state.challenger, state.compared = state.posterior, change.length
        state.score = change.length * LARGEST_VOTE

    def _is_outweighed(self) -> bool:
        """Whether what is remembered counts less, by its age, than what is set aside.

        Not before observations are forgotten: until then what is known is what most agree on.
        """
        if self._options.time_constant == 0.0:
            return False
        remembered = sum(map(self._age_weight, self.state.kept))
        return sum(map(self._age_weight, self.state.doubtful)) > remembered

    def _count_of(self, parameters: NDArray[np.int64]) -> int:
        """Number of observations that inform some parameters; retired ones are enough."""
        state = self.state
        retired = state.retired.precision[np.ix_(parameters, parameters)].any()
        dependent = [member.likelihood.parameters for member in state.kept]
        count = sum(bool(np.isin(each, parameters).any()) for each in dependent)
        return count + (RECENT if retired else 0)

    def _families(self) -> dict[tuple[str, ...], NDArray[np.int64]]:
        first, each = len(self.state.materials), len(PAIR_COEFFICIENTS)
        return {
            pair: first + each * k + np.arange(each)
            for k, pair in enumerate(material_pairs(self.state.materials))
        }

    def _publish(self) -> None:
        """Publish the estimate if it says something new; if it has moved far, once it has won."""
        state = self.state
        if not state.posterior.precision.any():
            return
        if state.published is not None and has_moved_far(state):
            if not has_won(state):
                if not is_on_trial(state):
                    state.begin_trial()
                return
        elif not is_new(state):
            state.end_trial()
            return
        observations = [self._observations[member.id] for member in state.window]
        cost = TrajectoryCost(observations, self._simulator, state.materials)
        state.published = next_version(state, float(cost.costs([state.parameters])[0]))
        state.published_information = state.posterior
        state.end_trial()

    def _drop_observations(self) -> None:
        state = self.state
        past = [] if self._recall else state.past
        members = (*past, *state.window, *state.doubtful)
        self._observations = {member.id: self._observations[member.id] for member in members}
