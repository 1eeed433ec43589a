"""Fits of one observation, and of those of a window, to what is known; and their evidence."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.materials import StaticParameters
from intuitive_physics.parameter_space import ParameterSpace
from intuitive_physics_learner.cost.cost_function import Cost
from intuitive_physics_learner.joint_estimation.joint_fit import (
    LARGEST_VOTE,
    JointEstimationSettings,
    JointFit,
    ObservationFit,
)
from intuitive_physics_learner.joint_estimation.normal_equations import LocalLikelihood
from intuitive_physics_learner.joint_estimation.several_starts import log_evidences
from intuitive_physics_learner.joint_estimation.staged_fit import StagedFit
from intuitive_physics_learner.online.online_state import Member
from intuitive_physics_learner.search.gaussian import Gaussian
from intuitive_physics_learner.search.learning_task import FitTask
from intuitive_physics_learner.search.search_space import ActiveSpace

LONE_STEPS = 24
"""Joint steps in which one observation is fitted by itself at most; set by hand: with
`largest_advance` they suffice for 10 s of motion."""

RETRY_STEPS = 60
"""Joint steps of a second, more careful fit of an observation that cannot be explained; set by
hand."""

BEYOND = 0.5
"""Time beyond the fit horizon up to which fits are compared, s; fits to many observations up to the
end as well: on three chaotic sets these two together chose the better one more often than each
alone."""

MISFIT_STEPS = 4
"""Number of last steps of a lone fit in which a misfit means that the motion cannot be explained
farther: an advance beyond what can be explained ends in a misfit every other step or third."""

LARGEST_ADVANCE = 0.5
"""Largest advance of a fit horizon in one step, s: more than in a fit that begins with nothing, for
what is known predicts farther; set by hand."""


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
        prior: Gaussian,
        others: StaticParameters,
        *,
        scans: tuple[int, ...] = (),
        careful: bool = False,
    ) -> None:
        self._steps = RETRY_STEPS if careful else LONE_STEPS
        self._parameters = np.flatnonzero(influence)
        self._task = FitTask(
            cost,
            ActiveSpace(space, influence, others),
            np.ones((1, self._parameters.size), dtype=bool),
            prior.marginal(self._parameters),
        )
        settings = JointEstimationSettings(scan_steps=scans)
        if not careful:
            settings = replace(settings, largest_advance=LARGEST_ADVANCE)
        self._fit = JointFit(self._task, settings)
        self.blocked = False

    def run(self) -> None:
        """Take steps until the fit has settled, or as many as are allowed."""
        since = MISFIT_STEPS
        for _ in range(self._steps):
            if self._fit.settled:
                break
            self._fit.step()
            since = 0 if self._fit.misfits else since + 1
        self.blocked = since < MISFIT_STEPS

    @property
    def simulations(self) -> float:
        """Simulations of the observation so far."""
        return self._fit.model.simulations

    @property
    def observation_fit(self) -> ObservationFit:
        """Initial states and fit horizon."""
        return self._fit.observation_fits()[0]

    def likelihood(self) -> LocalLikelihood:
        """Return the likelihood of all n parameters near the estimate."""
        (likelihood,) = self._fit.likelihoods(look_for_spins=True)
        return replace(likelihood, parameters=self._parameters[likelihood.parameters])

    def log_evidence(self, horizon: float, prior: Gaussian | None = None) -> float:
        """Return ln ∫ p(points up to a horizon | θ_s) p(θ_s) dθ_s by Laplace's approximation.

        `horizon` in s, the last time that counts; evidences up to different ones do not compare.
        `prior` of all n parameters; None: that of the fit.
        """
        task = self._task
        if prior is not None:
            task = replace(task, prior=prior.marginal(self._parameters))
        of_points, of_parameters = log_evidences(task, self._fit, [horizon])
        return float(of_points.sum()) + of_parameters


@dataclass(frozen=True, eq=False)
class JointProblem:
    """A fit of some of the observations that are kept.

    Parameters
    ----------
    members : the observations
    parameters : (k,) indices, among all n, of the parameters that any of them depends on
    prior : of all n parameters, without these observations
    task : the fit over those parameters
    """

    members: list[Member]
    parameters: NDArray[np.int64]
    prior: Gaussian
    task: FitTask


def window_fit(task: FitTask) -> JointFit:
    """Return a fit of several observations that begins at the prior's mean."""
    settings = JointEstimationSettings(largest_advance=LARGEST_ADVANCE, scan_steps=())
    return JointFit(task, settings)


def most_evident(task: FitTask, fits: Sequence[JointFit]) -> int:
    """Return the index of the fit with the largest evidence; the first of equals.

    Up to the fit horizons of one of two fits that one has the advantage: these are where it
    explains the motion. So evidence counts up to a little beyond the longest of all, where an error
    shows first, and up to the end. A single observation counts up to `LARGEST_VOTE` each time:
    beyond where a fit explains it, it differs by thousands, and that says only that one of the two
    took a wrong turn.
    """
    every = [[each.horizon for each in fit.observation_fits()] for fit in fits]
    beyond = np.max(every, axis=0) + BEYOND
    evidences = [
        [log_evidences(task, fit, horizons) for horizons in (beyond, np.full(beyond.size, np.inf))]
        for fit in fits
    ]
    best = 0
    for k in range(1, len(fits)):
        gain = 0.0
        for (points, parameters), (before, parameters_before) in zip(
            evidences[k], evidences[best], strict=True
        ):
            votes = np.clip(points - before, -LARGEST_VOTE, LARGEST_VOTE)
            gain += float(votes.sum()) + parameters - parameters_before
        if gain > 0.0:
            best = k
    return best


def run(
    fit: JointFit | StagedFit, steps: int, seconds_left: Callable[[], float] = lambda: np.inf
) -> None:
    """Take steps, at least one, until the fit has settled or the time is over."""
    for _ in range(steps):
        if fit.settled or (fit.steps and seconds_left() <= 0.0):
            break
        fit.step()
