"""Recursive learning from a store; it resumes exactly after the process was killed."""

from __future__ import annotations

import time

import numpy as np

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.observation import Observation
from intuitive_physics.simulation import Simulator
from intuitive_physics_learner.online.online_learner import OnlineLearner
from intuitive_physics_learner.online.online_state import OnlineState
from intuitive_physics_learner.online.options import OnlineOptions
from intuitive_physics_learner.store import ObservationStore, OnlineRecord
from intuitive_physics_learner.store.observation_entries import INCLUDED_BY_USER

BATCH = 8
"""Largest number of waiting observations that are learned from together, so that they share the
joint steps; set by hand."""

MOST_SPARED = 32.0
"""Largest number of observations whose CPU time is saved up, for refits: one of 32 throws of a box
takes some 7 s, where a usual observation takes 0.5 s."""


class StoredOnlineLearning:
    """Learns from the observations of a store, in the order in which they came.

    The state is stored with each new version of θ_s, both or none. What others store as the newest
    θ_s becomes the state: values that a user gave with their uncertainty, or the result of a
    search, whose observations are not learned from a second time.

    Parameters
    ----------
    store : of observations, versions of θ_s and the state
    simulator : the engine that simulates candidates
    options : how to learn

    Attributes
    ----------
    learner : holds the state
    problem : why the last observation that was passed over cannot be learned from; empty if none
        was
    """

    def __init__(
        self, store: ObservationStore, simulator: Simulator, options: OnlineOptions
    ) -> None:
        self._store = store
        self._record = OnlineRecord(store.database)
        self._simulator = simulator
        self._options = options
        self.problem = ""
        self.learner = self._resumed()

    @property
    def pending(self) -> int:
        """Number of observations that are still to be learned from."""
        state = self.learner.state
        return self._record.count_since(state.position, state.adopted)

    def advance(self) -> bool:
        """Learn from the next observations, a few at most; return whether there were any."""
        newest = self._store.newest_version()
        if newest != self._version:
            # The learner of another process stores its state with its version.
            self.learner = self._resumed()
            if newest != self._version:
                self._adopt()
        state = self.learner.state
        new = self._record.observations_since(state.position, BATCH, state.adopted)
        if not new:
            return False
        observations = [each for _, each in new if isinstance(each, Observation)]
        trusted = [entry.id for entry, _ in new if entry.reason == INCLUDED_BY_USER]
        for entry, read in new:
            if isinstance(read, InvalidInputError):
                self.problem = f"observation {entry.id} cannot be read and is passed over: {read}"
        before = self._version
        usual = self._options.seconds * len(observations)
        ends = time.process_time() + usual + state.spare_seconds
        assessments = self.learner.learn_from_all(
            observations, lambda: ends - time.process_time(), trusted
        )
        most = self._options.seconds * MOST_SPARED
        state.spare_seconds = float(np.clip(ends - time.process_time(), 0.0, most))
        self.problem = self.learner.problem or self.problem
        state.position = new[-1][0].revision
        learned = state.published if self._version != before else None
        if not self._store.save_online(state.to_json(), before, learned, assessments):
            # Others have stored a version meanwhile: it counts, and these are learned from again.
            self.learner = self._resumed()
        return True

    @property
    def _version(self) -> int:
        published = self.learner.state.published
        return 0 if published is None else published.version

    def _resumed(self) -> OnlineLearner:
        text = self._record.state()
        try:
            state = OnlineState() if text is None else OnlineState.from_json(text)
        except InvalidInputError as error:
            self.problem = f"{error}; all observations are learned from again"
            state = OnlineState()
        used = self._record.still_used([member.id for member in state.past])
        state.past = [member for member in state.past if member.id in used]
        return OnlineLearner(self._simulator, self._options, state, self._record.kept)

    def _adopt(self) -> None:
        """Take over the newest θ_s, which others have stored."""
        newest = self._store.newest_parameters()
        if newest is None:
            return
        given = not newest.method
        # Where few observations were learned from before there was a state, they are fitted jointly
        # with those that come, and say again what they said.
        few = newest.observation_count <= self._options.window
        again = self.learner.state.processed == 0 and few
        self.learner.adopt(newest, informed=given or not again)
        position = None if given or again else self._record.revision_before(newest.version)
        if position is not None:
            self.learner.state.adopted, self.learner.state.position = newest.version, position
