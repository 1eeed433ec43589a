"""Fits to the same observations from several starts, and how they are compared.

A fit goes downhill from where it begins, and motion among contacts has many optima. So fits begin
at several places of the prior. They are cheap as long as their horizons are short; then the worse
ones are dropped (as by successive halving, Jamieson and Talwalkar 2016, *Non-stochastic best arm
identification and hyperparameter optimization*). Where the best one has ended and not all motions
are explained, another fit begins at its θ_s, with initial states as they were observed: some of
those that were found have taken a wrong turn while θ_s was still wrong. Both may end at different
places that the observations cannot tell apart, and how far these lie apart is part of the
uncertainty.

Where boxes tumble the loss has jumps, where contacts come in another order, some standard
deviations of an initial state apart. A fit ends between them, in one of many places, and by how
much its evidence differs from that of another fit is chance rather than knowledge.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.parameter_posterior import UNIFORM_PRECISION
from intuitive_physics_learner.joint_estimation.joint_fit import (
    FIXED_HORIZONS,
    LARGEST_VOTE,
    JointEstimationSettings,
    JointFit,
)
from intuitive_physics_learner.joint_estimation.observation_blocks import observation_blocks
from intuitive_physics_learner.search.gaussian import Gaussian
from intuitive_physics_learner.search.learning_task import FitTask
from intuitive_physics_learner.search.plain_state import Resumable

STARTS = 4
"""Fits that begin, the first at the start of the task; set by hand: within the 4 s of a small
set, six and eight that do not scan their parameters in the first steps did no better."""

DROP_STEPS = 4
"""Steps after which all but the best fits are dropped: then horizons are about 1 s; set by hand."""

LEFT = 2
"""Fits that are left then at most: a second one where evidence cannot tell them apart."""

SCORING_STEPS = 3
"""Joint steps up to a common horizon before evidences are compared; set by hand."""

CHANCE_EVIDENCE = 10.0
"""Difference of log evidences that fits to chaotic motion have by chance, where they end between
jumps of the loss: two of six fits to each of 20 boxes differ by 15, half of them by less than 11.
With it instead of 1, of 74 parameters of 30 sets 71 instead of 68 are within two standard
deviations; set by hand."""


def drawn_starts(
    prior: Gaussian, count: int, generator: np.random.Generator
) -> NDArray[np.float64]:
    """Draw points (count, n) of the unit cube that are spread as the prior is.

    By a Latin hypercube (McKay, Beckman and Conover 1979): each parameter takes a value in each of
    `count` equal parts of its range. That range is the unit interval where only its bounds are
    known, else it is drawn together about the prior's mean.
    """
    n = prior.mean.size
    cells = np.array([generator.permutation(count) for _ in range(n)]).reshape(n, count).T
    uniform = (cells + generator.random((count, n))) / count
    narrowing = np.minimum(prior.deviations * np.sqrt(UNIFORM_PRECISION), 1.0)
    return np.clip(prior.mean + narrowing * (uniform - prior.mean), 0.0, 1.0)


def durations(fit: JointFit) -> NDArray[np.float64]:
    """Time (n_observations,) in s of the last point of each observation."""
    ends = np.empty(len(fit.model.cost.observations))
    for block in fit.model.blocks:
        ends[block.members] = block.durations
    return ends


def log_evidences(
    task: FitTask, solution: JointFit, horizons: ArrayLike, steps: int = SCORING_STEPS
) -> tuple[NDArray[np.float64], float]:
    """Return ln ∫ p(points up to horizons | θ_s) p(θ_s) dθ_s by Laplace's approximation, in parts.

    `horizons` (n_observations,) s, the last time of each that counts; evidences up to different
    ones do not compare; `steps` : joint steps up to there that come first. Returns those of each
    observation (n_observations,), near the estimate and by the task's weights; and that of θ_s: its
    prior there, and how much the observations narrow it.
    """
    prior = task.prior
    fit = JointFit(task, FIXED_HORIZONS, solution.model.stated_blocks)
    ends = np.minimum(horizons, durations(fit)).tolist()
    fits = zip(solution.observation_fits(), ends, strict=True)
    begun = [replace(each, horizon=end) for each, end in fits]
    fit.begin_at(solution.unit, prior.deviations if steps else solution.deviations, begun)
    for _ in range(steps):
        fit.step()
    likelihoods = fit.likelihoods()
    precision = prior.plus(likelihoods, task.weights).precision
    narrowed = np.linalg.slogdet(precision)[1] - np.linalg.slogdet(prior.precision)[1]
    losses = task.weights * np.array([likelihood.loss for likelihood in likelihoods])
    solution.model.simulations += fit.model.simulations
    return -losses, -float(prior.losses(fit.unit[None])[0]) - 0.5 * float(narrowed)


def compared_evidences(
    task: FitTask,
    fits: Sequence[JointFit],
    steps: int = SCORING_STEPS,
    beyond: Sequence[float] = (0.0,),
) -> NDArray[np.float64]:
    """Return the log evidences (n_fits,) of fits, the mean over times up to which points count.

    These are `beyond`, in s, after the longest horizon of each observation: up to the horizons of
    one fit that one would have the advantage, as that is where it explains the motion. Each time a
    single observation counts up to `LARGEST_VOTE` below the fit that explains it best: beyond where
    a fit explains it, it differs by thousands, and that says only that the fit took a wrong turn.
    """
    longest, total = np.max([fit.horizons for fit in fits], axis=0), np.zeros(len(fits))
    for farther in beyond:
        parts = [log_evidences(task, fit, longest + farther, steps) for fit in fits]
        of_points = np.array([points for points, _ in parts])
        votes = np.maximum(of_points, of_points.max(axis=0) - LARGEST_VOTE)
        total += votes.sum(axis=1) + [of_parameters for _, of_parameters in parts]
    return total / len(beyond)


class SeveralStarts(Resumable):
    """Fits to the same observations from several starts.

    `starts` (n_starts, n) points of the unit cube.

    Attributes
    ----------
    fits : those that were not dropped, the best one so far first
    starts : (n_fits, n) where each began
    steps : that the fits have taken
    spread : (n,) widths², mean square of the differences of other fits from the best one, each
        weighted by its evidence, of which `CHANCE_EVIDENCE` is chance; zero before `choose`
    """

    remembered = ("starts", "steps", "_may_begin_again", "_dropped_simulations", "spread")

    def __init__(
        self, task: FitTask, settings: JointEstimationSettings, starts: NDArray[np.float64]
    ) -> None:
        self.task, self._settings = task, settings
        self.starts = starts
        self.steps = 0
        # One start is for what little time there is.
        self._may_begin_again = len(starts) > 1
        self.spread = np.zeros(starts.shape[1])
        self._dropped_simulations = 0.0
        nothing = [None] * len(task.influence)
        blocks = observation_blocks(task.cost.observations, task.influence)
        self.fits = []
        for start in starts:
            fit = JointFit(task, settings, blocks)
            fit.begin_at(start, task.prior.deviations, nothing)
            self.fits.append(fit)

    @property
    def best(self) -> JointFit:
        """The fit that explains the observations best."""
        return self.fits[0]

    @property
    def settled(self) -> bool:
        """Whether all fits have converged, and none is to begin again."""
        return self._have_settled and not self._begins_again

    @property
    def ends_early(self) -> NDArray[np.bool_]:
        """Whether of an observation (n_observations,) that counts not all points are explained."""
        return np.asarray(self.task.counted & (self.best.horizons < durations(self.best)))

    @property
    def simulations(self) -> float:
        """Simulations of single observations so far, those of dropped fits included."""
        return self._dropped_simulations + sum(fit.model.simulations for fit in self.fits)

    @property
    def choice_simulations(self) -> float:
        """Simulations of single observations that `choose` takes, about."""
        if len(self.fits) == 1:
            return 0.0
        each = sum(fit.model.simulations / max(fit.steps, 1) for fit in self.fits)
        return (SCORING_STEPS + 1) * each

    def step(self) -> None:
        """Take a step of each fit that has not settled; drop the worse ones when it is time.

        Where all have settled, another one begins at the best θ_s.
        """
        if self._have_settled and self._begins_again:
            if len(self.fits) > 1:
                self._order(compared_evidences(self.task, self.fits))
            self._may_begin_again = False
            self.add(self._begun_again())
        for fit in self.fits:
            if not fit.settled:
                fit.step()
        self.steps += 1
        if self.steps == DROP_STEPS and len(self.fits) > 1:
            evidences = self._order(compared_evidences(self.task, self.fits, 0))
            alike = int((evidences > evidences[0] - CHANCE_EVIDENCE).sum())
            self.keep(min(alike, LEFT))

    def keep(self, count: int) -> None:
        """Drop all fits but the first ones."""
        self._dropped_simulations += sum(fit.model.simulations for fit in self.fits[count:])
        self.fits, self.starts = self.fits[:count], self.starts[:count]

    def seconds_of_one(self, seconds: float) -> float:
        """Return the time in s that one fit takes to its end, if a step of all took `seconds`.

        A step takes as long as its horizons are, and these grow by one advance at most.
        """
        fit = self.best
        horizon = float(np.mean(fit.horizons))
        duration = float(np.mean(durations(fit)))
        steps = (duration - horizon) / fit.model.largest_advance
        return seconds / len(self.fits) * steps * 0.5 * (horizon + duration) / horizon

    def add(self, fit: JointFit) -> None:
        """Let another fit to the same observations be chosen from, too."""
        self.fits.append(fit)
        self.starts = np.vstack([self.starts, fit.unit])

    def choose(self, beyond: Sequence[float] = (0.0,)) -> None:
        """Let the fit of the largest evidence be best; `beyond` in s as in `compared_evidences`."""
        if len(self.fits) > 1:
            evidences = self._order(compared_evidences(self.task, self.fits, beyond=beyond))
            weights = np.exp((evidences - evidences[0]) / CHANCE_EVIDENCE)
            apart = np.array([fit.unit for fit in self.fits]) - self.best.unit
            self.spread = weights @ apart**2 / weights.sum()

    def state(self) -> dict[str, Any]:
        return {**super().state(), "fits": [fit.state() for fit in self.fits]}

    def load_state(self, state: Mapping[str, Any]) -> None:
        could_begin_again = self._may_begin_again
        super().load_state(state)
        if could_begin_again and not self._may_begin_again:
            self.fits = [*self.fits[: len(self.starts) - 1], self._begun_again()]
        self.fits = self.fits[: len(self.starts)]
        for fit, fit_state in zip(self.fits, state["fits"], strict=True):
            fit.load_state(fit_state)

    @property
    def _have_settled(self) -> bool:
        return all(fit.settled for fit in self.fits)

    @property
    def _begins_again(self) -> bool:
        """Whether a fit begins again as soon as all have settled."""
        return self._may_begin_again and bool(self.ends_early.any())

    def _begun_again(self) -> JointFit:
        """Return a fit that begins at the best θ_s, with initial states as observed."""
        best = self.best
        # A scan would leave that θ_s while horizons are short.
        settings = replace(self._settings, scan_steps=())
        fit = JointFit(self.task, settings, best.model.stated_blocks)
        deviations = np.minimum(self.task.prior.deviations, best.deviations)
        fit.begin_at(best.unit, deviations, [None] * len(self.task.influence))
        return fit

    def _order(self, evidences: NDArray[np.float64]) -> NDArray[np.float64]:
        """Put the fits of larger evidences (n_fits,) first; return these in their order."""
        order = np.argsort(-evidences, kind="stable")
        self.fits = [self.fits[k] for k in order]
        self.starts = self.starts[order]
        return evidences[order]
