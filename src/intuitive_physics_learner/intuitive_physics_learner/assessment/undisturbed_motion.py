"""Whether any undisturbed motion goes on from where a fit stops as an object was seen to go on.

Where motion is chaotic, that of the estimate is soon another one than what was observed. So many
motions are followed from the fit horizon on, as by a particle filter (Gordon, Salmond and Smith
1993, *Novel approach to nonlinear/non-Gaussian Bayesian state estimation*). The time is cut into
segments. Each begins with a jump from a state that the motions before it have reached: states are
drawn again by how well they explained what was observed, and spread a little; then position and
velocity jump as the points of the segment ask for, with Gaussian priors. The loss of a segment is
that of its points and of this jump. A kick, a hand, or another object that is taken for this one
needs jumps that the priors do not allow, whatever the shape and however chaotic the motion was.

What is slow bears no chaos, so that all jumps are the smaller the slower an object is. What has
come to rest, and stays there as long as it was seen, is followed no longer.
"""

from __future__ import annotations

from collections.abc import Callable
from operator import methodcaller

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.simulation import Simulator
from intuitive_physics.simulation.shares import mapped_in_shares
from intuitive_physics_learner.cost.cost_function import chunks
from intuitive_physics_learner.cost.packed_observations import PackedObservations, packed_in_groups
from intuitive_physics_learner.joint_estimation.joint_fit import JointFit
from intuitive_physics_learner.joint_estimation.observation_blocks import LARGEST_BLOCK
from intuitive_physics_learner.segmented_estimation.chaotic_states import (
    CHANGE_SPREADS,
    RESTING_SPEED,
    chaos_scales,
    drawn_again,
    followed,
    moved,
    surface_speeds,
)
from intuitive_physics_learner.segmented_estimation.jumps import asked_jump
from intuitive_physics_learner.segmented_estimation.seen_points import FEWEST_POINTS, SeenPoints

MOTIONS = (64, 256)
"""Motions that are followed: first of all observations, then of those with a notable misfit."""

NOTABLE_MISFIT = 4.0
"""Loss per point of a segment above which more motions are followed: six points of noise exceed
it, 1.5 on the average, with a probability of 1e-4."""

SEGMENT = 0.2
"""Duration of a segment, s: six points at 30 Hz."""


def undisturbed_misfits(
    fit: JointFit,
    simulator: Simulator,
    generator: np.random.Generator,
    seconds_left: Callable[[], float] = lambda: np.inf,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Follow undisturbed motions of all observations, until no time is left.

    Returns
    -------
    misfits : (n_observations,) loss per point of the segment that is explained worst, 1.5 where
        noise is left alone; NaN where the fit includes all points, or no segment was followed
    times : (n_observations,) s after the start, where that segment begins
    """
    cost = fit.model.cost
    misfits, times = np.full((2, len(cost.observations)), np.nan)
    groups = packed_in_groups(cost.observations, cost.materials)
    asked = np.ones(misfits.size, dtype=bool)
    for count in MOTIONS:
        if seconds_left() <= 0.0:
            break
        states = fit.state_draws(generator, count)
        shares = [
            (group, rows)
            for group in groups
            for rows in chunks(np.flatnonzero(asked[group.members]), LARGEST_BLOCK)
        ]
        followed = [
            _Motions(fit, simulator, group, rows, states[group.members[rows]], own)
            for (group, rows), own in zip(shares, generator.spawn(len(shares)), strict=True)
        ]
        follow = methodcaller("follow", seconds_left)
        mapped_in_shares(follow, followed, simulator.threads)
        for (group, rows), motions in zip(shares, followed, strict=True):
            members = group.members[rows]
            # Of a second look that was not ended the worst segment may be missing.
            better = ~(motions.misfits >= misfits[members])
            better &= motions.ended | np.isnan(misfits[members])
            misfits[members[better]] = motions.misfits[better]
            times[members[better]] = motions.times[better]
        asked = misfits > NOTABLE_MISFIT
    return misfits, times


def worst_of_motions(
    misfits: NDArray[np.float64], times: NDArray[np.float64], origins: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the misfit and its time (n_observations,) of each observation's worst motion.

    `misfits` (n_motions,) and `times` (n_motions,) as `undisturbed_misfits`; `origins` (n_motions,)
    index of the observation that each is a part of; each has one at least.
    """
    order = np.lexsort([np.nan_to_num(misfits), origins])
    last = np.append(np.diff(origins[order]) > 0, True)
    worst = order[last]
    return misfits[worst], times[worst]


class _Motions:
    """K motions of each of A observations of a group, under the estimate of θ_s.

    `rows` (A,) of the observations in their group; `states` (A, K, ≥ O, 13) in which they begin.

    Attributes
    ----------
    misfits : (A,) largest loss per point of a segment so far; NaN without one
    times : (A,) s, where it begins
    ended : whether all were followed to their ends
    """

    def __init__(
        self,
        fit: JointFit,
        simulator: Simulator,
        group: PackedObservations,
        rows: NDArray[np.int64],
        states: NDArray[np.float64],
        generator: np.random.Generator,
    ) -> None:
        self._simulator, self._generator = simulator, generator
        self._points = SeenPoints.of(fit, group, rows)
        self._worlds = group.worlds.taken(rows).crossed([fit.model.space.to_parameters(fit.unit)])
        observations = [fit.model.cost.observations[member] for member in group.members[rows]]
        self._radii = np.array(
            [[one.object.shape.bounding_radius for one in each.objects] for each in observations]
        )
        self._states = states[:, :, : self._radii.shape[1]].copy()
        self._scales = np.ones(self._states.shape[:3])
        self.misfits, self.times = np.full((2, rows.size), np.nan)
        self.ended = False

    def follow(self, seconds_left: Callable[[], float]) -> None:
        """Follow them to the fit horizons as they are, and then in segments that begin by jumps."""
        if seconds_left() <= 0.0:
            return
        points = self._points
        every = np.arange(len(points.times))
        begun = points.begin
        offsets, ends = self._simulated(every, 0 * begun - 1, begun)
        seen = points.segment(every, 0 * begun - 1, begun)
        self._draw_again(every, seen.losses(offsets).sum(axis=(2, 3)), ends)
        going = every[begun < points.last]
        while going.size and seconds_left() > 0.0:
            ends_at = points.ends(begun, SEGMENT)
            resting = self._segment(going, begun[going], ends_at[going])
            begun = np.where(np.isin(every, going), ends_at, begun)
            going = going[~resting & (begun[going] < points.last[going])]
        self.ended = not going.size

    def _segment(
        self, rows: NDArray[np.int64], begin: NDArray[np.int64], end: NDArray[np.int64]
    ) -> NDArray[np.bool_]:
        """Follow some observations after columns `begin` to `end` (a,); return which then rest."""
        seen = self._points.segment(rows, begin, end)
        offsets, ends = self._simulated(rows, begin, end)
        start = self._points.times[rows, begin]
        span = self._points.times[rows, end] - start
        jump = asked_jump(offsets, seen.times - start[:, None], seen.precisions, self._scales[rows])
        losses = jump.losses + seen.losses(jump.offsets).sum(axis=(2, 3))
        ends[..., :3] -= jump.displacements + jump.velocities * span[:, None, None, None]
        ends[..., 7:10] -= jump.velocities
        counts = np.maximum((seen.precisions > 0.0).sum(axis=(1, 2)), FEWEST_POINTS)
        best = losses.argmin(axis=1)
        misfits = losses.min(axis=1) / counts
        worse = ~(misfits <= self.misfits[rows])
        self.misfits[rows[worse]] = misfits[worse]
        self.times[rows[worse]] = seen.times[worse, 0]
        slow = (self._draw_again(rows, losses, ends) < RESTING_SPEED) & (
            end < self._points.last[rows]
        )
        places = ends[np.arange(rows.size), best, :, :3]
        resting = [
            bool(slow[a]) and self._points.stays(int(row), int(end[a]), places[a])
            for a, row in enumerate(rows)
        ]
        return np.array(resting, dtype=bool)

    def _simulated(
        self, rows: NDArray[np.int64], begin: NDArray[np.int64], end: NDArray[np.int64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Simulate the motions of some observations from after columns `begin` to `end` (a,).

        Returns offsets (a, K, O, C, 3) in m from the points, and states (a, K, O, 13) at the end;
        NaN where a simulation failed.
        """
        seen = self._points.segment(rows, begin, end)
        states = self._states[rows]
        shape = states.shape[:3]
        start = self._points.starts(rows, begin)
        worlds = self._worlds.taken(
            np.repeat(rows, shape[1]), states=states.reshape(-1, *states.shape[2:])
        )
        since = seen.times - start[:, None]
        positions, ends = followed(self._simulator, worlds, since, shape[1])
        return positions.reshape(*shape, -1, 3) - seen.observed[:, None], ends.reshape(states.shape)

    def _draw_again(
        self, rows: NDArray[np.int64], losses: NDArray[np.float64], ends: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Begin the next segment at states drawn from `ends` (a, K, O, 13) by losses (a, K).

        Returns the mean speed (a,) of the motions in m/s; infinite where all have failed.
        """
        failed = np.asarray(~np.isfinite(ends).all(axis=(2, 3)))
        drawn = drawn_again(losses, failed, self._generator)
        states = np.take_along_axis(ends, drawn[..., None, None], axis=1)
        states = np.where(
            np.isfinite(states).all(axis=(2, 3), keepdims=True), states, self._states[rows]
        )
        speeds = surface_speeds(states, self._radii[rows, None])
        scales = chaos_scales(speeds)
        self._scales[rows] = scales
        spread = self._generator.normal(size=(*scales.shape, 12)) * CHANGE_SPREADS
        self._states[rows] = moved(states, scales[..., None] * spread)
        return np.asarray(speeds.max(axis=2).mean(axis=1))
