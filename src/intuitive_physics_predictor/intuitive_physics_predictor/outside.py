"""Draws of θ_d that can be: conditioned on objects being outside of surfaces and of each other.

The density of a sample's states is that of `StateSpread` where every object is outside of the
planes, of the static boxes and of the other objects, and 0 elsewhere. A bounded plane is a sheet
with one side: an object over it is above it; one whose mean lies under it stays as it was drawn.

- A draw that is outside is kept as it is: far from surfaces nothing changes.
- One that is inside is drawn again, up to `REDRAWS` times (rejection: exact). A sphere inside a
  plane is drawn from the normal distribution that is cut off at that plane, so that other surfaces
  alone are left to rejection: exact too.
- What is still inside moves along the direction of the noise that parts it from the surface it is
  deepest in, to a draw of the truncated normal distribution along that line, surface after surface
  (a step of Gibbs sampling: exact where only one surface bounds the object, else close).
- Where noise cannot explain that the mean is inside, more than `EXPLAINED` standard deviations of
  the gap, the mean is lifted until it can; where no noise parts them, to the surface. Draws then
  lie close above it.
- A sample whose objects overlap is drawn again as a whole, up to `PAIR_REDRAWS` times, then parted
  in the same way; what no room is found for is left, and engines part it.

Of an object whose state is estimated by samples, those that are outside are used
(`WeightedStates.where`); what is drawn again all the same has the moments of the estimate.

Numbers for all this are hashes of the sample's first normal deviate: the generator goes on as if
there were no surfaces.
"""

from __future__ import annotations

from math import cos, inf, log, pi, sin, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.geometry.quaternions import load_quaternion, store_quaternion, turned_by
from intuitive_physics.geometry.vectors import (
    add_scaled,
    cross,
    dot,
    load,
    norm,
    store,
    sub,
    vector_at,
)
from intuitive_physics.kernels import entry, kernel
from intuitive_physics.simulation.noisy_impacts import FIRST_MIX, GOLDEN, SECOND_MIX
from intuitive_physics.simulation.rigid_bodies.distance import separation
from intuitive_physics.simulation.rigid_bodies.overlaps import is_on_sheet
from intuitive_physics.simulation.rigid_bodies.placing import place_environment, place_shape
from intuitive_physics.simulation.rigid_bodies.planes import separation_from_plane
from intuitive_physics.simulation.rigid_bodies.poses import set_rotation, support
from intuitive_physics.simulation.rigid_bodies.scratch import Scratch, scratch_sizes
from intuitive_physics.simulation.rigid_bodies.world import body_at, plane_at
from intuitive_physics.simulation.world_batch import SPHERE, WorldArrays, WorldBatch
from intuitive_physics.state import ERROR_SIZE, POSITION, ROTATION
from intuitive_physics_predictor.noise import StateSpread, add_error

TOUCHING = 1e-9
"""m. What overlaps by less touches: rounding."""

REDRAWS, PAIR_REDRAWS = 16, 8
"""Redraws of an object inside a surface, and of a sample in which two objects overlap."""

PUSHES, LIFTS = 16, 8
"""Steps along the noise, and lifts of a mean, out of one surface each."""

SWEEPS = 8
"""Steps of each object of a sample out of what it is deepest in, the other objects included."""

EXPLAINED, UNEXPLAINED = 4.0, 8.0
"""Standard deviations. A mean deeper inside a surface than the first is lifted until it is not; a
step along the noise that would end beyond the second is no step of it."""

FROM_EDGES = 12.0
"""Standard deviations of the position from the edges of a bounded plane from which on it counts as
one without edges: no draw comes near them, even from a mean as deep inside as noise explains."""

UNDER = 0.5
"""Depth behind a bounded plane from which a mean lies under it, in inradii."""

STEP = 1e-6
"""m and rad, of the differences that slopes of a gap are made from."""

TRIES = 64
"""Attempts at a truncated deviate; each succeeds with a probability of 0.38 or more."""

WORK = np.dtype(
    [
        ("seed", "u8"),  # of the next number
        ("mean", "f8", 13),  # of the object that is placed, lifted as far as needed
        ("trial", "f8", 13),  # a state beside it
        ("slopes", "f8", 6),  # of the gap, along position (1) and rotation (m)
        ("direction", "f8", ERROR_SIZE),  # unit vector in normal deviates
    ],
    align=True,
)
"""Scratch for the object that is placed."""


def condition_on_outside(
    worlds: WorldBatch, spread: StateSpread, normal: NDArray[np.float64]
) -> None:
    """Draw again the states of samples in which an object is inside a surface or another object.

    Sizes and θ_s of a sample stay, and its states are conditioned on them.

    Parameters
    ----------
    worlds : samples of one scene, with states that are changed in place
    spread : that states are drawn from again
    normal : (n_samples, n_objects, 12) normal deviates of the samples; changed in place
    """
    scratch = Scratch(*scratch_sizes(worlds), contacts_a_body=0)
    work = np.zeros(1, WORK)
    condition_samples(worlds.arrays, scratch.world, work, spread.means, spread.roots, normal)


def objects_inside(worlds: WorldBatch, means: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which objects are inside a static box or below the surface of a plane.

    Parameters
    ----------
    worlds : samples of one scene
    means : (n_objects, 13) states that were perceived; what lies under a bounded plane may do so

    Returns
    -------
    (n_samples, n_objects)
    """
    scratch = Scratch(*scratch_sizes(worlds), contacts_a_body=0)
    inside = np.zeros((worlds.size, len(means)), dtype=bool)
    find_inside(worlds.arrays, scratch.world, means, inside)
    return inside


@entry
def condition_samples(
    batch: Any, scratch: Any, work: Any, means: Any, roots: Any, normal: Any
) -> None:
    """See `condition_on_outside`: `WorldBatch.arrays`, (1,) WORLD, (1,) WORK, normal (W, O, 12)."""
    worlds: Any = WorldArrays(*batch)
    world, room = scratch[0], work[0]
    for s in range(worlds.object_counts.size):
        _place_sample(world, worlds, s)
        # Deviates are between -16 and 16: another number for each of the 2⁵² in an octave.
        room.seed = np.uint64((normal[s, 0, 0] + 16.0) * 2.0**58)
        states = worlds.states[s]
        for i in range(world.moving):
            _settle(world, room, i, means[i], roots[i], normal[s, i], states[i])
        _part_objects(world, room, means, roots, normal[s], states)


@entry
def find_inside(batch: Any, scratch: Any, means: Any, inside: Any) -> None:
    """See `objects_inside`: `WorldBatch.arrays`, (1,) WORLD, and inside (W, O) to be filled."""
    worlds: Any = WorldArrays(*batch)
    world = scratch[0]
    for s in range(worlds.object_counts.size):
        _place_sample(world, worlds, s)
        for i in range(world.moving):
            gap, _ = _deepest(world, i, means[i], world.moving)
            inside[s, i] = gap < -TOUCHING


@kernel
def _place_sample(world: Any, worlds: Any, s: Any) -> None:
    world.moving = worlds.object_counts[s]
    place_environment(world, worlds, worlds.environment_index[s])
    for i in range(world.moving):
        kind, dimensions = worlds.shape_kinds[s, i], worlds.dimensions[s, i]
        place_shape(body_at(world, i), kind, dimensions, 0, worlds.states[s, i])


@kernel
def _settle(world: Any, room: Any, i: Any, mean: Any, root: Any, normal: Any, state: Any) -> None:
    """Bring an object outside of all that never moves, unless it is there."""
    gap, surface = _deepest(world, i, mean, world.moving)
    if gap >= -TOUCHING:
        return
    _lift_mean(world, room, i, mean, root)
    least = _half_space(world, room, i, surface, root)
    for _ in range(REDRAWS):
        _fill(room, normal)
        if least > -inf:
            _set_along(room, normal, _deviate_above(room, least))
        _place(world, room, i, root, normal, state)
        gap, _ = _deepest(world, i, mean, world.moving)
        if gap >= -TOUCHING:
            return
    _push_out(world, room, i, mean, root, normal, state)


@kernel
def _part_objects(world: Any, room: Any, means: Any, roots: Any, normal: Any, states: Any) -> None:
    """Bring the objects of a sample outside of each other, unless they are."""
    for _ in range(PAIR_REDRAWS):
        if not _objects_overlap(world):
            return
        for i in range(world.moving):
            _fill(room, normal[i])
            _set_mean(room, means[i])
            _place(world, room, i, roots[i], normal[i], states[i])
            _settle(world, room, i, means[i], roots[i], normal[i], states[i])
    for _ in range(SWEEPS):
        if not _objects_overlap(world):
            break
        for i in range(world.moving):
            gap, surface = _deepest(world, i, means[i], 0)
            if gap < -TOUCHING:
                _lift_mean(world, room, i, means[i], roots[i])
                _place(world, room, i, roots[i], normal[i], states[i])
                _step_out(world, room, i, surface, means[i], roots[i], normal[i], states[i], True)
    for i in range(world.moving):
        _set_mean(room, means[i])
        _push_out(world, room, i, means[i], roots[i], normal[i], states[i])


@kernel
def _objects_overlap(world: Any) -> Any:
    for i in range(world.moving):
        for j in range(i):
            if _gap_between(world, i, j) < -TOUCHING:
                return True
    return False


@kernel
def _push_out(world: Any, room: Any, i: Any, mean: Any, root: Any, normal: Any, state: Any) -> None:
    """Bring an object outside of what never moves by steps along its noise, then by lifts."""
    for step in range(PUSHES + LIFTS):
        gap, surface = _deepest(world, i, mean, world.moving)
        if gap >= -TOUCHING:
            return
        _step_out(world, room, i, surface, mean, root, normal, state, step < PUSHES)


@kernel
def _step_out(
    world: Any,
    room: Any,
    i: Any,
    surface: Any,
    mean: Any,
    root: Any,
    normal: Any,
    state: Any,
    by_noise: Any,
) -> None:
    """Bring an object outside of one surface along its noise, or where that is too far, by a lift.

    The state is that at the normal deviates about the mean of `room`.
    """
    gap = _gap(world, i, surface, mean)
    deviation = _find_direction(world, room, i, surface, mean, root, state, gap)
    least = _along(room, normal) - gap / deviation if deviation > 0.0 else inf
    if by_noise and least < UNEXPLAINED:
        _set_along(room, normal, _deviate_above(room, least))
    else:
        _lift(room, -gap)
    _place(world, room, i, root, normal, state)


@kernel
def _lift_mean(world: Any, room: Any, i: Any, mean: Any, root: Any) -> None:
    """Set the mean that draws are made about: as perceived, or as noise can explain it."""
    _set_mean(room, mean)
    for _ in range(LIFTS):
        _pose(body_at(world, i), room.mean)
        gap, surface = _deepest(world, i, mean, world.moving)
        if gap >= -TOUCHING:
            return
        deviation = _find_direction(world, room, i, surface, mean, root, room.mean, gap)
        if -gap <= EXPLAINED * deviation + TOUCHING:
            return
        _lift(room, -gap - EXPLAINED * deviation)


@kernel
def _set_mean(room: Any, mean: Any) -> None:
    for k in range(mean.size):
        room.mean[k] = mean[k]


@kernel
def _lift(room: Any, distance: Any) -> None:
    """Move the mean so that the gap grows by a distance (m)."""
    slopes = (room.slopes[0], room.slopes[1], room.slopes[2])
    square = dot(slopes, slopes)
    if square > STEP:
        store(room.mean[0:3], add_scaled(load(room.mean[0:3]), slopes, distance / square))


@kernel
def _place(world: Any, room: Any, i: Any, root: Any, normal: Any, state: Any) -> None:
    """Write the state at normal deviates (12,), and put the object there."""
    add_error(room.mean, root, normal, state)
    _pose(body_at(world, i), state)


@kernel
def _pose(body: Any, state: Any) -> None:
    for k in range(3):
        body.position[k] = state[k]
    for k in range(4):
        body.orientation[k] = state[3 + k]
    set_rotation(body)


@kernel
def _deepest(world: Any, i: Any, mean: Any, first: Any) -> Any:
    """Smallest gap (m) of an object to planes and bodies from `first` on, and which has it."""
    least, surface = inf, -1
    for p in range(world.plane_count):
        gap = _gap_to_side(world, i, p, mean)
        if gap < least:
            least, surface = gap, p
    for j in range(first, world.body_count):
        if j != i:
            gap = _gap_between(world, i, j)
            if gap < least:
                least, surface = gap, world.plane_count + j
    return least, surface


@kernel
def _gap(world: Any, i: Any, surface: Any, mean: Any) -> Any:
    if surface < world.plane_count:
        return _gap_to_side(world, i, surface, mean)
    return _gap_between(world, i, surface - world.plane_count)


@kernel
def _gap_to_side(world: Any, i: Any, p: Any, mean: Any) -> Any:
    """Gap (m) to the side of a plane; of what is over a bounded one but behind it, too."""
    body, plane = body_at(world, i), plane_at(world, p)
    n = load(plane.normal)
    if plane.corners > 0:
        if dot(n, load(mean[0:3])) - plane.offset < -UNDER * body.thinness:
            return inf
        height = dot(n, load(body.position)) - plane.offset
        if height <= 0.0:
            return height - support(body, n) if is_on_sheet(body, plane) else inf
    return separation_from_plane(world, i, p)[0]


@kernel
def _gap_between(world: Any, i: Any, j: Any) -> Any:
    one, other = body_at(world, i), body_at(world, j)
    reach = one.reach + other.reach
    apart = sub(load(one.position), load(other.position))
    if dot(apart, apart) >= reach * reach:
        return inf
    return separation(world, i, j)[0]


@kernel
def _half_space(world: Any, room: Any, i: Any, surface: Any, root: Any) -> Any:
    """Smallest deviate along `direction` of a sphere outside of a plane, -inf for anything else.

    The mean is that of `_lift_mean`; a plane with edges counts only far from them.
    """
    body = body_at(world, i)
    if body.kind != SPHERE or surface >= world.plane_count:
        return -inf
    plane = plane_at(world, surface)
    n, centre = load(plane.normal), load(room.mean[0:3])
    widest = 0.0
    for k in range(3):
        for j in range(ERROR_SIZE):
            widest += root[k, j] * root[k, j]
    for k in range(plane.corners):
        corner = vector_at(plane.boundary, k)
        inward = cross(n, sub(vector_at(plane.boundary, (k + 1) % plane.corners), corner))
        if dot(inward, sub(centre, corner)) < FROM_EDGES * sqrt(widest) * norm(inward):
            return -inf
    for k in range(6):
        room.slopes[k] = n[k] if k < 3 else 0.0
    deviation = _set_direction(room, root)
    if deviation == 0.0:
        return -inf
    return (plane.offset + body.radius - dot(n, centre)) / deviation


@kernel
def _find_direction(
    world: Any, room: Any, i: Any, surface: Any, mean: Any, root: Any, state: Any, gap: Any
) -> Any:
    """Set slopes of a gap at a state and the direction of its noise; return its deviation (m)."""
    body, trial = body_at(world, i), room.trial
    for k in range(3, 6):
        room.slopes[k] = 0.0
    for k in range(3 if body.kind == SPHERE else 6):
        for m in range(trial.size):
            trial[m] = state[m]
        if k < 3:
            trial[k] += STEP
        else:
            turn = (
                STEP if k == 3 else 0.0,
                STEP if k == 4 else 0.0,
                STEP if k == 5 else 0.0,
            )
            store_quaternion(trial[3:7], turned_by(load_quaternion(trial[3:7]), turn))
        _pose(body, trial)
        moved = _gap(world, i, surface, mean)
        room.slopes[k] = (moved - gap) / STEP if moved < inf else 0.0
    _pose(body, state)
    return _set_direction(room, root)


@kernel
def _set_direction(room: Any, root: Any) -> Any:
    """Set the direction of deviates that a gap depends on; return the gap's deviation (m)."""
    square = 0.0
    for j in range(ERROR_SIZE):
        rate = 0.0
        for k in range(3):
            rate += room.slopes[k] * root[POSITION.start + k, j]
            rate += room.slopes[3 + k] * root[ROTATION.start + k, j]
        room.direction[j] = rate
        square += rate * rate
    deviation = sqrt(square)
    if deviation < TOUCHING:
        return 0.0
    for j in range(ERROR_SIZE):
        room.direction[j] /= deviation
    return deviation


@kernel
def _along(room: Any, normal: Any) -> Any:
    total = 0.0
    for j in range(ERROR_SIZE):
        total += room.direction[j] * normal[j]
    return total


@kernel
def _set_along(room: Any, normal: Any, deviate: Any) -> None:
    """Move deviates (12,) along the direction, to where their part along it is `deviate`."""
    change = deviate - _along(room, normal)
    for j in range(ERROR_SIZE):
        normal[j] += change * room.direction[j]


@kernel
def _fill(room: Any, normal: Any) -> None:
    for j in range(ERROR_SIZE // 2):
        normal[2 * j], normal[2 * j + 1] = _two_deviates(room)


@kernel
def _uniform(room: Any) -> Any:
    """The next number of SplitMix64, above 0 and at most 1."""
    room.seed += GOLDEN
    x = room.seed
    x = (x ^ (x >> np.uint64(30))) * FIRST_MIX
    x = (x ^ (x >> np.uint64(27))) * SECOND_MIX
    x = x ^ (x >> np.uint64(31))
    return (np.float64(x >> np.uint64(11)) + 1.0) * 2.0**-53


@kernel
def _two_deviates(room: Any) -> Any:
    """Draw two independent normal deviates (Box and Muller)."""
    size = sqrt(-2.0 * log(_uniform(room)))
    angle = 2.0 * pi * _uniform(room)
    return size * cos(angle), size * sin(angle)


@kernel
def _deviate_above(room: Any, least: Any) -> Any:
    """Draw a normal deviate that is not below a number (Robert 1995)."""
    rate = 0.5 * (least + sqrt(least * least + 4.0))
    for _ in range(TRIES):
        if least < 0.3:
            z, _ = _two_deviates(room)
            if z >= least:
                return z
        else:
            z = least - log(_uniform(room)) / rate
            if log(_uniform(room)) <= -0.5 * (z - rate) ** 2:
                return z
    return max(least, 0.0)
