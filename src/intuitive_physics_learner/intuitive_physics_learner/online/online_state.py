"""All that recursive learning remembers, as plain data."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import cast

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.materials import (
    PAIR_COEFFICIENTS,
    StaticParameters,
    material_pairs,
    parameter_places,
)
from intuitive_physics.observation import Observation
from intuitive_physics.parameter_posterior import UNIFORM_PRECISION
from intuitive_physics.parameter_space import (
    DEFAULT_BOUNDS,
    ParameterSpace,
    parameter_vector,
    parameters_of_vector,
)
from intuitive_physics.prior_knowledge.initial_spins import InitialSpins
from intuitive_physics.prior_knowledge.spin_evidence import SpinEvidence, SpinLikelihood
from intuitive_physics_learner.cost.cost_function import Cost
from intuitive_physics_learner.cost.parameter_influence import parameter_influence
from intuitive_physics_learner.joint_estimation.joint_fit import LARGEST_VOTE, ObservationFit
from intuitive_physics_learner.online.encoding import decoded, encoded
from intuitive_physics_learner.search.gaussian import Gaussian, LocalLikelihood
from intuitive_physics_learner.search.learning_task import FitTask
from intuitive_physics_learner.search.search_space import ActiveSpace

FORMAT = "intuitive_physics/online_state/6"
"""Format of the JSON text, which every text names."""


@dataclass(frozen=True)
class ChangePoint:
    """A change that was noticed.

    Parameters
    ----------
    pair : of materials, whose parameters changed
    length : number of the last observations, when it was noticed, that were made after it
    probability : of so large a ratio without a change
    """

    pair: tuple[str, ...]
    length: int
    probability: float


@dataclass(frozen=True)
class Signs:
    """Signs of an observation that it was disturbed.

    Parameters
    ----------
    log_p : logarithm of its p value by laws of motion that hold for every θ_s
    violated : the law that is violated worst, and when; empty: none is
    misfit : loss per point of what undisturbed motions explain worst, 1.5 where only noise is left
    time : s after the start, where that begins
    """

    log_p: float
    violated: str
    misfit: float
    time: float


@dataclass(eq=False)
class Member:
    """An observation that is kept.

    Parameters
    ----------
    id : of the observation
    number : how many observations came before it
    stamp : s, its start time
    fit : from which the next fit begins
    likelihood : of θ_s, from this observation alone where it is doubtful, else from the last joint
        fit
    signs : of having been disturbed
    weight : with which it counts; 0 where it is doubtful
    trusted : whether a user has included it, so that nothing sets it aside
    in_segments : whether its likelihood is its part of what throws in segments say together
    """

    id: str
    number: int
    stamp: float
    fit: ObservationFit
    likelihood: LocalLikelihood
    signs: Signs
    weight: float = 1.0
    trusted: bool = False
    in_segments: bool = False


@dataclass(frozen=True, eq=False)
class Refitted:
    """What a fit to all observations that are kept led to.

    Parameters
    ----------
    used : number of observations that were learned from
    unit, deviations : (n,) estimate on the unit cube, and standard deviation of each parameter
    """

    used: int
    unit: NDArray[np.float64]
    deviations: NDArray[np.float64]

    def among(self, places: NDArray[np.int64], size: int) -> Refitted:
        """Return the same among `size` parameters, at `places` (n,); of others nothing is known."""
        unit, deviations = np.zeros(size), np.full(size, UNIFORM_PRECISION**-0.5)
        unit[places], deviations[places] = self.unit, self.deviations
        return Refitted(self.used, unit, deviations)


@dataclass(eq=False)
class OnlineState:
    """Knowledge of n parameters, and the observations that it rests on; before any, nothing.

    Parameters
    ----------
    materials : known so far, in the order of `parameter_names`
    centre : (n,) mean where nothing is known, on the unit cube
    unit : (n,) the present estimate there
    ground : what was known before all observations that are learned from here, by a user or by a
        search, on which every fit rests
    retired : with what is known from observations that are not kept any more
    posterior : with all that are kept
    spread : (n,) widths², how far fits from other starts were from the best one at the last refit,
        each weighted by its evidence
    flatness : (n,) by how much the profile of the loss was flatter than slopes said at the last
        refit: a factor of at least 1 on the deviation of each parameter
    free : (n, 2) widths, how far parameters could be moved down and up then that are bound to one
        side only; 0 for others
    window : observations that are fitted jointly
    past : observations that have left the window, the newest last, whose likelihoods are linear
        until all that are kept are fitted again
    doubtful : observations that were set aside, the newest last
    published : newest version of θ_s; None before the first
    published_information : what is known according to it, of the n parameters
    challenger : what was known when the estimate had moved away from what is published, which it is
        to take the place of; None: it has not
    score : ln p of the observations since then according to the challenger, less that according to
        what is published, both as they were before any of these
    compared : number of these observations
    processed : observations so far
    set_aside : of these, how many are doubtful
    changes : last changes that were noticed, and how many observations there were before each
    time : s, the latest start time of an observation
    position : revision of the store up to which observations are known
    adopted : version of θ_s of a search, whose observations are known as well; 0: none
    spare_seconds : CPU time in s that earlier observations have left over
    retired_spins : what throws that are not kept any more say of how balls are thrown
    begun : number of used observations before those that are learned from here: since the state
        began with what others stored, or since a change
    next_refit : number of observations since then at which all that are kept are fitted again
    refitted : since then, the last fit and the one before it
    """

    materials: tuple[str, ...] = ()
    centre: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    unit: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    ground: Gaussian = field(default_factory=lambda: Gaussian.nothing(0))
    retired: Gaussian = field(default_factory=lambda: Gaussian.nothing(0))
    posterior: Gaussian = field(default_factory=lambda: Gaussian.nothing(0))
    spread: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    flatness: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    free: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 2)))
    window: list[Member] = field(default_factory=list)
    past: list[Member] = field(default_factory=list)
    doubtful: list[Member] = field(default_factory=list)
    published: LearnedParameters | None = None
    published_information: Gaussian = field(default_factory=lambda: Gaussian.nothing(0))
    challenger: Gaussian | None = None
    score: float = 0.0
    compared: int = 0
    processed: int = 0
    set_aside: int = 0
    changes: list[tuple[ChangePoint, int]] = field(default_factory=list)
    time: float | None = None
    position: int = 0
    adopted: int = 0
    spare_seconds: float = 0.0
    retired_spins: SpinEvidence = field(default_factory=SpinEvidence)
    begun: int = 0
    next_refit: int = 1
    refitted: list[Refitted] = field(default_factory=list)

    @property
    def used(self) -> int:
        """Number of observations that were learned from."""
        return self.processed - self.set_aside

    @property
    def kept(self) -> list[Member]:
        """Observations that are learned from and can be fitted, those of the window last."""
        return [*self.past, *self.window]

    @property
    def refit_is_due(self) -> bool:
        """Whether enough observations have come to fit all kept ones again."""
        return self.used - self.begun >= self.next_refit

    def count_from(self, count: int) -> None:
        """Let the last `count` observations be the first, after which the next refit is due."""
        self.begun, self.next_refit = self.used - count, max(2 * count, 1)
        self.refitted = []

    def drop(self, member: Member) -> None:
        """Keep an observation no longer."""
        self.window = [each for each in self.window if each is not member]
        self.past = [each for each in self.past if each is not member]

    @property
    def known_in_segments(self) -> NDArray[np.bool_]:
        """Which parameters (n,) are known by throws in segments."""
        known = np.zeros(self.unit.size, dtype=bool)
        for member in self.kept:
            if member.in_segments:
                known[member.likelihood.parameters] = True
        return known

    def before_window(self) -> Gaussian:
        """Return what is known without the observations of the window."""
        return self.retired.plus(*_likelihoods(self.past))

    def add_up(self) -> None:
        """Take into the posterior what all observations say."""
        self.posterior = self.before_window().plus(*_likelihoods(self.window))

    def forget_pair(self, parameters: NDArray[np.int64], *, ground: bool) -> None:
        """Let what is known of some parameters without the kept observations be forgotten.

        What a user gave stays. `parameters` (k,) their indices; `ground`: whether what was known
        before all observations is forgotten as well.
        """
        self.spread[parameters] = self.free[parameters] = 0.0
        self.flatness[parameters] = 1.0
        if ground:
            self.ground = self.ground.without(parameters).joined(self.given().part(parameters))
        self.retired = self.retired.without(parameters).joined(self.ground.part(parameters))

    def begin_trial(self, won: int = 0) -> None:
        """Let what is known now stand against what is published, `won` observations ahead."""
        self.challenger, self.score, self.compared = self.posterior, won * LARGEST_VOTE, won

    def end_trial(self) -> None:
        """Let nothing stand against what is published."""
        self.challenger, self.score, self.compared = None, 0.0, 0

    def initial_spins(self) -> InitialSpins:
        """Return how balls are thrown, by all throws."""
        evidence = self.retired_spins.copy()
        for member in self.kept:
            evidence.add_all(member.likelihood.spins, member.weight)
        return evidence.initial_spins()

    @property
    def families(self) -> dict[tuple[str, ...], NDArray[np.int64]]:
        """Indices (k,) of the parameters of each pair of materials."""
        first, each = len(self.materials), len(PAIR_COEFFICIENTS)
        return {
            pair: first + each * k + np.arange(each)
            for k, pair in enumerate(material_pairs(self.materials))
        }

    def influence(self, observations: Sequence[Observation]) -> NDArray[np.bool_]:
        """Which observation depends on which parameter that is not held, (n_observations, n)."""
        return np.asarray(parameter_influence(observations, self.materials) & ~self.held)

    def fit_task(
        self, cost: Cost, known: Gaussian, weights: NDArray[np.float64] | None = None
    ) -> tuple[NDArray[np.int64], FitTask]:
        """Return the fit to the observations of a cost, by what is known of all n parameters.

        `weights` (n_observations,) with which each counts; None: 1. Returns the indices (k,) of the
        parameters that any of them depends on, and the fit over these.
        """
        influence = self.influence(cost.observations)
        active: NDArray[np.bool_] = np.asarray(influence.any(axis=0))
        parameters = np.flatnonzero(active)
        space = ActiveSpace(self.space, active, self.parameters)
        prior = known.marginal(parameters)
        return parameters, FitTask(cost, space, influence[:, active], prior, weights)

    @property
    def space(self) -> ParameterSpace:
        """Space of the parameters of all known materials; its bounds contain what a user gave."""
        given = None if self.published is None else self.published.given
        bounds = DEFAULT_BOUNDS if given is None else given.prior.bounds
        return ParameterSpace(self.materials, bounds)

    @property
    def held(self) -> NDArray[np.bool_]:
        """Which parameters (n,) have values that a user holds."""
        published = self.published
        if published is None or published.given is None:
            return np.zeros(self.unit.size, dtype=bool)
        return published.given.fixed

    @property
    def parameters(self) -> StaticParameters:
        """θ_s of the present estimate, with the held values as they were given."""
        free = ~self.held
        if self.published is None:
            return self.space.to_parameters(self.unit)
        space = ActiveSpace(self.space, free, self.published.parameters)
        estimate = space.to_parameters(self.unit[free])
        given = parameter_vector(self.published.parameters)
        values = np.where(free, parameter_vector(estimate), given)
        return parameters_of_vector(self.materials, values)

    def given(self) -> Gaussian:
        """Return what a user knows of the parameters besides all observations."""
        published, mean = self.published, self.centre
        if published is None or published.given is None:
            return Gaussian.nothing(mean.size)
        prior = published.given.prior
        return Gaussian.about(prior.mean, prior.information)

    @property
    def prior(self) -> Gaussian:
        """Knowledge before the next observation."""
        return self.posterior.bounded(self.centre)

    @property
    def ends(self) -> NDArray[np.float64]:
        """Standard deviation (n,) of each parameter by its profile, widths."""
        return self.prior.deviations * self.flatness

    def know_materials(self, materials: Sequence[str]) -> None:
        """Take up materials of which nothing is known, beside those there are."""
        together = tuple(dict.fromkeys((*self.materials, *materials)))
        if together == self.materials:
            return
        _, places = parameter_places(self.materials, together)
        space = ParameterSpace(together, self.space.bounds)
        centre = space.to_unit(LearnedParameters.defaults(together).parameters)
        unit = centre.copy()
        centre[places], unit[places] = self.centre, self.unit
        self.materials, self.centre, self.unit = together, centre, unit
        for name, nothing in (("spread", 0.0), ("flatness", 1.0), ("free", 0.0)):
            before = getattr(self, name)
            among = np.full((centre.size, *before.shape[1:]), nothing)
            among[places] = before
            setattr(self, name, among)
        for name in ("ground", "retired", "posterior", "published_information", "challenger"):
            information = getattr(self, name)
            if information is not None:
                setattr(self, name, information.among(places, centre.size))
        self.refitted = [each.among(places, centre.size) for each in self.refitted]
        for member in (*self.kept, *self.doubtful):
            parameters = places[member.likelihood.parameters]
            member.likelihood = replace(member.likelihood, parameters=parameters)
        if self.published is not None:
            self.published = self.published.extended(together)

    def to_json(self) -> str:
        """Return it as JSON text, every number to its last digit."""
        return json.dumps({"format": FORMAT, "state": encoded(self)}, allow_nan=False)

    @staticmethod
    def from_json(text: str) -> OnlineState:
        """Read what `to_json` wrote."""
        try:
            data = json.loads(text)
            if data["format"] == FORMAT:
                return cast(OnlineState, decoded(data["state"], _CLASSES))
        except (json.JSONDecodeError, KeyError, TypeError, ValueError) as error:
            raise InvalidInputError(f"state of on-line learning cannot be read: {error}") from None
        raise InvalidInputError(
            f"state of on-line learning has the format {data['format']!r}; expected {FORMAT!r}"
        )


_PARTS = (OnlineState, Member, Signs, ChangePoint, Refitted, LearnedParameters, Gaussian)
_FOUND = (ObservationFit, LocalLikelihood, SpinEvidence, SpinLikelihood)
_CLASSES: dict[str, type] = {each.__name__: each for each in (*_PARTS, *_FOUND)}
"""Classes of what is remembered, by their names."""


def _likelihoods(members: Sequence[Member]) -> tuple[list[LocalLikelihood], list[float]]:
    """Return what members say of the parameters, and their weights."""
    return [member.likelihood for member in members], [member.weight for member in members]
