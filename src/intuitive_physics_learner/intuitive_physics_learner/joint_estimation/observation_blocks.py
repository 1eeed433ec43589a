"""Observations of the same size side by side, with the deviations of their initial states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.geometry.rotations import rotate_quaternions
from intuitive_physics.observation import Observation
from intuitive_physics.shapes import Sphere
from intuitive_physics.state import LINEAR_VELOCITY, POSITION, ROTATION
from intuitive_physics_learner.cost.packed_observations import times_after_start
from intuitive_physics_learner.joint_estimation.settings import JointEstimationSettings


@dataclass(frozen=True, eq=False)
class InitialStateDeviations:
    """Components in which the true initial states may differ from those observed.

    Parameters
    ----------
    observed : (O, 13) initial states in SI units, as `ObjectState.to_vector`
    axes : d pairs (object, component), components as in an `ObjectState`'s covariance; those of
        variance zero and the orientation of a sphere are fixed and not among them
    standard_deviations : (d,) prior of each, in its SI unit
    """

    observed: NDArray[np.float64]
    axes: tuple[tuple[int, int], ...]
    standard_deviations: NDArray[np.float64]

    @staticmethod
    def of(
        observation: Observation, settings: JointEstimationSettings, free: bool = True
    ) -> InitialStateDeviations:
        """Read them from the diagonals of the initial states' covariances.

        Parameters
        ----------
        observation : with O objects
        settings : by which the prior is widened
        free : False takes the initial states to be exactly known
        """
        axes, deviations = [], []
        for j, seen in enumerate(observation.objects):
            spread = np.sqrt(np.diag(seen.initial_state.covariance))
            spread[POSITION] *= settings.prior_widening
            spread[LINEAR_VELOCITY] *= settings.prior_widening
            if isinstance(seen.object.shape, Sphere):
                spread[ROTATION] = 0.0
            spread *= free
            axes += [(j, int(k)) for k in np.flatnonzero(spread)]
            deviations += spread[spread > 0.0].tolist()
        observed = np.array([seen.initial_state.to_vector() for seen in observation.objects])
        return InitialStateDeviations(observed, tuple(axes), np.array(deviations))


@dataclass(frozen=True, eq=False)
class InitialStates:
    """Initial states of W observations side by side, each with d components that may differ.

    Parameters
    ----------
    observed : (W, O, 13) in SI units, padded with states at rest
    objects : (W,) number of objects of each
    components : (W, d) index of each component on the axes (O, 12)
    turns : whether any of them is of an orientation
    """

    observed: NDArray[np.float64]
    objects: NDArray[np.int64]
    components: NDArray[np.int64]
    turns: bool

    @staticmethod
    def of(deviations: Sequence[InitialStateDeviations]) -> InitialStates:
        """Put together those of observations with equally many components."""
        count = len(deviations)
        objects = np.array([len(each.observed) for each in deviations])
        observed = resting(count, int(objects.max()))
        for row, each in zip(observed, deviations, strict=True):
            row[: len(each.observed)] = each.observed
        axes = np.array([each.axes for each in deviations], dtype=np.int64).reshape(count, -1, 2)
        turns = bool(((axes[..., 1] >= ROTATION.start) & (axes[..., 1] < ROTATION.stop)).any())
        return InitialStates(observed, objects, axes[..., 0] * 12 + axes[..., 1], turns)

    def states(self, deviations: NDArray[np.float64], objects: int) -> NDArray[np.float64]:
        """Return n initial states of each observation.

        Parameters
        ----------
        deviations : (W, n, d) from those observed, in the SI unit of each component
        objects : number of objects to pad to with states at rest

        Returns
        -------
        (W, n, objects, 13) in SI units
        """
        count, each = deviations.shape[:2]
        own = self.observed.shape[1]
        errors = np.zeros((count, each, own * 12))
        rows = np.arange(count)[:, None, None], np.arange(each)[:, None]
        errors[rows[0], rows[1], self.components[:, None]] = deviations
        errors = errors.reshape(count, each, own, 12)
        states = resting(count, each, objects)
        states[:, :, :own] = self.observed[:, None]
        states[:, :, :own, 0:3] += errors[..., 0:3]
        if self.turns:
            states[:, :, :own, 3:7] = rotate_quaternions(
                self.observed[:, None, :, 3:7], errors[..., 3:6]
            )
        states[:, :, :own, 7:13] += errors[..., 6:12]
        return states


def resting(*shape: int) -> NDArray[np.float64]:
    """Return states (*shape, 13), in SI units, at rest in the origin."""
    states = np.zeros((*shape, 13))
    states[..., 6] = 1.0
    return states


@dataclass(frozen=True, eq=False)
class ObservationBlock:
    """W observations, each with d free components of initial states, q parameters and ≤ P points.

    Parameters
    ----------
    members : (W,) index of each among all observations
    initial_states : as observed, with their free components
    parameters : (W, q) indices of the parameters that each can depend on
    times : (W, P) s after the start of each point; NaN beyond the last
    columns : (P,) index of each point among those that `Cost.trial_residuals` returns
    durations : (W,) s, time of the last point of each observation
    prior_deviations : (W, d) standard deviations of the initial states' components, in SI units
    """

    members: NDArray[np.int64]
    initial_states: InitialStates
    parameters: NDArray[np.int64]
    times: NDArray[np.float64]
    columns: NDArray[np.int64]
    durations: NDArray[np.float64]
    prior_deviations: NDArray[np.float64]

    def shortened(self, until: NDArray[np.float64]) -> ObservationBlock:
        """Return the block without the points that are later than `until` in all observations.

        Parameters
        ----------
        until : (W,) s
        """
        left = (self.times <= until[:, None]).any(axis=0)
        return replace(self, times=self.times[:, left], columns=self.columns[left])


def observation_blocks(
    observations: Sequence[Observation],
    influence: NDArray[np.bool_],
    settings: JointEstimationSettings,
    *,
    free_states: bool = True,
) -> list[ObservationBlock]:
    """Put observations into blocks.

    Parameters
    ----------
    observations : to estimate from
    influence : (n_observations, n_parameters) bool, which observation can depend on which parameter
    settings : by which the priors of initial states are widened
    free_states : whether initial states may differ from those observed
    """
    initial_states = [
        InitialStateDeviations.of(seen, settings, free_states) for seen in observations
    ]
    times = [
        np.concatenate([times_after_start(seen, one) for one in seen.objects])
        for seen in observations
    ]
    times = [each[each >= 0.0] for each in times]
    groups: dict[tuple[int, int, int], list[int]] = {}
    for i in range(len(observations)):
        size = times[i].size.bit_length()
        key = (len(initial_states[i].axes), int(influence[i].sum()), size)
        groups.setdefault(key, []).append(i)
    return [_block(groups[key], initial_states, influence, times) for key in sorted(groups)]


def _block(
    members: list[int],
    initial_states: list[InitialStateDeviations],
    influence: NDArray[np.bool_],
    times: list[NDArray[np.float64]],
) -> ObservationBlock:
    padded = np.full((len(members), max(times[i].size for i in members)), np.nan)
    for row, i in enumerate(members):
        padded[row, : times[i].size] = times[i]
    return ObservationBlock(
        np.array(members),
        InitialStates.of([initial_states[i] for i in members]),
        np.array([np.flatnonzero(influence[i]) for i in members]),
        padded,
        np.arange(padded.shape[1]),
        np.nanmax(padded, axis=1),
        np.array([initial_states[i].standard_deviations for i in members]),
    )
