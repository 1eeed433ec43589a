"""A fit of one observation by itself to what is known, and its evidence."""

from __future__ import annotations

from dataclasses import replace

from intuitive_physics_learner.cost.cost_function import Cost
from intuitive_physics_learner.joint_estimation.joint_fit import (
    JointEstimationSettings,
    JointFit,
    ObservationFit,
)
from intuitive_physics_learner.joint_estimation.several_starts import log_evidences
from intuitive_physics_learner.online.online_state import Member, OnlineState, Signs
from intuitive_physics_learner.search.gaussian import Gaussian

LONE_STEPS = 24
"""Joint steps in which one observation is fitted by itself at most; set by hand: with
`largest_advance` they suffice for 10 s of motion."""

RETRY_STEPS = 60
"""Joint steps of a second, more careful fit of an observation that cannot be explained; set by
hand."""

MISFIT_STEPS = 4
"""Number of last steps of a lone fit in which a misfit means that the motion cannot be explained
farther: an advance beyond what can be explained ends in a misfit every other step or third."""

LARGEST_ADVANCE = 0.5
"""Largest advance of a fit horizon in one step, s: more than in a fit that begins with nothing, for
what is known predicts farther; set by hand."""


class LoneFit:
    """Fits one observation by itself to a prior of θ_s, up to where it can be explained.

    Attributes
    ----------
    observation : by its detections
    fit : to it, over the parameters that it can depend on
    blocked : whether the motion cannot be explained farther than `horizon`
    """

    def __init__(
        self,
        cost: Cost,
        state: OnlineState,
        prior: Gaussian,
        *,
        scans: tuple[int, ...] = (),
        careful: bool = False,
    ) -> None:
        (self.observation,) = cost.observations
        self._parameters, self._task = state.fit_task(cost, prior)
        settings = JointEstimationSettings(scan_steps=scans)
        if not careful:
            settings = replace(settings, largest_advance=LARGEST_ADVANCE)
        self.fit = JointFit(self._task, settings)
        since = MISFIT_STEPS
        for _ in range(RETRY_STEPS if careful else LONE_STEPS):
            if self.fit.settled:
                break
            self.fit.step()
            since = 0 if self.fit.misfits else since + 1
        self.blocked = since < MISFIT_STEPS

    @property
    def observation_fit(self) -> ObservationFit:
        """Initial states and fit horizon."""
        return self.fit.observation_fits()[0]

    def member(self, number: int, signs: Signs) -> Member:
        """Return the observation, the `number`-th, with what it says of all n parameters."""
        (likelihood,) = self.fit.likelihoods()
        likelihood = replace(likelihood, parameters=self._parameters[likelihood.parameters])
        name, stamp = self.observation.id, self.observation.start_time
        return Member(name, number, stamp, self.observation_fit, likelihood, signs)

    def log_evidence(self, horizon: float, prior: Gaussian | None = None) -> float:
        """Return ln ∫ p(points up to a horizon | θ_s) p(θ_s) dθ_s by Laplace's approximation.

        `horizon` in s, the last time that counts; evidences up to different ones do not compare.
        `prior` of all n parameters; None: that of the fit.
        """
        task = self._task
        if prior is not None:
            task = replace(task, prior=prior.marginal(self._parameters))
        of_points, of_parameters = log_evidences(task, self.fit, [horizon])
        return float(of_points.sum()) + of_parameters
