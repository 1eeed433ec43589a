"""Fits of one observation, and of those of a window, to what is known; and their evidence."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.materials import StaticParameters
from intuitive_physics.parameter_space import ParameterSpace
from intuitive_physics_learner.cost.cost_function import Cost
from intuitive_physics_learner.joint_estimation.joint_fit import JointFit, ObservationFit
from intuitive_physics_learner.joint_estimation.local_likelihood import LocalLikelihood
from intuitive_physics_learner.online.options import RecursionSettings
from intuitive_physics_learner.search.learning_task import GaussianPrior
from intuitive_physics_learner.search.search_space import ActiveSpace

_FitTask = tuple[Cost, ActiveSpace, NDArray[np.bool_], GaussianPrior]
"""Parts of a joint fit: cost of the observations, space of the n parameters, (n_observations, n)
which observation can depend on which, and prior."""


def log_evidence(
    task: _FitTask, found: JointFit, horizons: Sequence[float], settings: RecursionSettings
) -> float:
    """Return ln ∫ p(points up to horizons | θ_s) p(θ_s) dθ_s by Laplace's approximation.

    `horizons` in s, the last time of each observation that counts; evidences up to different ones
    do not compare.
    """
    *_, prior = task
    fit = JointFit(*task, settings.joint().with_fixed_horizons())
    fits = zip(found.observation_fits(), horizons, strict=True)
    fit.begin_at(found.unit, prior.deviations, [replace(one, horizon=h) for one, h in fits])
    for _ in range(settings.scoring_steps):
        fit.step()
    loss, precision = float(prior.losses(fit.unit[None])[0]), prior.precision.copy()
    for one in fit.likelihoods():
        precision[np.ix_(one.parameters, one.parameters)] += one.information
        loss += one.loss
    narrowed = np.linalg.slogdet(precision)[1] - np.linalg.slogdet(prior.precision)[1]
    return -loss - 0.5 * float(narrowed)


class LoneFit:
    """Fits one observation by itself to a prior of θ_s, up to where it can be explained.

    `influence` (n,) bool, which parameters the observation can depend on, at least one.

    Attributes
    ----------
    blocked : whether the motion cannot be explained farther than `horizon`
    """

    def __init__(
        self,
        cost: Cost,
        space: ParameterSpace,
        influence: NDArray[np.bool_],
        prior: GaussianPrior,
        settings: RecursionSettings,
        scans: tuple[int, ...] = (),
        others: StaticParameters | None = None,
    ) -> None:
        self._cost = cost
        self._settings = settings
        self._own = np.flatnonzero(influence)
        self._prior = prior.marginal(self._own)
        others = others or space.to_parameters(np.clip(prior.mean, 0.0, 1.0))
        self._space = ActiveSpace(space, influence, others)
        self._fit = JointFit(
            cost, self._space, self._everything, self._prior, settings.joint(scans=scans)
        )
        self.blocked = False

    def run(self) -> None:
        """Take steps until the fit has settled, or as many as the settings allow."""
        since = self._settings.misfit_steps
        for _ in range(self._settings.lone_steps):
            if self._fit.settled:
                break
            self._fit.step()
            since = 0 if self._fit.misfits else since + 1
        self.blocked = since < self._settings.misfit_steps

    @property
    def simulations(self) -> int:
        """Simulations of the observation so far."""
        return self._fit.simulations

    @property
    def found(self) -> ObservationFit:
        """Initial states and fit horizon."""
        return self._fit.observation_fits()[0]

    def likelihood(self) -> LocalLikelihood:
        """Return the likelihood of all n parameters near the estimate."""
        return self._among_all(self._fit.likelihoods(look_for_spins=True)[0])

    def log_evidence(self, horizon: float) -> float:
        """Return ln ∫ p(points up to a horizon | θ_s) p(θ_s) dθ_s by Laplace's approximation.

        `horizon` in s, the last time that counts; evidences up to different ones do not compare.
        """
        task = self._cost, self._space, self._everything, self._prior
        return log_evidence(task, self._fit, [horizon], self._settings)

    @property
    def _everything(self) -> NDArray[np.bool_]:
        return np.ones((1, self._own.size), dtype=bool)

    def _among_all(self, likelihood: LocalLikelihood) -> LocalLikelihood:
        return replace(likelihood, parameters=self._own[likelihood.parameters])


class WindowProblem:
    """The joint fit of some observations to a prior.

    `influence` (n_observations, n) bool, which observation can depend on which parameter.
    """

    def __init__(
        self,
        cost: Cost,
        space: ActiveSpace,
        influence: NDArray[np.bool_],
        prior: GaussianPrior,
        settings: RecursionSettings,
    ) -> None:
        self._task = (cost, space, influence, prior)
        self._settings = settings

    def fit(self, scans: tuple[int, ...]) -> JointFit:
        """Return a fit that begins at the prior's mean."""
        return JointFit(*self._task, self._settings.joint(scans=scans))

    def better(self, one: JointFit, other: JointFit) -> JointFit:
        """Return the fit of the larger evidence, up to the longer horizon of each observation."""
        pairs = zip(one.observation_fits(), other.observation_fits(), strict=True)
        horizons = [max(a.horizon, b.horizon) for a, b in pairs]
        evidences = [
            log_evidence(self._task, fit, horizons, self._settings) for fit in (one, other)
        ]
        return one if evidences[0] >= evidences[1] else other


def run(fit: JointFit, steps: int, seconds_left: Callable[[], float] = lambda: np.inf) -> None:
    """Take steps, at least one, until the fit has settled or the time is over."""
    for _ in range(steps):
        if fit.settled or (fit.steps and seconds_left() <= 0.0):
            break
        fit.step()
