"""Observations of the same size side by side, with the deviations of their initial states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.geometry.rotations import rotate_quaternions
from intuitive_physics.observation import Observation, observation_materials
from intuitive_physics.shapes import Sphere
from intuitive_physics.state import LINEAR_VELOCITY, POSITION, ROTATION
from intuitive_physics_learner.cost.packed_observations import times_after_start
from intuitive_physics_learner.cost.point_noise import TrackNoise, track_noises
from intuitive_physics_learner.cost.trials import resting

LARGEST_BLOCK = 20
"""Largest number of observations that one thread works on together; of 8, 10, 14, 16, 20 and 40 the
fastest for 40 observations and two threads."""

SMALLEST_SHARED = 10
"""Observations from which on two threads work on them."""

PRIOR_WIDENING = 10.0
"""Factor on the standard deviations of the observed initial position and velocity: most of what is
known of them comes from points of the very trajectory they are to explain, which must not count
twice; set by hand."""


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
    def of(observation: Observation) -> InitialStateDeviations:
        """Read them from the diagonals of the initial states' covariances."""
        axes, deviations = [], []
        for j, track in enumerate(observation.objects):
            spread = np.sqrt(np.diag(track.initial_state.covariance))
            spread[POSITION] *= PRIOR_WIDENING
            spread[LINEAR_VELOCITY] *= PRIOR_WIDENING
            if isinstance(track.object.shape, Sphere):
                spread[ROTATION] = 0.0
            axes += [(j, int(k)) for k in np.flatnonzero(spread)]
            deviations += spread[spread > 0.0].tolist()
        observed = np.array([track.initial_state.to_vector() for track in observation.objects])
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

        `deviations` (W, n, at least d) from those observed, in the SI unit of each component; what
        follows the first d is not of the initial states. Returns (W, n, objects, 13) in SI units.
        """
        count, each = deviations.shape[:2]
        width = self.observed.shape[1]
        errors = np.zeros((count, each, width * 12))
        rows = np.arange(count)[:, None, None], np.arange(each)[:, None]
        axis_deviations = deviations[..., : self.components.shape[1]]
        errors[rows[0], rows[1], self.components[:, None]] = axis_deviations
        errors = errors.reshape(count, each, width, 12)
        states = resting(count, each, objects)
        states[:, :, :width] = self.observed[:, None]
        states[:, :, :width, 0:3] += errors[..., 0:3]
        if self.turns:
            states[:, :, :width, 3:7] = rotate_quaternions(
                self.observed[:, None, :, 3:7], errors[..., 3:6]
            )
        states[:, :, :width, 7:13] += errors[..., 6:12]
        return states


@dataclass(frozen=True, eq=False)
class ObservationBlock:
    """W observations, each with d nuisance parameters, q parameters and ≤ P points.

    The nuisance parameters are f free components of the initial states, then b amounts of errors
    that all points of an object share, in standard deviations.

    Parameters
    ----------
    members : (W,) index of each among all observations
    initial_states : as observed, with their free components
    parameters : (W, q) indices of the parameters that each can depend on
    times : (W, P) s after the start of each point; NaN beyond the last
    columns : (P,) index of each point among those that `Cost.trial_residuals` returns
    durations : (W,) s, time of the last point of each observation
    prior_deviations : (W, d) standard deviations of the nuisance parameters, those of components
        of initial states in SI units
    whitening : (W, P, 3, 3) 1/m, which makes the error of each point standard normal; 0 beyond the
        last point
    shared : (W, b, P, 3) m, displacement of each point by one standard deviation of each shared
        error
    shared_index : (W, b) index of each shared error among all: objects of one material have theirs
        in common, since the same camera measured the same radius against the same planes
    """

    members: NDArray[np.int64]
    initial_states: InitialStates
    parameters: NDArray[np.int64]
    times: NDArray[np.float64]
    columns: NDArray[np.int64]
    durations: NDArray[np.float64]
    prior_deviations: NDArray[np.float64]
    whitening: NDArray[np.float64]
    shared: NDArray[np.float64]
    shared_index: NDArray[np.int64]

    @property
    def noise(self) -> NDArray[np.float64]:
        """Standard deviation (W, P) of each point in m, the mean of its axes."""
        squares = (self.whitening**2).sum(axis=(2, 3))
        return np.sqrt(3.0 / np.where(squares > 0.0, squares, np.inf))

    def whitened(self, residuals: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return residuals (..., W, P, 3) m in standard deviations of the noise."""
        return np.asarray((self.whitening @ residuals[..., None])[..., 0])

    def displaced(
        self, residuals: NDArray[np.float64], estimates: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return residuals (..., W, P, 3) in m, shared errors taken out of what was observed.

        `residuals` (..., W, P, 3) m, simulated minus observed; `estimates` (..., W, d) nuisance
        parameters.
        """
        count = self.shared.shape[1]
        if count == 0:
            return residuals
        amounts = estimates[..., estimates.shape[-1] - count :]
        return residuals + np.einsum("...wb,wbpk->...wpk", amounts, self.shared)

    def shortened(self, until: NDArray[np.float64]) -> ObservationBlock:
        """Return the block without the points that are later than all of `until` (W,) s."""
        left = (self.times <= until[:, None]).any(axis=0)
        return replace(
            self,
            times=self.times[:, left],
            columns=self.columns[left],
            whitening=self.whitening[:, left],
            shared=self.shared[:, :, left],
        )


def observation_blocks(
    observations: Sequence[Observation], influence: NDArray[np.bool_]
) -> list[ObservationBlock]:
    """Put observations into blocks; `influence` (n_observations, n) bool as `FitTask`."""
    initial_states = [InitialStateDeviations.of(observation) for observation in observations]
    noises = track_noises(observations)
    materials = observation_materials(observations)
    points = [
        _ObservedPoints.of(observation, noise, materials)
        for observation, noise in zip(observations, noises, strict=True)
    ]
    groups: dict[tuple[int, int, int, int], list[int]] = {}
    for i, observation in enumerate(points):
        axes, size = len(initial_states[i].axes), observation.times.size.bit_length()
        key = (axes, int(influence[i].sum()), size, len(observation.shared))
        groups.setdefault(key, []).append(i)
    return [
        _block(members, initial_states, influence, points)
        for key in sorted(groups)
        for members in _shared(groups[key])
    ]


def _shared(members: list[int]) -> list[list[int]]:
    """Part observations into shares of the same size, as many for each of two threads."""
    pairs = -(-len(members) // (2 * LARGEST_BLOCK)) if len(members) >= SMALLEST_SHARED else 0
    return [part.tolist() for part in np.array_split(members, max(1, 2 * pairs))]


@dataclass(frozen=True, eq=False)
class _ObservedPoints:
    """The n points of an observation, object after object; its fields as `ObservationBlock`."""

    times: NDArray[np.float64]
    whitening: NDArray[np.float64]
    shared: NDArray[np.float64]
    shared_index: NDArray[np.int64]

    @staticmethod
    def of(
        observation: Observation, noises: Sequence[TrackNoise], materials: Sequence[str]
    ) -> _ObservedPoints:
        times = [times_after_start(observation, track) for track in observation.objects]
        counted = [each >= 0.0 for each in times]
        owners = np.repeat(np.arange(len(times)), [int(mask.sum()) for mask in counted])
        shared, index = [], []
        for j, (track, noise) in enumerate(zip(observation.objects, noises, strict=True)):
            for axis in np.flatnonzero(noise.shared.any(axis=1)):
                shared.append((owners == j)[:, None] * noise.shared[axis])
                index.append(3 * materials.index(track.object.material) + int(axis))
        return _ObservedPoints(
            np.concatenate([each[mask] for each, mask in zip(times, counted, strict=True)]),
            np.concatenate(
                [noise.whitening[mask] for noise, mask in zip(noises, counted, strict=True)]
            ),
            np.array(shared).reshape(-1, owners.size, 3),
            np.array(index, dtype=np.int64),
        )


def _block(
    members: list[int],
    initial_states: list[InitialStateDeviations],
    influence: NDArray[np.bool_],
    points: list[_ObservedPoints],
) -> ObservationBlock:
    most, shared_count = max(points[i].times.size for i in members), len(points[members[0]].shared)
    padded = np.full((len(members), most), np.nan)
    whitening = np.zeros((len(members), most, 3, 3))
    shared = np.zeros((len(members), shared_count, most, 3))
    for row, i in enumerate(members):
        size = points[i].times.size
        padded[row, :size] = points[i].times
        whitening[row, :size] = points[i].whitening
        shared[row, :, :size] = points[i].shared
    deviations = np.array([initial_states[i].standard_deviations for i in members])
    return ObservationBlock(
        np.array(members),
        InitialStates.of([initial_states[i] for i in members]),
        np.array([np.flatnonzero(influence[i]) for i in members]),
        padded,
        np.arange(padded.shape[1]),
        np.nanmax(padded, axis=1),
        np.hstack([deviations, np.ones((len(members), shared_count))]),
        whitening,
        shared,
        np.array([points[i].shared_index for i in members]),
    )
