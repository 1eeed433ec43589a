"""From observations to the next version of θ_s: search, then identifiability."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.materials import PAIR_COEFFICIENTS, StaticParameters, parameter_places
from intuitive_physics.observation import Observation, observation_materials
from intuitive_physics.parameter_posterior import (
    UNIFORM_PRECISION,
    ParameterPosterior,
    unit_intervals,
    widened_bounds,
)
from intuitive_physics.parameter_space import (
    Bounds,
    ParameterSpace,
    parameter_vector,
    parameters_of_vector,
)
from intuitive_physics.prior_knowledge import GivenKnowledge
from intuitive_physics.simulation import Simulator, make_simulator
from intuitive_physics.trajectory import MEAN_DISTANCE
from intuitive_physics_learner.assessment import assess_observations, reassessed
from intuitive_physics_learner.assessment.undisturbed_motion import (
    undisturbed_misfits,
    worst_of_motions,
)
from intuitive_physics_learner.cost.cost_function import Cost, MakeCost, TrajectoryCost
from intuitive_physics_learner.cost.independent_motions import independent_motions
from intuitive_physics_learner.cost.parameter_influence import parameter_influence
from intuitive_physics_learner.cost.point_noise import detected
from intuitive_physics_learner.errors import NoObservationsError
from intuitive_physics_learner.given_parameters import check_within_bounds
from intuitive_physics_learner.joint_search import JointSearch
from intuitive_physics_learner.joint_search.identifiability import (
    Identifiability,
    identifiability_of_optimum,
)
from intuitive_physics_learner.methods import (
    DEFAULT_METHOD,
    JOINT_METHOD,
    check_method,
    make_search,
)
from intuitive_physics_learner.search.convergence import (
    ConvergenceCriteria,
    SearchProgress,
    SearchResult,
)
from intuitive_physics_learner.search.gaussian import Gaussian
from intuitive_physics_learner.search.learning_task import LearningTask, Motions
from intuitive_physics_learner.search.parameter_search import Search
from intuitive_physics_learner.store.observation_entries import Assessment

JUDGED_SHARE = 0.3
"""Part of a limit of time that is left for the fit that says what is known of a θ_s found by
lowering J; set by hand."""

NEGLIGIBLE_COST = 1e-6
"""m of J that restoring parameters which J does not depend on may cost."""


@dataclass(frozen=True)
class LearningOptions:
    """How to learn.

    Parameters
    ----------
    method : one of `METHODS`
    criteria : when to stop
    seed : of all randomness; the same seed and observations give the same search
    bounds : of the search by kind of parameter; what is left out has its default
    observation_ids : to learn from; none: all that are stored
    distance : in J, for methods that are update rules: one of `trajectory.DISTANCES`
    trusted_ids : of observations that are used as a whole, whatever an assessment says
    """

    method: str = DEFAULT_METHOD
    criteria: ConvergenceCriteria = field(default_factory=ConvergenceCriteria)
    seed: int = 0
    bounds: Mapping[str, Bounds] = field(default_factory=dict)
    observation_ids: Sequence[str] = ()
    distance: str = MEAN_DISTANCE
    trusted_ids: Sequence[str] = ()

    @property
    def course(self) -> dict[str, Any]:
        """What the course of a search over given observations depends on, as plain JSON data."""
        return {
            "method": self.method,
            "distance": self.distance,
            "seed": self.seed,
            "bounds": {kind: asdict(bounds) for kind, bounds in self.bounds.items()},
        }


@dataclass(frozen=True, eq=False)
class LearningResult:
    """The learned θ_s, over all known materials, and the course of the search.

    Parameters
    ----------
    learned : θ_s with its uncertainty
    search : how it went
    assessments : of each observation; empty where the method assesses none, as those that lower J
    """

    learned: LearnedParameters
    search: SearchResult
    assessments: Sequence[Assessment] = ()


def learn(
    observations: Sequence[Observation],
    simulator: Simulator | None = None,
    options: LearningOptions | None = None,
    *,
    previous: LearnedParameters | None = None,
    on_progress: Callable[[SearchProgress], None] | None = None,
    resume: Mapping[str, Any] | None = None,
    on_checkpoint: Callable[[dict[str, Any]], None] | None = None,
    make_cost: MakeCost = TrajectoryCost,
) -> LearningResult:
    """Learn from observations without a store.

    Only parameters that the observations could depend on are searched (`active_parameters`). Where
    the search ends at a θ_s that explains the observations less well than a previous learned one,
    by the measure of its method, that one is kept. Joint estimation uses observations of disturbed
    or mistracked motions up to where that happened (`assess_observations`).

    Parameters
    ----------
    observations : to learn from
    simulator : the engine that simulates candidates, by whose flag (`stopped_by`) learning
        is cancelled; None: `auto`, with one thread
    options : how to learn; None: all as `LearningOptions` has it
    previous : θ_s to start from; None starts from the defaults. Its materials that were not
        observed do not change, nor do parameters that J does not depend on. What a user gave
        (`LearnedParameters.given`) holds: fixed values are not searched, and joint estimation takes
        priors as such; rules that lower J only begin at their values.
    on_progress : called after each step of the search
    resume : what `on_checkpoint` was given by a search with the same observations, options and
        previous θ_s, which continues exactly as if it had not stopped
    on_checkpoint : called about once a second with the state of the search, as plain JSON data
    make_cost : what evaluates J; by default this process

    Raises
    ------
    NoObservationsError
        When there are no observations.
    UnknownMethodError
        When no method has the name given.
    UnsupportedSceneError
        When the simulator cannot express an observation.
    SimulationStoppedError
        When the simulator's flag was set.
    InvalidInputError
        When no object was seen with anything it could touch, all that could be searched is held, a
        given value lies outside the bounds, `resume` is of another search, or the method has no
        distance to choose (`check_method`).
    """
    simulator = simulator or make_simulator("auto")
    clean, assessments, options = _assessed(observations, options or LearningOptions())
    previous, task = _begin(clean, simulator, options, previous, make_cost)
    search = make_search(options.method, task, np.random.default_rng(options.seed))
    identity = _identity(options, task, previous)
    if resume is not None:
        _check_same_task(resume, identity)
        search.load_state(resume["search"])
    began, limit = time.monotonic(), options.criteria.time_limit

    def seconds_left() -> float:
        return np.inf if limit is None else limit - (time.monotonic() - began)

    outcome = search.run(
        options.criteria,
        on_progress=on_progress,
        on_checkpoint=on_checkpoint
        and (lambda state: on_checkpoint({**identity, "search": state})),
        reserve=lambda seconds: 0.0 if limit is None else _reserved(search, task, seconds, limit),
    )
    if task.start_was_learned and search.keep_start(task):
        kept = search.best_parameters
        outcome = replace(outcome, parameters=kept, cost=float(task.cost.costs([kept])[0]))
    fitted = _fitted(search)
    if fitted is None:
        identifiability = identifiability_of_optimum(task, search.best_parameters, seconds_left)
    else:
        later = 0.0 if limit is None else fitted.followed_share * limit
        identifiability = fitted.identifiability(task, lambda: seconds_left() - later)
    parameters = _unresponsive_restored(task, outcome, identifiability)
    learned = _merged(
        previous,
        task.space,
        parameters,
        identifiability,
        cost=float(task.cost.costs([parameters])[0]),
        observation_count=len(observations),
        method=options.method,
        initial_spins=previous.initial_spins.updated(search.initial_spins()),
    )
    if fitted is not None:
        generator = np.random.default_rng([options.seed, 1])
        misfits = undisturbed_misfits(fitted.fit, simulator, generator, seconds_left)
        if task.motions is not None:
            misfits = worst_of_motions(*misfits, task.motions.origins)
        assessments = reassessed(assessments, *misfits, trusted=options.trusted_ids)
    return LearningResult(learned, outcome, assessments)


def _assessed(
    observations: Sequence[Observation], options: LearningOptions
) -> tuple[Sequence[Observation], Sequence[Assessment], LearningOptions]:
    """Return what is clean of observations, assessments, and options with the time that is left."""
    if options.method != JOINT_METHOD:
        return observations, (), options
    began = time.monotonic()
    clean, assessments = assess_observations(observations, options.trusted_ids)
    criteria = options.criteria.after(time.monotonic() - began)
    return clean, assessments, replace(options, criteria=criteria)


def _fitted(search: Search) -> JointSearch | None:
    """Return a search that fits trajectories; None where it lowers J."""
    return search if isinstance(search, JointSearch) and search.fits_trajectories else None


def _reserved(search: Search, task: LearningTask, seconds: float, limit: float) -> float:
    """Return the s of a limit of time to leave for what comes after a search of some s."""
    fitted = _fitted(search)
    if fitted is None:
        return JUDGED_SHARE * limit
    return fitted.followed_share * limit + fitted.identifiability_seconds(task, seconds)


def _begin(
    observations: Sequence[Observation],
    simulator: Simulator,
    options: LearningOptions,
    previous: LearnedParameters | None,
    make_cost: MakeCost,
) -> tuple[LearnedParameters, LearningTask]:
    """Return θ_s to begin from, over all materials, and the task of the search."""
    check_method(options.method, options.distance)
    if not observations:
        raise NoObservationsError("there are no observations; expected at least one")
    observed = observation_materials(observations)
    if previous is None:
        previous = LearnedParameters.defaults(observed)
    previous = previous.extended(tuple(dict.fromkeys((*previous.materials, *observed))))
    # In the order of all known materials, so that a pair has the same name in both.
    materials = tuple(name for name in previous.materials if name in observed)

    def cost_of(some: Sequence[Observation]) -> Cost:
        return make_cost(some, simulator, materials, options.distance)

    cost = cost_of(observations)
    start = previous.parameters.extended(materials)
    influence = parameter_influence(observations, materials)
    if not influence.any():
        raise InvalidInputError(
            "no object was seen with anything it could touch; expected observations with planes, "
            "boxes or several objects"
        )
    space = ParameterSpace(materials, options.bounds)
    given = None if previous.given is None else previous.given.extended(materials)
    if given is not None:
        influence &= ~given.fixed
        if not influence.any():
            raise InvalidInputError(
                "all parameters that the observations could depend on are held; set one of them as "
                "a prior or a start"
            )
    task = LearningTask(
        cost,
        space,
        influence,
        start,
        motions=_motions(observations, cost_of, materials, np.asarray(influence.any(axis=0))),
        simulator=simulator,
        start_was_learned=previous.version > 0,
    )
    prior = None if given is None else _given_prior(task, given)
    return previous, replace(task, knowledge=prior)


def _motions(
    observations: Sequence[Observation],
    cost_of: Callable[[Sequence[Observation]], Cost],
    materials: Sequence[str],
    active: NDArray[np.bool_],
) -> Motions | None:
    """Return the independent motions in observations; None where they are the same.

    `active` (|θ_s|,) bool, which parameters are searched.
    """
    parts, origins = independent_motions([detected(observation) for observation in observations])
    objects = [thing for each in observations for thing in each.objects]
    if len(parts) == len(observations) and all(thing.detections is None for thing in objects):
        return None
    return Motions(cost_of(parts), parameter_influence(parts, materials) & active, origins)


def _given_prior(task: LearningTask, given: GivenKnowledge) -> Gaussian | None:
    """Return what a user gave of the active parameters; None where that is nothing."""
    space, prior = task.space, given.prior
    check_within_bounds(task.start, given.fixed, space.bounds)
    with_prior = np.asarray(prior.factor.any(axis=0))
    check_within_bounds(prior.space.to_parameters(prior.mean), with_prior, space.bounds)
    active = task.active
    if not with_prior[active].any():
        return None
    prior = prior.within(space.bounds)
    mean = np.where(with_prior, prior.mean, space.to_unit(task.start))
    precision = prior.information + UNIFORM_PRECISION * np.eye(space.size)
    return Gaussian.about(mean, precision).marginal(np.flatnonzero(active))


def _identity(
    options: LearningOptions, task: LearningTask, previous: LearnedParameters
) -> dict[str, Any]:
    """Return what must be the same for a search to continue, as plain JSON data."""
    return {
        **options.course,
        "observations": [observation.id for observation in task.cost.observations],
        "start": task.start.to_dict(),
        "given": None if previous.given is None else previous.given.to_dict(),
    }


def _check_same_task(resume: Mapping[str, Any], task: Mapping[str, Any]) -> None:
    for key, expected in task.items():
        if resume.get(key) != expected:
            raise InvalidInputError(
                f"saved state is of a search with other {key}; expected one with the same "
                f"{', '.join(task)}; learn without it to begin again"
            )


def _unresponsive_restored(
    task: LearningTask, result: SearchResult, identifiability: Identifiability
) -> StaticParameters:
    """Set what J does not depend on back to its start: a search moves it at random."""
    responsive = identifiability.responsive
    values = np.where(responsive, parameter_vector(result.parameters), parameter_vector(task.start))
    m = len(result.parameters.materials)
    frictions = values[m:].reshape(-1, len(PAIR_COEFFICIENTS))
    free = ~responsive[m:].reshape(frictions.shape)
    static, dynamic = frictions[:, 0], frictions[:, 1]
    static[free[:, 0]] = np.maximum(static, dynamic)[free[:, 0]]
    dynamic[free[:, 1]] = np.minimum(static, dynamic)[free[:, 1]]
    settled = parameters_of_vector(result.parameters.materials, values)
    if task.cost.costs([settled])[0] <= result.cost + NEGLIGIBLE_COST:
        return settled
    return result.parameters


def _merged(
    previous: LearnedParameters,
    space: ParameterSpace,
    parameters: StaticParameters,
    identifiability: Identifiability,
    **others: Any,
) -> LearnedParameters:
    """The next version of θ_s, over all known materials, with its other fields as given."""
    _, searched = parameter_places(parameters.materials, previous.materials)
    values = parameter_vector(previous.parameters)
    deviations = previous.standard_deviations.copy()
    identified = previous.identified.copy()
    intervals = previous.intervals.copy()
    fixed = np.zeros(values.size, dtype=bool) if previous.given is None else previous.given.fixed
    free = ~fixed[searched]
    values[searched[free]] = parameter_vector(parameters)[free]
    responsive = searched[identifiability.responsive]
    deviations[responsive] = identifiability.standard_deviations[identifiability.responsive]
    identified[responsive] = identifiability.identified[identifiability.responsive]
    intervals[responsive] = identifiability.intervals[identifiability.responsive]
    merged = parameters_of_vector(previous.materials, values)
    information = np.zeros((values.size, values.size))
    information[np.ix_(searched, searched)] = identifiability.information
    unit = ParameterSpace(merged.materials, space.bounds).to_unit(merged)
    new = ParameterPosterior.from_information(merged.materials, unit, information, space.bounds)
    bounds = widened_bounds(space.bounds, merged)
    new, known = new.within(bounds), previous.whole_posterior(space.bounds).within(bounds)
    posterior = known.renewed(
        np.isin(np.arange(values.size), responsive),
        known.space.to_unit(merged),
        new.information,
        unit_intervals(known.space, merged, intervals),
    )
    if previous.given is not None:
        posterior = previous.given.imposed_on(posterior, merged)
    return replace(
        previous,
        parameters=merged,
        standard_deviations=deviations,
        identified=identified,
        intervals=intervals,
        posterior=posterior,
        version=previous.version + 1,
        **others,
    )
