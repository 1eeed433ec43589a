"""What has been seen of the space about a sensor: where it is free, where something stands, and
where nobody has looked yet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.frames.change_of_frame import RigidTransform
from intuitive_physics.kernels import allocating_entry, entry, kernel
from intuitive_physics_perception.environment.noise import CHANGE_SIGMAS, RangeNoise

KNOWN, NEW, UNKNOWN, BEHIND = 1, 2, 3, 4
"""Marks of readings before all planes: what stood there before, what came where one had looked and
nothing stood, and what lies where nobody has looked, in a direction in which no ray from the same
place has shown anything, or behind what it has shown: there looking once more shows no more."""

PIXELS_IN_CELL = 2.0
"""Readings along a cell of directions: with its neighbours it covers the pixel beside a ray from
any place near that of the view."""

CELLS_TOGETHER = 3
"""Cells along a side of the square whose readings a cell holds."""

BLOCK = 256
"""Readings that are judged together: they fit into the nearest cache."""

MOST_VIEWS = 8
"""Views that are kept, of which the one of the environment's model always is: bounds the time of a
frame. A turn by 360° with an image of 60° takes six."""


SAME_PLACE = 1e-9
"""Shift in m, and turn in rad, up to which two views are from one place: numerical."""

STEEPEST = 5.0
"""Slope of a surface, away from the line of sight, up to which all between the nearest and the
farthest reading of a cell is the surface: what goes back more steeply is an edge."""


@dataclass(frozen=True, eq=False)
class View:
    """Ranges that were read from one place, by direction.

    A cell of directions holds what its neighbours do, too, so that a ray from elsewhere finds the
    surface beside it. Directions are those of the faces of a cube about the sensor.

    Parameters
    ----------
    way : from the frame that stands still to that of the sensor
    nearest, farthest : (6, side, side) float32 m by face of the cube; inf and -inf where nothing
        was read
    """

    way: RigidTransform
    nearest: NDArray[np.float32]
    farthest: NDArray[np.float32]

    @cached_property
    def turn(self) -> NDArray[np.float64]:
        """Rotation (3, 3) of the way."""
        return self.way.matrix

    def is_from(self, way: RigidTransform) -> bool:
        """Whether a way leads to the place of this view."""
        return max(self.way.difference(way)) < SAME_PLACE

    def fill(self, other: View) -> None:
        """Enter what another view from the same place shows where this one shows nothing."""
        for face in np.flatnonzero(np.isfinite(other.nearest).any(axis=(1, 2))).tolist():
            empty = np.isinf(self.nearest[face])
            np.copyto(self.nearest[face], other.nearest[face], where=empty)
            np.copyto(self.farthest[face], other.farthest[face], where=empty)


class KnownSpace:
    """The space that a sensor has looked at, from one place or from several, in a frame that stands
    still.

    Each ray to a reading was free up to it. A later reading is compared with the newest view that
    has a range in its direction: nearer than the surface seen there it is new, at that surface it
    was there before. Behind that surface an older view decides; without one the place is unknown.

    Parameters
    ----------
    noise : of the readings
    spacing : rad, angle between neighbouring readings
    """

    def __init__(self, noise: RangeNoise, spacing: float) -> None:
        self._noise = noise.squares[:3].astype(np.float32)
        self._side = int(np.ceil(2.0 / (PIXELS_IN_CELL * max(spacing, 1e-4))))
        self._views: list[View] = []

    def view(self, clouds: Sequence[NDArray[np.float32]], pose: RigidTransform) -> View:
        """Return the view of frames from one place.

        `clouds` (height, width, 3) m each, NaN where nothing was read; `pose`: of the sensor.
        """
        shape = (6, self._side, self._side)
        nearest = np.full(shape, np.inf, dtype=np.float32)
        farthest = np.full(shape, -np.inf, dtype=np.float32)
        for cloud in clouds:
            _enter(cloud.reshape(-1, 3), nearest, farthest)
        return View(pose.inverse, *_spread(nearest, farthest))

    def take(self, view: View) -> None:
        """Take a view, the newest one; the oldest but the first goes where there are too many."""
        self._views.append(view)
        if len(self._views) > MOST_VIEWS:
            del self._views[1]

    def fill(self, view: View) -> None:
        """Take what a view shows that the one from the same place did not, if there is one: a
        scanner whose pattern does not repeat fills it frame after frame."""
        for old in self._views:
            if old.is_from(view.way):
                old.fill(view)
                return
        self.take(view)

    def marks(
        self, points: NDArray[np.float32], before: NDArray[np.int64], pose: RigidTransform
    ) -> NDArray[np.uint8]:
        """Return what is known of where some readings of a frame lie: KNOWN, NEW, UNKNOWN or
        BEHIND, 0 of all others, (n,).

        `points` (n, 3) m in the sensor's frame; `before` (m,) indices of those readings; `pose`: of
        the sensor.
        """
        marks = np.zeros(len(points), dtype=np.uint8)
        marks[before] = UNKNOWN
        left = before.copy()
        turned, shifted, here = pose.matrix, pose.translation, pose.inverse
        for view in reversed(self._views):
            turn = (view.turn @ turned).astype(np.float32)
            shift = (view.turn @ shifted + view.way.translation).astype(np.float32)
            undecided = BEHIND if view.is_from(here) else UNKNOWN
            seen = view.nearest, view.farthest
            left = left[: _judge(points, left, turn, shift, *seen, self._noise, undecided, marks)]
        return marks


@kernel
def _cell(x: Any, y: Any, z: Any, side: int) -> tuple[int, int, int]:
    """Face of the cube, row and column of a direction."""
    ax, ay, az = abs(x), abs(y), abs(z)
    if az >= ax and az >= ay:
        face, length, a, b = 0 if z > 0.0 else 1, az, x, y
    elif ax >= ay:
        face, length, a, b = 2 if x > 0.0 else 3, ax, y, z
    else:
        face, length, a, b = 4 if y > 0.0 else 5, ay, x, z
    half = 0.5 * side / length
    row = min(int(a * half + 0.5 * side), side - 1)
    column = min(int(b * half + 0.5 * side), side - 1)
    return face, row, column


@entry
def _enter(points: Any, nearest: Any, farthest: Any) -> None:
    """Enter points (n, 3) m into the cells of their directions."""
    side = nearest.shape[1]
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        range2 = x * x + y * y + z * z
        # NaN compares false with everything.
        if range2 > 0.0:
            face, row, column = _cell(x, y, z, side)
            length = np.sqrt(range2)
            nearest[face, row, column] = min(nearest[face, row, column], length)
            farthest[face, row, column] = max(farthest[face, row, column], length)


def _spread(
    nearest: NDArray[np.float32], farthest: NDArray[np.float32]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Give each cell what its neighbours on the same face hold."""
    from scipy.ndimage import maximum_filter, minimum_filter

    wide_nearest, wide_farthest = nearest.copy(), farthest.copy()
    for face in range(6):
        filled = np.isfinite(nearest[face])
        if not filled.any():
            continue
        rows, columns = np.flatnonzero(filled.any(axis=1)), np.flatnonzero(filled.any(axis=0))
        around = (
            face,
            slice(max(rows[0] - 1, 0), rows[-1] + 2),
            slice(max(columns[0] - 1, 0), columns[-1] + 2),
        )
        wide_nearest[around] = minimum_filter(nearest[around], CELLS_TOGETHER, mode="nearest")
        wide_farthest[around] = maximum_filter(farthest[around], CELLS_TOGETHER, mode="nearest")
    return wide_nearest, wide_farthest


@allocating_entry
def _judge(
    points: Any,
    left: Any,
    turn: Any,
    shift: Any,
    nearest: Any,
    farthest: Any,
    noise: Any,
    undecided: int,
    marks: Any,
) -> int:
    """Mark readings that no newer view has decided by one view; move those that it does not decide
    either to the front of `left`, and return their number.

    `points` (n, 3) m and `marks` (n,) of a frame, `left` (m,) indices of those readings; `turn` (3,
    3) and `shift` (3,) m: into the frame of the view; `undecided` : mark of those in a direction in
    which it shows something, but not whether they are known or new.
    """
    count = 0
    rays = np.empty((7, BLOCK), dtype=np.float32)
    cells = np.empty(BLOCK, dtype=np.int64)
    found = np.empty(BLOCK, dtype=np.uint8)
    for first in range(0, left.size, BLOCK):
        some = left[first : first + BLOCK]
        _turn_into_view(rays, points, some, turn, shift)
        _look_up(rays, cells, some.size, nearest, farthest)
        _compare(found, rays, some.size, noise, nearest.shape[1])
        for i in range(some.size):
            number = some[i]
            if found[i] == KNOWN or found[i] == NEW:
                marks[number] = found[i]
                continue
            if found[i] == BEHIND and marks[number] == UNKNOWN:
                marks[number] = undecided
            left[count] = number
            count += 1
    return count


@kernel
def _turn_into_view(rays: Any, points: Any, some: Any, turn: Any, shift: Any) -> None:
    """Enter some readings into rays (7, size), a row each for the coordinates in the frame of a
    view, for the square of the range, and for that of the distance from the view."""
    x, y, z, ranges2, lengths2 = rays[0], rays[1], rays[2], rays[3], rays[4]
    for i in range(some.size):
        x[i], y[i], z[i] = points[some[i], 0], points[some[i], 1], points[some[i], 2]
    for i in range(some.size):
        px, py, pz = x[i], y[i], z[i]
        ranges2[i] = px * px + py * py + pz * pz
        x[i] = turn[0, 0] * px + turn[0, 1] * py + turn[0, 2] * pz + shift[0]
        y[i] = turn[1, 0] * px + turn[1, 1] * py + turn[1, 2] * pz + shift[1]
        z[i] = turn[2, 0] * px + turn[2, 1] * py + turn[2, 2] * pz + shift[2]
        lengths2[i] = x[i] * x[i] + y[i] * y[i] + z[i] * z[i]


@kernel
def _look_up(rays: Any, cells: Any, n: int, nearest: Any, farthest: Any) -> None:
    """Enter the nearest and the farthest range that a view has in the direction of each of n
    readings into two more rows of rays, by cells (size,) in a row."""
    x, y, z, lengths2, nears, fars = rays[0], rays[1], rays[2], rays[4], rays[5], rays[6]
    side = nearest.shape[1]
    for i in range(n):
        face, row, column = _cell(x[i], y[i], z[i], side)
        # What is read where the view was has no direction.
        cells[i] = (face * side + row) * side + column if lengths2[i] > 0.0 else 0
    flat_nearest, flat_farthest = nearest.reshape(-1), farthest.reshape(-1)
    for i in range(n):
        nears[i], fars[i] = flat_nearest[cells[i]], flat_farthest[cells[i]]


@kernel
def _compare(found: Any, rays: Any, n: int, noise: Any, side: int) -> None:
    """Find n readings, as `_look_up` has them, KNOWN, NEW or BEHIND what the view shows in their
    direction; 0 where it shows nothing. Without a branch it is vector code."""
    ranges2, lengths2, nears, fars = rays[3], rays[4], rays[5], rays[6]
    steep = STEEPEST * CELLS_TOGETHER * 2.0 / side
    for i in range(n):
        near, far, length = nears[i], fars[i], np.sqrt(lengths2[i])
        variance = _variance(ranges2[i], noise)
        before = CHANGE_SIGMAS * np.sqrt(variance + _variance(near * near, noise))
        beyond = CHANGE_SIGMAS * np.sqrt(variance + _variance(far * far, noise))
        # Between the two sides of an edge it is unsure whether a ray passed.
        is_edge = far - near > steep * near
        is_between = is_edge & (length > near + before) & (length < far - beyond)
        is_known = (length <= far + beyond) & ~is_between
        mark = BEHIND + (KNOWN - BEHIND) * is_known
        mark += (NEW - mark) * (length < near - before)
        found[i] = mark * ((near < np.inf) & (length > 0.0))


@kernel
def _variance(range2: Any, noise: Any) -> Any:
    return min(noise[0] + noise[1] * range2 * range2, noise[2])
