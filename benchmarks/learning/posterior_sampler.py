"""The learned posterior beside one that a sampler of others finds: emcee.

The sampler gets the loss of the joint fit (`docs/method/joint_estimation.md`) as minus the
logarithm of a density of θ_s and of all initial states together, by the functions of the fit
itself, with the fit horizons and weights at which it ended. Nothing is linearised, and nothing is
widened. So what differs is due to the approximations of the learner: slopes at one estimate, and
the standard deviations that it makes larger.

Foreman-Mackey, Hogg, Lang and Goodman (2013), *emcee: The MCMC hammer*. In 49 dimensions its moves
by differences of two walkers (Ter Braak 2006; snooker: Ter Braak and Vrugt 2008) need a third of
the steps of its default, the stretch.
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
from intuitive_physics_learner.joint_estimation.joint_search import JointSearch
from intuitive_physics_learner.joint_estimation.linearisation import residuals_at
from intuitive_physics_learner.search.learning_task import LearningTask

WALKERS = 200  # at least twice the 49 dimensions
STEPS, QUICK_STEPS = 1000, 20  # of all walkers; the first half is left out
LEARNED_DRAWS = 20_000  # of the learned posterior, for its moments
MOVES = (("DEMove", 0.8), ("DESnookerMove", 0.2))  # with their shares, as emcee proposes

LogDensity = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""Logarithms (c,) of a density at points (c, k), up to a constant."""


class FitDensity:
    """Density of θ_s and initial states by the loss of a fit.

    A point (k,) is θ_s on the unit cube, then the deviations from the observed initial states of
    all observations, block after block, in SI units.
    """

    def __init__(self, fit: JointFit) -> None:
        self._model, self._estimate = fit.model, fit.estimate
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
            losses += part.losses(block, tried, residuals) @ part.weights
        return losses

    def starts(self, units: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
        """Return points (c, k) of θ_s `units` (c, n), with initial states drawn by the slopes."""
        model = self._model
        equations = model.equations(self._estimate, model.linearised(self._estimate))
        _, eliminated = model.posterior(equations)
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
    moves: Any = [(getattr(emcee.moves, name)(), share) for name, share in MOVES]
    sampler = emcee.EnsembleSampler(*starts.shape, density, moves=moves, vectorize=True)
    # emcee takes its random numbers from NumPy's old generator.
    state = np.random.RandomState(seed).get_state()
    sampler.run_mcmc(emcee.State(starts, random_state=state), steps)
    chain = sampler.get_chain(discard=steps // 2)
    with np.errstate(invalid="ignore"):  # a walker that never moved
        times = emcee.autocorr.integrated_time(chain[..., :n], tol=0, quiet=True)
    return Chains(chain, float(np.max(times)))


@dataclass(frozen=True, eq=False)
class Moments:
    """Mean and standard deviation (n,) of each parameter, in widths, and their correlations."""

    mean: NDArray[np.float64]
    deviation: NDArray[np.float64]
    correlation: NDArray[np.float64]

    @staticmethod
    def of(draws: NDArray[np.float64], log_weights: NDArray[np.float64] | None = None) -> Moments:
        """Take them of draws (c, n), each by its weight."""
        logs = np.zeros(len(draws)) if log_weights is None else log_weights
        weights = np.exp(logs - logs.max())
        covariance = np.cov(draws.T, aweights=weights)
        deviation = np.sqrt(np.diag(covariance))
        correlation = covariance / np.outer(deviation, deviation)
        return Moments(np.average(draws, axis=0, weights=weights), deviation, correlation)

    @property
    def largest_correlation(self) -> float:
        """That of two different parameters, with its sign."""
        others = self.correlation[np.triu_indices(len(self.mean), 1)]
        return float(others[np.argmax(np.abs(others))])


@dataclass(frozen=True, eq=False)
class Comparison:
    """Moments by the learner and by the sampler, of the loss' prior and of a uniform one."""

    truth: NDArray[np.float64]
    learned: Moments
    sampled: Moments
    uniform: Moments
    learned_seconds: float
    sampled_seconds: float
    steps: int
    autocorrelation_time: float
    dimensions: int


def compare(seed: int, steps: int) -> Comparison:
    """Learn and sample the posterior in the world of a seed."""
    rng = np.random.default_rng(seed)
    world = draw_world(rng)
    simulator = make_simulator("auto", threads=THREADS)
    checkpoint: dict[str, Any] = {}
    # Whole observations, so that both have the same points.
    options = LearningOptions(trusted_ids=[each.id for each in world.observations])
    began = time.perf_counter()
    result = learn(world.observations, simulator, options, on_checkpoint=checkpoint.update)
    learned_seconds = time.perf_counter() - began
    posterior = result.learned.whole_posterior()
    fit = _fit_of(
        world,
        TrajectoryCost(world.observations, simulator, world.space.materials),
        checkpoint["search"],
        rng,
    )
    density = FitDensity(fit)
    starts = density.starts(posterior.draw(WALKERS, rng)[:, world.places], rng)
    began = time.perf_counter()
    n = len(world.places)
    chains = sample(density, starts, steps, n, int(rng.integers(2**32)))
    sampled_seconds = time.perf_counter() - began
    sampled = chains.points[..., :n].reshape(-1, n)
    return Comparison(
        world.truth[world.places],
        Moments.of(posterior.draw(LEARNED_DRAWS, rng)[:, world.places]),
        Moments.of(sampled),
        Moments.of(sampled, fit.prior.losses(sampled)),
        learned_seconds,
        sampled_seconds,
        steps,
        chains.autocorrelation_time,
        starts.shape[1],
    )


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
    try:
        found = compare(first_seed, QUICK_STEPS if quick else STEPS)
    except MissingPeerError as missing:
        return Outcome(complaints=[f"sampler left out: {missing}"])
    return Outcome([_parameters_table(found), _cost_table(found)])


def _parameters_table(found: Comparison) -> Table:
    columns = [Column("parameter of ball and room"), Column("truth", "width", ".4f")]
    cells: list[NDArray[np.float64]] = [found.truth]
    ways = {"learned": found.learned, "emcee": found.sampled, "emcee, uniform prior": found.uniform}
    for kind in ("mean", "deviation"):
        for way, moments in ways.items():
            columns.append(Column(f"{kind}, {way}", "width", ".4f"))
            cells.append(getattr(moments, kind))
    return Table(
        "The posterior of one set, learned and by emcee",
        columns,
        [[name, *row] for name, *row in zip(PAIR_COEFFICIENTS, *cells, strict=True)],
        note=(
            f"One sphere, {found.dimensions - len(PAIR_COEFFICIENTS)} components of initial "
            "states, the loss of the joint fit with its horizons and weights. Its prior of θ_s is "
            "normal about the defaults; the learned posterior is uniform where nothing is known, "
            "so the last columns weigh emcee's draws to a uniform prior. Deviations are standard "
            "deviations; 0.2887 is that of a uniform number."
        ),
    )


def _cost_table(found: Comparison) -> Table:
    effective = found.steps // 2 * WALKERS / found.autocorrelation_time
    return Table(
        "What both took",
        [
            Column("way"),
            Column("wall time", "s", ".1f"),
            Column("largest correlation of two parameters", "", ".2f"),
            Column("independent draws, about", "", ".0f"),
        ],
        [
            ["learned", found.learned_seconds, found.learned.largest_correlation, None],
            ["emcee", found.sampled_seconds, found.sampled.largest_correlation, effective],
        ],
        note=(
            f"emcee: {WALKERS} walkers, {found.steps} steps, the second half counted; independent "
            "draws by the longest autocorrelation time of θ_s, which is too short where it is not "
            "far below the number of steps."
        ),
    )
