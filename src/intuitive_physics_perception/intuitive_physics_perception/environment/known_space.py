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
from intuitive_physics.kernels import entry, kernel
from intuitive_physics_perception.environment.noise import CHANGE_SIGMAS, RangeNoise

KNOWN, NEW, UNKNOWN = 1, 2, 3
"""Marks of readings before all planes: what stood there before, what came where one had looked and
nothing stood, and what lies where nobody has looked."""

PIXELS_IN_CELL = 2.0
"""Readings along a cell of directions: with its neighbours it covers the pixel beside a ray from
any place near that of the view."""

CELLS_TOGETHER = 3
"""Cells along a side of the square whose readings a cell holds."""

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
        near = [max(old.way.difference(view.way)) < SAME_PLACE for old in self._views]
        if not any(near):
            self.take(view)
            return
        k = near.index(True)
        old = self._views[k]
        empty = np.isinf(old.nearest)
        nearest = np.where(empty, view.nearest, old.nearest)
        self._views[k] = View(old.way, nearest, np.where(empty, view.farthest, old.farthest))

    def marks(self, readings: NDArray[np.float32], pose: RigidTransform) -> NDArray[np.uint8]:
        """Return what is known of where readings lie: KNOWN, NEW or UNKNOWN, (n,).

        `readings` (n, 3) m in the sensor's frame; `pose`: of the sensor.
        """
        marks = np.full(len(readings), UNKNOWN, dtype=np.uint8)
        turned, shifted = pose.matrix, pose.translation
        for view in reversed(self._views):
            turn = (view.turn @ turned).astype(np.float32)
            shift = (view.turn @ shifted + view.way.translation).astype(np.float32)
            _judge(readings, turn, shift, view.nearest, view.farthest, self._noise, marks)
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


@entry
def _judge(
    readings: Any, turn: Any, shift: Any, nearest: Any, farthest: Any, noise: Any, marks: Any
) -> None:
    """Mark readings that are still UNKNOWN by one view, whose frame `turn` and `shift` lead to."""
    side = nearest.shape[1]
    for i in range(readings.shape[0]):
        if marks[i] != UNKNOWN:
            continue
        px, py, pz = readings[i, 0], readings[i, 1], readings[i, 2]
        x = turn[0, 0] * px + turn[0, 1] * py + turn[0, 2] * pz + shift[0]
        y = turn[1, 0] * px + turn[1, 1] * py + turn[1, 2] * pz + shift[1]
        z = turn[2, 0] * px + turn[2, 1] * py + turn[2, 2] * pz + shift[2]
        length2 = x * x + y * y + z * z
        if not length2 > 0.0:
            continue
        face, row, column = _cell(x, y, z, side)
        near, far = nearest[face, row, column], farthest[face, row, column]
        if not near < np.inf:
            continue
        length = np.sqrt(length2)
        range2 = px * px + py * py + pz * pz
        variance = _variance(range2, noise) + _variance(near * near, noise)
        if length < near - CHANGE_SIGMAS * np.sqrt(variance):
            marks[i] = NEW
            continue
        beyond = CHANGE_SIGMAS * np.sqrt(_variance(range2, noise) + _variance(far * far, noise))
        # Between the two sides of an edge it is unsure whether a ray passed.
        is_edge = far - near > STEEPEST * CELLS_TOGETHER * 2.0 / side * near
        if length <= far + beyond and not (
            is_edge and length > near + CHANGE_SIGMAS * np.sqrt(variance) and length < far - beyond
        ):
            marks[i] = KNOWN


@kernel
def _variance(range2: Any, noise: Any) -> Any:
    return min(noise[0] + noise[1] * range2 * range2, noise[2])
