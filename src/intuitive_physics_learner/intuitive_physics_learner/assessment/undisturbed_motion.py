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
from dataclasses import dataclass
from operator import methodcaller

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.geometry.rotations import quaternion_product, rotate_quaternions
from intuitive_physics.simulation import Rollout, Simulator, WorldStatus
from intuitive_physics.simulation.shares import mapped_in_shares
from intuitive_physics_learner.cost.cost_function import chunks
from intuitive_physics_learner.cost.packed_observations import PackedObservations, packed_in_groups
from intuitive_physics_learner.joint_estimation.fit_horizons import FAILED_LENGTH
from intuitive_physics_learner.joint_estimation.joint_fit import JointFit
from intuitive_physics_learner.joint_estimation.normal_equations import huber_weights, robust_loss
from intuitive_physics_learner.joint_estimation.observation_blocks import LARGEST_BLOCK

MOTIONS = (64, 256)
"""Motions that are followed: first of all observations, then of those with a notable misfit."""

NOTABLE_MISFIT = 4.0
"""Loss per point of a segment above which more motions are followed: six points of noise exceed
it, 1.5 on the average, with a probability of 1e-4."""

SEGMENT = 0.2
"""Duration of a segment, s: six points at 30 Hz."""

FEWEST_POINTS = 3
"""Points over which the loss of a segment is averaged at least."""

JUMP_DISPLACEMENT, JUMP_VELOCITY = 0.01, 0.05
"""Standard deviations (m and m/s) of the jumps that points ask for. With 0.15 m/s what a hand
holds is followed as well; set by hand on the sets of seeds 100 to 105 and 130 to 137."""

SPREADS = (0.004, 0.06, 0.05, 1.0)
"""Standard deviations by which states are spread at the start of a segment, of position (m), turn
(rad), velocity (m/s) and spin (rad/s); set by hand on the same sets."""

CHAOTIC_SPEED = 0.5
"""Speed of the centre and of the surface together from which on jumps are as large as these, m/s;
set by hand."""

SMALLEST_SCALE = 0.01
"""Part of the jumps that is left to what rests: none would leave no room for rounding."""

TEMPER = 2.0
"""Loss by which a motion is drawn again e times less often: by the likelihood itself a few motions
would be left of hundreds; set by hand."""

REWEIGHTINGS = 3
"""Rounds of weighting points against outliers."""

RESTING_SPEED = 0.1
"""Mean speed of all motions of an object below which it may have come to rest, m/s; set by hand."""

RESTING_LOSS = 2.5
"""Mean loss of all later points about one place up to which it stays there: 1.5 of noise, and what
the place errs."""

VELOCITY_STEP = 1e-3
"""Time over which velocities are differences of positions, s."""

TIME_ROUNDING = 1e-6
"""Error of stamps, s, by which a segment may be longer."""


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


@dataclass(frozen=True, eq=False)
class _SeenPoints:
    """Points of A observations of O objects at up to T times, and what begins where fits stop."""

    times: NDArray[np.float64]  # (A, T) s, NaN beyond the last
    observed: NDArray[np.float64]  # (A, O, T, 3) m, without shared errors
    whitening: NDArray[np.float64]  # (A, O, T, 3, 3) 1/m, 0 where there is no point
    begin: NDArray[np.int64]  # (A,) column of the fit horizon

    @staticmethod
    def of(fit: JointFit, group: PackedObservations, rows: NDArray[np.int64]) -> _SeenPoints:
        """Take the estimate's shared errors out of what was observed."""
        observed, times = group.observed[rows].copy(), group.times[rows]
        whitening, begin = np.zeros((*observed.shape, 3)), np.zeros(rows.size, dtype=np.int64)
        place = {int(group.members[row]): a for a, row in enumerate(rows)}
        for block, fits in zip(fit.model.blocks, fit.estimate.fits, strict=True):
            moved = block.displaced(np.zeros((*block.times.shape, 3)), fits.estimate)
            for k, member in enumerate(block.members.tolist()):
                if member not in place:
                    continue
                a = place[member]
                points = group.points[rows[a]]
                points = points[points >= 0]
                where = (a, *np.divmod(points, times.shape[1]))
                observed[where] -= moved[k, : points.size]
                whitening[where] = block.whitening[k, : points.size]
                begin[a] = int((times[a] <= fits.horizons[k]).sum()) - 1
        return _SeenPoints(times, observed, whitening, begin)

    @property
    def last(self) -> NDArray[np.int64]:
        """Column (A,) of the last time."""
        return np.isfinite(self.times).sum(axis=1) - 1

    def ends(self, begin: NDArray[np.int64]) -> NDArray[np.int64]:
        """Columns (A,) at which the segments end that begin after columns (A,)."""
        start = np.take_along_axis(self.times, begin[:, None], axis=1)
        inside = (self.times <= start + SEGMENT + TIME_ROUNDING).sum(axis=1) - 1
        return np.minimum(np.maximum(inside, begin + 1), self.last)

    def stays(self, row: int, column: int, places: NDArray[np.float64]) -> bool:
        """Whether an observation's objects stay at places (O, 3) in m after a column."""
        after = slice(column + 1, self.last[row] + 1)
        offsets = places[:, None] - self.observed[row, :, after]
        whitening = self.whitening[row, :, after]
        there = whitening.any(axis=(2, 3))
        lengths = np.linalg.norm((whitening @ offsets[..., None])[..., 0], axis=-1)[there]
        return bool(robust_loss(lengths).mean() < RESTING_LOSS)

    def segment(
        self, rows: NDArray[np.int64], begin: NDArray[np.int64], end: NDArray[np.int64]
    ) -> _SeenPoints:
        """Return the points of some observations after columns `begin` up to `end`, both (a,)."""
        columns = begin[:, None] + 1 + np.arange((end - begin).max())
        there = columns <= end[:, None]
        at = rows[:, None], np.where(there, columns, 0)
        observed = self.observed.swapaxes(1, 2)[at].swapaxes(1, 2)
        whitening = self.whitening.swapaxes(1, 2)[at].swapaxes(1, 2)
        return _SeenPoints(
            np.where(there, self.times[at], np.nan),
            observed,
            whitening * there[:, None, :, None, None],
            self.begin[rows],
        )

    @property
    def precisions(self) -> NDArray[np.float64]:
        """Mean 1/σ² (a, O, C) of the axes of each point, 0 where there is none."""
        return (self.whitening**2).sum(axis=(3, 4)) / 3.0

    def losses(self, offsets: NDArray[np.float64]) -> NDArray[np.float64]:
        """Losses (a, K, O, C) of offsets (a, K, O, C, 3) m from the points."""
        whitened = (self.whitening[:, None] @ offsets[..., None])[..., 0]
        lengths = np.linalg.norm(whitened, axis=-1)
        lengths = np.nan_to_num(lengths, nan=FAILED_LENGTH, posinf=FAILED_LENGTH)
        there = self.precisions[:, None] > 0.0
        return np.where(there, robust_loss(lengths), 0.0)


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
        self._points = _SeenPoints.of(fit, group, rows)
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
        points = self._points
        every = np.arange(len(points.times))
        begun = points.begin
        offsets, ends = self._simulated(every, 0 * begun - 1, begun)
        seen = points.segment(every, 0 * begun - 1, begun)
        self._draw_again(every, seen.losses(offsets).sum(axis=(2, 3)), ends)
        going = every[begun < points.last]
        while going.size and seconds_left() > 0.0:
            ends_at = points.ends(begun)
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
        jump = _jump(offsets, seen.times - start[:, None], seen.precisions, self._scales[rows])
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
        start = np.where(begin < 0, 0.0, self._points.times[rows, begin])
        counts = end - begin
        asked = np.full((rows.size, counts.max() + 1), np.nan)
        asked[:, :-1] = seen.times - start[:, None]
        every = np.arange(rows.size)
        asked[every, counts] = asked[every, counts - 1] + VELOCITY_STEP
        worlds = self._worlds.taken(
            np.repeat(rows, shape[1]), states=states.reshape(-1, *states.shape[2:])
        )
        rollout = self._simulator.rollout_batch(worlds, np.repeat(asked, shape[1], axis=0))
        ends = _states_at(rollout, np.repeat(counts - 1, shape[1]))
        failed = rollout.status != WorldStatus.OK
        ends[failed] = np.nan
        positions = np.where(failed[:, None, None, None], np.nan, rollout.positions[:, :, :-1])
        return positions.reshape(*shape, -1, 3) - seen.observed[:, None], ends.reshape(states.shape)

    def _draw_again(
        self, rows: NDArray[np.int64], losses: NDArray[np.float64], ends: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Begin the next segment at states drawn from `ends` (a, K, O, 13) by losses (a, K).

        Returns the mean speed (a,) of the motions in m/s; infinite where all have failed.
        """
        count = losses.shape[1]
        failed = ~np.isfinite(ends).all(axis=(2, 3))
        weights = np.exp(-(losses - losses.min(axis=1, keepdims=True)) / TEMPER)
        weights = np.where(failed, 0.0, weights) + np.finfo(float).tiny
        levels = weights.cumsum(axis=1) / weights.sum(axis=1, keepdims=True)
        asked = (np.arange(count) + self._generator.random((rows.size, 1))) / count
        drawn = (levels[:, None, :] < asked[:, :, None]).sum(axis=2).clip(max=count - 1)
        states = np.take_along_axis(ends, drawn[..., None, None], axis=1)
        states = np.where(
            np.isfinite(states).all(axis=(2, 3), keepdims=True), states, self._states[rows]
        )
        speeds = np.linalg.norm(states[..., 7:10], axis=-1)
        speeds += self._radii[rows, None] * np.linalg.norm(states[..., 10:13], axis=-1)
        scales = np.clip(speeds / CHAOTIC_SPEED, SMALLEST_SCALE, 1.0)
        self._scales[rows] = scales
        position, turn, velocity, spin = (
            scales[..., None] * self._generator.normal(0.0, spread, (*scales.shape, 3))
            for spread in SPREADS
        )
        states[..., :3] += position
        states[..., 3:7] = rotate_quaternions(states[..., 3:7], turn)
        states[..., 7:10] += velocity
        states[..., 10:13] += spin
        self._states[rows] = states
        return np.asarray(speeds.max(axis=2).mean(axis=1))


@dataclass(frozen=True, eq=False)
class _Jump:
    """Jumps that points ask for at the start of a segment, of a · K motions of O objects."""

    displacements: NDArray[np.float64]  # (a, K, O, 3) m
    velocities: NDArray[np.float64]  # (a, K, O, 3) m/s
    losses: NDArray[np.float64]  # (a, K) by their priors
    offsets: NDArray[np.float64]  # (a, K, O, C, 3) m, left between motions and points


def _jump(
    offsets: NDArray[np.float64],
    times: NDArray[np.float64],
    precisions: NDArray[np.float64],
    scales: NDArray[np.float64],
) -> _Jump:
    """Fit jumps to offsets (a, K, O, C, 3) m, robustly, as if the motion did not depend on them.

    `times` (a, C) s since the start of the segment, NaN beyond its last; `precisions` (a, O, C)
    1/m²; `scales` (a, K, O) of the priors.
    """
    known = precisions[:, None] > 0.0
    finite = np.where(np.isfinite(offsets) & known[..., None], offsets, 0.0)
    since = np.nan_to_num(times)[:, None, None]
    prior = (JUMP_DISPLACEMENT * scales) ** -2, (JUMP_VELOCITY * scales) ** -2
    weights = np.broadcast_to(precisions[:, None], finite.shape[:-1])
    for _ in range(REWEIGHTINGS):
        zeroth, second = weights.sum(axis=3) + prior[0], (weights * since**2).sum(axis=3) + prior[1]
        first = (weights * since).sum(axis=3)
        sums = np.einsum("akoc,akoci->akoi", weights, finite)
        moments = np.einsum("akoc,akoci->akoi", weights * since, finite)
        determinant = (zeroth * second - first**2)[..., None]
        displacements = (second[..., None] * sums - first[..., None] * moments) / determinant
        velocities = (zeroth[..., None] * moments - first[..., None] * sums) / determinant
        moved = displacements[..., None, :] + velocities[..., None, :] * since[..., None]
        lengths = np.linalg.norm(finite - moved, axis=-1) * np.sqrt(precisions[:, None])
        weights = precisions[:, None] * huber_weights(lengths)
    squares = prior[0] * (displacements**2).sum(axis=3) + prior[1] * (velocities**2).sum(axis=3)
    return _Jump(displacements, velocities, 0.5 * squares.sum(axis=2), offsets - moved)


def _states_at(rollout: Rollout, columns: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return states (N, O, 13) at columns (N,), velocities as differences to the columns after."""
    every = np.arange(columns.size)
    positions, turns = rollout.positions, np.asarray(rollout.orientations)
    here, there = positions[every, :, columns], positions[every, :, columns + 1]
    before, after = turns[every, :, columns], turns[every, :, columns + 1]
    turned = quaternion_product(after, before * [-1.0, -1.0, -1.0, 1.0])
    spins = 2.0 * np.sign(turned[..., 3:]) * turned[..., :3] / VELOCITY_STEP
    return np.concatenate([here, before, (there - here) / VELOCITY_STEP, spins], axis=-1)
