"""Fits in segments of objects that tumble, between fits of single states and the joint fit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from operator import methodcaller
from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.simulation.shares import mapped_in_shares
from intuitive_physics_learner.joint_estimation.joint_fit import JointFit, ObservationFit
from intuitive_physics_learner.joint_search.separate_fits import FitOf, tumbles
from intuitive_physics_learner.search.gaussian import Gaussian
from intuitive_physics_learner.search.learning_task import NEGLIGIBLE_WEIGHT, FitTask
from intuitive_physics_learner.search.plain_state import Resumable
from intuitive_physics_learner.segmented_estimation.segmented_fit import SegmentedFit


class SegmentStage(Resumable):
    """Begins, steps and ends fits in segments, and keeps what they have said.

    `in_segments` makes a fit in segments of one to an object alone, or None where there shall be
    none; None: there are none, and the stage is over at once.

    Attributes
    ----------
    steps : taken so far
    ended : whether the stage is over
    """

    remembered = ("steps", "ended", "_simulations_before", "_known")

    def __init__(self, in_segments: Callable[[JointFit], SegmentedFit | None] | None) -> None:
        self._in_segments = in_segments
        self._fits: list[tuple[FitOf, SegmentedFit]] = []
        self.steps, self.ended = 0, in_segments is None
        self._simulations_before = 0.0
        self._known: list[dict[str, Any]] = []

    @property
    def has_begun(self) -> bool:
        """Whether there are fits that take steps."""
        return bool(self._fits)

    @property
    def has_said(self) -> bool:
        """Whether anything is known by it."""
        return bool(self._known)

    @property
    def simulations(self) -> float:
        """Simulations of single observations so far."""
        return self._simulations_before + sum(fit.simulations for _, fit in self._fits)

    @property
    def members(self) -> NDArray[np.int64]:
        """Indices (n,) of the observations that are being fitted."""
        none = np.zeros(0, dtype=np.int64)
        return np.concatenate([none, *(part.members for part, _ in self._fits)])

    def begin(self, fits: Sequence[FitOf]) -> None:
        """Go on in segments from those of the fits whose objects tumble; else it has ended."""
        for part in fits:
            begun = None
            if self._in_segments is not None and tumbles(part.fit):
                begun = self._in_segments(part.fit)
            if begun is not None:
                self._fits.append((part, begun))
        self.ended = not self._fits

    def step(self, threads: int) -> bool:
        """Take a step of each fit; return whether all have finished."""
        self.steps += 1
        going = [fit for _, fit in self._fits if not fit.finished]
        mapped_in_shares(methodcaller("step"), going, threads)
        return all(fit.finished for _, fit in self._fits)

    def end(self) -> dict[int, ObservationFit | None]:
        """Keep what the fits say; one that has not got far enough is left out.

        Returns for the observations of the others, by their indices, how the throws began.
        """
        begun: dict[int, ObservationFit | None] = {}
        for part, fit in self._fits:
            self._simulations_before += fit.simulations
            if fit.usable:
                said = fit.knowledge()
                self._known.append(
                    {
                        "members": part.members.tolist(),
                        "parameters": part.parameters.tolist(),
                        "precision": said.precision.tolist(),
                        "pull": said.pull.tolist(),
                    }
                )
                begun.update(zip(part.members.tolist(), fit.observation_fits(), strict=True))
        self._fits, self.ended = [], True
        return begun

    def informed(self, task: FitTask) -> FitTask:
        """Return a task with what was said in its prior, where these throws count no more."""
        prior, weights = task.prior, task.weights.copy()
        for known in self._known:
            said = Gaussian(np.array(known["precision"]), np.array(known["pull"]))
            prior = prior.joined(said.among(np.array(known["parameters"]), prior.mean.size))
            weights[known["members"]] *= NEGLIGIBLE_WEIGHT
        return replace(task, prior=prior, given_weights=weights)

    @property
    def known_members(self) -> list[int]:
        """Indices of the observations of which it was said what they say."""
        return [member for known in self._known for member in known["members"]]

    @property
    def known_parameters(self) -> list[int]:
        """Indices of the parameters that something was said about."""
        return sorted({each for known in self._known for each in known["parameters"]})
