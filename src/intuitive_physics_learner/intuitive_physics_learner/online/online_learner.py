"""Recursive learning: each observation is predicted, then learned from, at a bounded cost.

An observation is fitted by itself to what is known (`lone_fit`), which is its prediction. By that
fit it is doubted or not (`doubt`), and taken into the window of those that are kept (`memory`).
They are fitted jointly (`joint_fits`), what has changed is forgotten (`change_point`), and what is
known then is published (`publication`).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence

import numpy as np

from intuitive_physics.errors import UnsupportedSceneError
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.observation import Observation
from intuitive_physics.prior_knowledge.initial_spins import InitialSpins
from intuitive_physics.prior_knowledge.spin_evidence import SpinEvidence
from intuitive_physics.simulation import Simulator
from intuitive_physics_learner.cost.cost_function import TrajectoryCost
from intuitive_physics_learner.cost.point_noise import detected
from intuitive_physics_learner.online.change_point import forget_what_changed
from intuitive_physics_learner.online.doubt import (
    Examined,
    examine,
    set_aside,
    set_aside_disturbed,
    take_back,
)
from intuitive_physics_learner.online.joint_fits import JointFits
from intuitive_physics_learner.online.memory import RECENT, grow_older, let_go_of_old, retire
from intuitive_physics_learner.online.online_state import Member, OnlineState
from intuitive_physics_learner.online.options import OnlineOptions
from intuitive_physics_learner.online.publication import (
    count_prediction,
    is_to_be_published,
    publish,
)
from intuitive_physics_learner.search.gaussian import Gaussian
from intuitive_physics_learner.store.observation_entries import DOUBTFUL, Assessment


class OnlineLearner:
    """Learns from one observation after the other; what it knows is `state`.

    Parameters
    ----------
    simulator : the engine that simulates candidates
    options : how to learn
    state : an empty one, or that of a learner to continue exactly
    recall : returns earlier observations by their ids, those that are still to be learned from

    Attributes
    ----------
    state : to be stored after `learn_from_all`
    problem : why the last observation that was passed over cannot be simulated; empty: none was
    """

    def __init__(
        self,
        simulator: Simulator,
        options: OnlineOptions,
        state: OnlineState,
        recall: Callable[[Sequence[str]], Iterable[Observation]],
    ) -> None:
        self._simulator = simulator
        self._options = options
        self.state = state
        self.problem = ""
        self._recall = recall
        self._observations: dict[str, Observation] = {}
        self._observations = self._recalled([*state.window, *state.doubtful])
        for name in ("window", "doubtful"):
            members = getattr(state, name)
            setattr(state, name, [each for each in members if each.id in self._observations])

    def learn_from_all(
        self,
        observations: Sequence[Observation],
        seconds_left: Callable[[], float] = lambda: np.inf,
        trusted: Collection[str] = (),
    ) -> list[Assessment]:
        """Learn from new observations, in their order; those that are known are passed over.

        Parameters
        ----------
        observations : new ones
        seconds_left : called between steps; each observation takes its part in any case
        trusted : ids of those that a user has included, which are never set aside

        Returns
        -------
        What is to be noted about single observations, doubtful ones and those taken back.
        """
        state, fits = (
            self.state,
            JointFits(self.state, self._simulator, self._options, seconds_left),
        )
        self._let_included_ones_come_again({observation.id for observation in observations})
        for member in state.kept:
            member.trusted |= member.id in trusted
        kept = {member.id for member in (*state.kept, *state.doubtful)}
        assessments = []
        for observation in observations:
            if observation.id not in kept:
                kept.add(observation.id)
                assessments += self._take(observation, observation.id in trusted)
        assessments += set_aside_disturbed(state)
        self._read_doubtful()
        assessments += self._examine_again()
        let_go_of_old(state, self._options.time_constant)
        if state.refit_is_due:
            there = self._recalled(state.past)
            state.past = [member for member in state.past if member.id in there]
            fits.refit(there)
            retire(state, self._options.window)
        else:
            retire(state, self._options.window)
            fits.fit_window(self._observations, len(observations))
        assessments += self._follow_change(fits)
        if is_to_be_published(state):
            window = self._cost([self._observations[member.id] for member in state.window])
            publish(state, float(window.costs([state.parameters])[0]))
        self._drop_observations()
        return assessments

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
        state.spread, state.flatness = np.zeros(state.unit.size), np.ones(state.unit.size)
        state.free = np.zeros((state.unit.size, 2))
        state.count_from(0)
        state.retired_spins = SpinEvidence.about(
            whole.initial_spins if informed else InitialSpins()
        )
        state.published_information = information
        state.end_trial()
        self._drop_observations()

    def _let_included_ones_come_again(self, given: set[str]) -> None:
        """Let doubtful observations that a user includes be new ones."""
        state = self.state
        rest = [member for member in state.doubtful if member.id not in given]
        state.set_aside -= len(state.doubtful) - len(rest)
        state.processed -= len(state.doubtful) - len(rest)
        state.doubtful = rest

    def _take(self, observation: Observation, trusted: bool = False) -> list[Assessment]:
        """Predict an observation, then take it into the window or, unless trusted, set it aside."""
        state = self.state
        state.processed += 1
        state.know_materials(observation.materials)
        grow_older(state, observation.start_time, self._options.time_constant)
        if not state.influence([observation]).any():
            return []
        try:
            examined = self._examined(observation, state.processed, trusted)
        except UnsupportedSceneError as error:
            self.problem = f"observation {observation.id} is passed over: {error}"
            state.set_aside += 1
            return [Assessment(observation.id, 0.0, str(error), DOUBTFUL)]
        self._observations[observation.id] = observation
        if examined.predictable:
            count_prediction(state, examined.fit)
        if examined.doubt is None:
            state.window.append(examined.member)
            return []
        set_aside(state, examined.member)
        return [examined.doubt]

    def _examine_again(self) -> list[Assessment]:
        """Examine the doubtful observation that was examined first of all by what is known now."""
        state = self.state
        if not state.doubtful or state.doubtful[0].number > state.processed - RECENT:
            return []
        member = state.doubtful.pop(0)
        examined = self._examined(self._observations[member.id], member.number)
        if examined.doubt is None:
            return [take_back(state, examined.member)]
        state.doubtful.append(member)
        return []

    def _examined(self, observation: Observation, number: int, trusted: bool = False) -> Examined:
        """Return the `number`-th observation beside what is known."""
        cost = self._cost([detected(observation)])
        return examine(self.state, cost, self._simulator, number, trusted=trusted)

    def _follow_change(self, fits: JointFits) -> list[Assessment]:
        """Forget parameters that have changed, and learn them again from what came since."""
        state = self.state
        agreeing = forget_what_changed(state, self._options)
        if agreeing is None:
            return []
        state.doubtful = [member for member in state.doubtful if member not in agreeing]
        assessments = [take_back(state, member) for member in agreeing]
        length = state.changes[-1][0].length
        state.count_from(length)
        state.add_up()
        state.unit = np.clip(state.prior.mean, 0.0, 1.0)
        fits.fit_window(self._observations, length)
        # Observations that agree on a change have compared it with what is published.
        state.begin_trial(length)
        return assessments

    def _read_doubtful(self) -> None:
        """Have the doubtful observations at hand, those that had left the window included."""
        self._observations = self._recalled(self.state.doubtful)
        there = [member for member in self.state.doubtful if member.id in self._observations]
        self.state.doubtful = there

    def _recalled(self, members: Iterable[Member]) -> dict[str, Observation]:
        """Return observations by id: those at hand, and earlier ones as far as they are there."""
        missing = [member.id for member in members if member.id not in self._observations]
        found = self._recall(missing) if missing else ()
        return self._observations | {observation.id: observation for observation in found}

    def _cost(self, observations: Sequence[Observation]) -> TrajectoryCost:
        return TrajectoryCost(observations, self._simulator, self.state.materials)

    def _drop_observations(self) -> None:
        """Have the observations of the window at hand, and those that were set aside."""
        members = (*self.state.window, *self.state.doubtful)
        self._observations = {member.id: self._observations[member.id] for member in members}
