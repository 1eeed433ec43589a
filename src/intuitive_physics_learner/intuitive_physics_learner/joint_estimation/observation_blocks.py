"""Observations of the same size side by side, with the deviations of their initial states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.observation import Observation
from intuitive_physics.shapes import Sphere
from intuitive_physics.state import LINEAR_VELOCITY, POSITION, ROTATION
from intuitive_physics_learner.cost.packed_observations import times_after_start

PRIOR_WIDENING = 10.0
"""By what the standard deviations of position and velocity are multiplied: most of what is known of
them comes from points of the very trajectory they are to explain, which must not count twice."""


@dataclass(frozen=True, eq=False)
class InitialStateDeviations:
    """What may differ from the initial states that an observation came with.

    Parameters
    ----------
    believed : (O, 13) as `ObjectState.to_vector`
    axes : d pairs (object, component), components as in an `ObjectState`'s covariance; known
        exactly, and so not among them, are those of variance zero and how a sphere is turned
    standard_deviations : (d,) of each before the trajectory was looked at, in its SI unit
    """

    believed: NDArray[np.float64]
    axes: tuple[tuple[int, int], ...]
    standard_deviations: NDArray[np.float64]

    @staticmethod
    def of(observation: Observation, free: bool = True) -> InitialStateDeviations:
        """Read them from the initial states' covariances, of which only the diagonal is used.

        Parameters
        ----------
        free : False takes the initial states to be exactly known
        """
        axes, deviations = [], []
        for j, seen in enumerate(observation.objects):
            spread = np.sqrt(np.diag(seen.initial_state.covariance))
            spread[POSITION] *= PRIOR_WIDENING
            spread[LINEAR_VELOCITY] *= PRIOR_WIDENING
            if isinstance(seen.object.shape, Sphere):
                spread[ROTATION] = 0.0
            spread *= free
            axes += [(j, int(k)) for k in np.flatnonzero(spread)]
            deviations += spread[spread > 0.0].tolist()
        believed = np.array([seen.initial_state.to_vector() for seen in observation.objects])
        return InitialStateDeviations(believed, tuple(axes), np.array(deviations))


@dataclass(frozen=True, eq=False)
class BelievedStates:
    """Initial states of W observations side by side, each with d components that may differ.

    Parameters
    ----------
    believed : (W, O, 13), padded with rest
    objects : (W,) how many each has
    places : (W, d) index of each component on the axes (O, 12)
    turns : whether any of them is of an orientation
    """

    believed: NDArray[np.float64]
    objects: NDArray[np.int64]
    places: NDArray[np.int64]
    turns: bool

    @staticmethod
    def of(first: Sequence[InitialStateDeviations]) -> BelievedStates:
        """Put together those of observations with equally many components."""
        objects = np.array([len(each.believed) for each in first])
        believed = resting(len(first), int(objects.max()))
        for row, each in zip(believed, first, strict=True):
            row[: len(each.believed)] = each.believed
        axes = np.array([each.axes for each in first], dtype=np.int64).reshape(len(first), -1, 2)
        turns = bool(((axes[..., 1] >= ROTATION.start) & (axes[..., 1] < ROTATION.stop)).any())
        return BelievedStates(believed, objects, axes[..., 0] * 12 + axes[..., 1], turns)

    def states(self, deviations: NDArray[np.float64], objects: int) -> NDArray[np.float64]:
        """Return initial states (W, n, objects, 13), padded with rest, for deviations (W, n, d)."""
        count, each = deviations.shape[:2]
        own = self.believed.shape[1]
        errors = np.zeros((count, each, own * 12))
        rows = np.arange(count)[:, None, None], np.arange(each)[:, None]
        errors[rows[0], rows[1], self.places[:, None]] = deviations
        errors = errors.reshape(count, each, own, 12)
        states = resting(count, each, objects)
        states[:, :, :own] = self.believed[:, None]
        states[:, :, :own, 0:3] += errors[..., 0:3]
        if self.turns:
            states[:, :, :own, 3:7] = _turned(self.believed[:, None, :, 3:7], errors[..., 3:6])
        states[:, :, :own, 7:13] += errors[..., 6:12]
        return states


def resting(*shape: int) -> NDArray[np.float64]:
    """Return states (*shape, 13) at rest in the origin."""
    states = np.zeros((*shape, 13))
    states[..., 6] = 1.0
    return states


def _turned(
    quaternions: NDArray[np.float64], rotations: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Turn orientations (W, 1, O, 4) by rotation vectors (W, n, O, 3) in the environment's
    frame."""
    angles = np.linalg.norm(rotations, axis=-1, keepdims=True)
    # sin(θ/2) / θ by NumPy's sinc(x) = sin(π x) / (π x), which is right at θ = 0 too.
    x1, y1, z1 = np.moveaxis(0.5 * np.sinc(angles / (2.0 * np.pi)) * rotations, -1, 0)
    w1 = np.cos(0.5 * angles[..., 0])
    x2, y2, z2, w2 = np.moveaxis(quaternions, -1, 0)
    return np.stack(
        [
            w1 * x2 + x1 * w2 + y1 * z2 - z1 * y2,
            w1 * y2 - x1 * z2 + y1 * w2 + z1 * x2,
            w1 * z2 + x1 * y2 - y1 * x2 + z1 * w2,
            w1 * w2 - x1 * x2 - y1 * y2 - z1 * z2,
        ],
        axis=-1,
    )


@dataclass(frozen=True, eq=False)
class ObservationBlock:
    """W observations, each with d free components of initial states, q parameters, up to P points.

    Parameters
    ----------
    members : (W,) index of each among all observations
    initial_states : what each is believed to begin from
    parameters : (W, q) indices of the parameters that each can depend on
    times : (W, P) s after the start of each point; NaN beyond the last
    columns : (P,) which of the points that `Cost.trial_residuals` answers these are
    durations : (W,) s, time of the last point of each observation
    prior_deviations : (W, d) standard deviations of the initial states' components
    """

    members: NDArray[np.int64]
    initial_states: BelievedStates
    parameters: NDArray[np.int64]
    times: NDArray[np.float64]
    columns: NDArray[np.int64]
    durations: NDArray[np.float64]
    prior_deviations: NDArray[np.float64]

    def shortened(self, until: NDArray[np.float64]) -> ObservationBlock:
        """Return the same without the points that are later than `until` (W,) s in all of them."""
        kept = (self.times <= until[:, None]).any(axis=0)
        return replace(self, times=self.times[:, kept], columns=self.columns[kept])


def observation_blocks(
    observations: Sequence[Observation],
    influence: NDArray[np.bool_],
    *,
    free_states: bool = True,
) -> list[ObservationBlock]:
    """Put observations into blocks.

    Parameters
    ----------
    influence : (n_observations, n_parameters) bool
    free_states : whether initial states may differ from those observed
    """
    initial_states = [InitialStateDeviations.of(seen, free_states) for seen in observations]
    times = [
        np.concatenate([times_after_start(seen, thing) for thing in seen.objects])
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
        BelievedStates.of([initial_states[i] for i in members]),
        np.array([np.flatnonzero(influence[i]) for i in members]),
        padded,
        np.arange(padded.shape[1]),
        np.nanmax(padded, axis=1),
        np.array([initial_states[i].standard_deviations for i in members]),
    )
