"""The learned posterior beside one that a sampler of others finds: emcee.

The sampler gets the loss of the joint fit (`docs/method/joint_estimation.md`) as minus the
logarithm of a density of θ_s and of all initial states together, by the functions of the fit
itself, with the fit horizons and weights at which it ended. Nothing is linearised, and nothing is
widened. So what differs is due to the approximations of the learner: slopes at one estimate, and
the standard deviations that it makes larger.

Foreman-Mackey, Hogg, Lang and Goodman (2013), *emcee: The MCMC hammer*. In 49 dimensions its move
by differences of two walkers (Ter Braak 2006) needs a third of the steps of its default, the
stretch. Its snooker move must not be used: in emcee 3.1.6 it finds 0.72 for the standard
deviations of a standard normal distribution of 49 dimensions.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.command import Outcome, report_progress
from benchmarks.learning.paper_sets import THREADS
from benchmarks.learning.posterior_ranks import World, draw_world
from benchmarks.peers.engine import MissingPeerError
from benchmarks.results.result import Column, Table
from intuitive_physics.materials import PAIR_COEFFICIENTS, StaticParameters
from intuitive_physics.simulation import make_simulator
from intuitive_physics_learner import LearningOptions, TrajectoryCost, learn
from intuitive_physics_learner.cost.parameter_influence import parameter_influence
from intuitive_physics_learner.joint_estimation.joint_fit import JointFit
from intuitive_physics_learner.joint_estimation.linearisation import residuals_at
from intuitive_physics_learner.joint_search.joint_search import JointSearch
from intuitive_physics_learner.search.learning_task import LearningTask

WALKERS = 200  # at least twice the 49 dimensions
STEPS, QUICK_STEPS = 1200, 20  # of all walkers; the first half is left out
LEARNED_DRAWS = 20_000  # of the learned posterior, for its moments

LogDensity = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""Logarithms (c,) of a density at points (c, k), up to a constant."""


class FitDensity:
    """Density of θ_s and initial states by the loss of a fit.

    A point (k,) is θ_s on the unit cube, then the deviations from the observed initial states of
    all observations, block after block, in SI units.
    """

    def __init__(self, fit: JointFit) -> None:
        self._model, self._estimate, self._weights = fit.model, fit.estimate, fit.weights
        self._parts = list(fit.model.parts(fit.estimate))

    def __call__(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the logarithms (c,) at points (c, k): minus infinity outside of the cube."""
        n = self._estimate.unit.size
        inside = ((points[:, :n] >= 0.0) & (points[:, :n] <= 1.0)).all(axis=1)
        losses = np.full(len(points), np.inf)
        if inside.any():
            losses[inside] = self._losses(points[inside, :n], points[inside, n:])
        return -losses

    def _losses(
        self, units: NDArray[np.float64], states: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        candidates = [self._model.space.to_parameters(unit) for unit in units]
        index = np.arange(len(units))[:, None]
        losses = self._model.prior.losses(units)
        ends = np.cumsum([part.estimate.size for _, part in self._parts])[:-1]
        for (block, part), flat in zip(self._parts, np.split(states, ends, axis=1), strict=True):
            tried = flat.reshape(-1, *part.estimate.shape)
            residuals = residuals_at(
                self._model.cost, block, tried, candidates, index, part.horizons
            )
            losses += part.losses(block, tried, residuals) @ self._weights[block.members]
        return losses

    def starts(self, units: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
        """Return points (c, k) of θ_s `units` (c, n), with initial states drawn by the slopes."""
        model = self._model
        equations = model.equations(self._estimate, model.linearised(self._estimate))
        eliminated = [each.eliminated() for each in equations]
        columns = [units]
        for (_, part), equation, left in zip(self._parts, equations, eliminated, strict=True):
            d = equation.state_size
            roots = np.linalg.cholesky(np.linalg.inv(equation.hessian[:, :d, :d]))
            errors = rng.standard_normal((len(units), *part.estimate.shape))
            steps = [left.state_steps(unit - self._estimate.unit) for unit in units]
            states = part.estimate + steps + np.einsum("wij,cwj->cwi", roots, errors)
            columns.append(states.reshape(len(units), -1))
        return np.hstack(columns)


@dataclass(frozen=True, eq=False)
class Chains:
    """Points (steps, walkers, k) of the second half of emcee's chains, and its estimate of τ.

    τ is the integrated autocorrelation time in steps of the slowest of the first `n` coordinates;
    NaN where the chains are too short.
    """

    points: NDArray[np.float64]
    autocorrelation_time: float


def sample(
    density: LogDensity, starts: NDArray[np.float64], steps: int, n: int, seed: int
) -> Chains:
    """Run emcee from `starts` (walkers, k).

    Raises
    ------
    MissingPeerError
        Where emcee is not installed.
    """
    try:
        import emcee
    except ImportError:
        raise MissingPeerError("emcee is missing; `tools/bench_packages.sh emcee`") from None
    move = emcee.moves.DEMove()
    sampler = emcee.EnsembleSampler(*starts.shape, density, moves=move, vectorize=True)
    # emcee takes its random numbers from NumPy's old generator.
    state = np.random.RandomState(seed).get_state()
    sampler.run_mcmc(emcee.State(starts, random_state=state), steps)
    chain = sampler.get_chain(discard=steps // 2)
    with np.errstate(invalid="ignore"):  # a walker that never moved
        times = emcee.autocorr.integrated_time(chain[..., :n], tol=0, quiet=True)
    return Chains(chain, float(np.max(times)))


@dataclass(frozen=True, eq=False)
class Way:
    """A way to the posterior: what it says of n parameters, and what it took.

    Mean and standard deviation (n,) are in widths; the correlation is the largest of two different
    parameters, with its sign. None: not measured.
    """

    name: str
    mean: NDArray[np.float64]
    deviation: NDArray[np.float64]
    correlation: float
    seconds: float | None = None
    independent: float | None = None

    @staticmethod
    def of(
        name: str,
        draws: NDArray[np.float64],
        log_weights: NDArray[np.float64] | None = None,
        **cost: float,
    ) -> Way:
        """Return the moments of weighted draws (c, n); `cost`: seconds, and independent draws."""
        logs = np.zeros(len(draws)) if log_weights is None else log_weights
        weights = np.exp(logs - logs.max())
        covariance = np.cov(draws.T, aweights=weights)
        deviation = np.sqrt(np.diag(covariance))
        correlations = covariance / np.outer(deviation, deviation)
        correlations = correlations[np.triu_indices_from(correlations, 1)]
        largest = float(correlations[np.argmax(np.abs(correlations))])
        return Way(name, np.average(draws, axis=0, weights=weights), deviation, largest, **cost)


def compare(seed: int, steps: int) -> tuple[NDArray[np.float64], list[Way]]:
    """Learn and sample the posterior in the world of a seed; return the truth (n,) and the ways."""
    rng = np.random.default_rng(seed)
    world = draw_world(rng)
    simulator = make_simulator("auto", threads=THREADS)
    cost = TrajectoryCost(world.observations, simulator, world.space.materials)
    checkpoint: dict[str, Any] = {}
    # Whole observations, so that both have the same points.
    options = LearningOptions(trusted_ids=[each.id for each in world.observations])
    began = time.perf_counter()
    result = learn(world.observations, simulator, options, on_checkpoint=checkpoint.update)
    learned = time.perf_counter() - began
    posterior = result.learned.whole_posterior()
    fit = _fit_of(world, cost, checkpoint["search"], rng)
    density = FitDensity(fit)
    starts = density.starts(posterior.draw(WALKERS, rng)[:, world.places], rng)
    n = len(world.places)
    began = time.perf_counter()
    chains = sample(density, starts, steps, n, int(rng.integers(2**32)))
    sampled = time.perf_counter() - began
    draws = chains.points[..., :n].reshape(-1, n)
    effective = len(draws) / chains.autocorrelation_time
    return world.truth[world.places], [
        Way.of("learned", posterior.draw(LEARNED_DRAWS, rng)[:, world.places], seconds=learned),
        Way.of("emcee", draws, seconds=sampled, independent=effective),
        Way.of("emcee, uniform prior", draws, fit.prior.losses(draws)),
    ]


def _fit_of(
    world: World, cost: TrajectoryCost, state: dict[str, Any], rng: np.random.Generator
) -> JointFit:
    """Return the fit at which learning ended, of its last checkpoint."""
    influence = parameter_influence(world.observations, cost.materials)
    start = StaticParameters.uniform(cost.materials)
    search = JointSearch(LearningTask(cost, world.space, influence, start), rng)
    search.load_state(state)
    return search.fit


def measure(quick: bool, first_seed: int) -> Outcome:
    """Compare for one set; where emcee is missing, say so."""
    report_progress("the posterior of one set, learned and sampled")
    steps = QUICK_STEPS if quick else STEPS
    try:
        truth, ways = compare(first_seed, steps)
    except MissingPeerError as missing:
        return Outcome(complaints=[f"sampler left out: {missing}"])
    kinds = {"mean": [way.mean for way in ways], "deviation": [way.deviation for way in ways]}
    parameters = Table(
        "The posterior of one set, learned and by emcee",
        [
            Column("parameter of ball and room"),
            Column("truth", "width", ".4f"),
            *(Column(f"{kind}, {way.name}", "width", ".4f") for kind in kinds for way in ways),
        ],
        list(zip(PAIR_COEFFICIENTS, truth, *kinds["mean"], *kinds["deviation"], strict=True)),
        note=(
            "One sphere, five throws, the loss of the joint fit with its horizons and weights. Its "
            "prior of θ_s is normal about the defaults; the learned posterior is uniform where "
            "nothing is known, so the last columns weigh emcee's draws to a uniform prior. "
            "0.2887 is the standard deviation of a uniform number."
        ),
    )
    cost = Table.of(
        "What both took",
        ways,
        [
            (Column("way"), lambda w: w.name),
            (Column("wall time", "s", ".1f"), lambda w: w.seconds),
            (Column("largest correlation of two parameters", "", ".2f"), lambda w: w.correlation),
            (Column("independent draws, about", "", ".0f"), lambda w: w.independent),
        ],
        note=(
            f"emcee: {WALKERS} walkers, {steps} steps, the second half counted; independent draws "
            "by the longest autocorrelation time of θ_s, which is found too short where the chains "
            "are."
        ),
    )
    return Outcome([parameters, cost])
