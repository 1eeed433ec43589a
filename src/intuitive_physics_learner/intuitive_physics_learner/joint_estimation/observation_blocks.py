"""Observations of the same size side by side, whose small matrices are worked on at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.observation import Observation
from intuitive_physics_learner.cost.packed_observations import times_after_start
from intuitive_physics_learner.joint_estimation.initial_state_deviations import (
    BelievedStates,
    InitialStateDeviations,
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
