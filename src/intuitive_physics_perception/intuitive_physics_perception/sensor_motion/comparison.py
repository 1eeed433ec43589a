"""How a frame fits the landmarks of a view, from where the sensor may be."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.frames.change_of_frame import RigidTransform
from intuitive_physics.kernels import entry, kernel
from intuitive_physics_perception.environment.noise import GAUSSIAN_MAD, RangeNoise
from intuitive_physics_perception.environment.ray_planes import HIDING_DEPTH
from intuitive_physics_perception.environment.standing import VIEW_DISTANCE
from intuitive_physics_perception.sensor_motion.landmarks import EDGE_JUMP, MOST_THINGS, Landmarks
from intuitive_physics_perception.sensor_motion.lens import pixel_of

TUKEY = 4.685
"""Standard deviations from which on a residual has no weight in Tukey's biweight: of normal errors
the estimate then has 95 % of the efficiency of least squares."""

SEARCHED = 8
"""Pixels on both sides of where an edge is expected in which it is searched."""

MISSING = 0.3
"""What a pixel without a reading on the near side of an edge counts, in wrong readings: half of
the readings beside an edge are lost, and in a stereo camera's shadow all on the far side."""

UNSEEN, AGREES, DIFFERS, HIDDEN = 0, 1, 2, 3
"""What a frame shows of a landmark."""

NEAREST = 0.1
"""Cosine between a ray and the optical axis above which it is before the sensor: numerical."""

LEAST_NEAR = 3
"""Readings on each side of an edge that show it."""

PRIOR = 1.0
"""Information of standing still, 1/m²: far below that of any landmark, so that a direction that
none determines is not moved."""


@dataclass(frozen=True, eq=False)
class Comparison:
    """A frame compared with landmarks from one pose of the sensor.

    Motions are six numbers in m about the sensor: a shift (3,) along the axes of the view, and a
    turn (3,) about them times `VIEW_DISTANCE`.

    Parameters
    ----------
    way : from the sensor's frame to that of the view
    states : (n,) what the frame shows of each
    residuals : (n,) m along the normal, NaN where there is none
    variances : (n,) m² of the residuals
    information : (n_things + 1, 6, 6) 1/m², by thing
    pulls : (n_things + 1, 6) 1/m, of each thing: the derivative of the logarithm of likelihood
    scale : of the residuals, in standard deviations
    """

    way: RigidTransform
    states: NDArray[np.uint8]
    residuals: NDArray[np.float64]
    variances: NDArray[np.float64]
    information: NDArray[np.float64]
    pulls: NDArray[np.float64]
    scale: float

    @property
    def agreeing(self) -> int:
        """Number of landmarks that are where they should be."""
        return int(np.count_nonzero(self.states == AGREES))

    @property
    def share(self) -> float:
        """Part of the landmarks that nothing hides which are where they should be."""
        differing = int(np.count_nonzero(self.states == DIFFERS))
        return self.agreeing / max(self.agreeing + differing, 1)

    @property
    def hidden(self) -> float:
        """Part of the landmarks in view that something hides."""
        hidden = int(np.count_nonzero(self.states == HIDDEN))
        return hidden / max(int(np.count_nonzero(self.states != UNSEEN)), 1)

    @property
    def residual_scale(self) -> float:
        """Robust standard deviation of the residuals that agree, in those that are expected."""
        agree = self.states == AGREES
        scaled = np.abs(self.residuals[agree]) / np.sqrt(self.variances[agree])
        return GAUSSIAN_MAD * float(np.median(scaled)) if scaled.size else np.inf

    def significance(self, *, of_all: bool = False) -> float:
        """Return the score statistic, χ² of six degrees of freedom, of a motion against none.

        `of_all`: by all things; else without the one that speaks for a motion most, as a thing that
        moves by itself is no motion of the sensor.
        """
        moved = np.flatnonzero(np.any(self.pulls[1:], axis=1)) + 1
        one_less = np.eye(len(self.pulls))[moved]
        kept = 1.0 - np.concatenate([np.zeros((1, len(self.pulls))), one_less])
        left = (kept @ self.information.reshape(-1, 36)).reshape(-1, 6, 6)
        pulls = kept @ self.pulls
        steps = np.linalg.solve(left + PRIOR * np.eye(6), pulls[:, :, None])[:, :, 0]
        values = (pulls * steps).sum(axis=1) / self.scale**2
        return float(values[0] if of_all else values.min())

    def step(self) -> NDArray[np.float64]:
        """Return the Gauss–Newton step (6,) in m."""
        whole = self.information.sum(axis=0) + PRIOR * np.eye(6)
        return np.linalg.solve(whole, self.pulls.sum(axis=0))

    def determined(self) -> NDArray[np.float64]:
        """Return the information (6, 6) in 1/m² that the frame has of a motion."""
        return np.asarray(self.information.sum(axis=0) / self.scale**2)


def compare(
    points: NDArray[np.float32],
    landmarks: Landmarks,
    way: RigidTransform,
    noise: RangeNoise,
    scale: float = 1.0,
    gate: float = 0.0,
) -> Comparison:
    """Compare a frame with landmarks.

    `points` (height, width, 3) m, NaN where nothing was read; `way`: from the sensor's frame to
    that of the landmarks; `scale`: of the residuals in standard deviations; `gate` in m: residuals
    that count beside those of the noise.
    """
    count = len(landmarks)
    states = np.zeros(count, dtype=np.uint8)
    residuals, variances = np.full(count, np.nan), landmarks.variances.copy()
    turn, shift = way.matrix, way.translation
    _measure(
        points,
        landmarks.lens,
        (landmarks.places, landmarks.normals, landmarks.is_edge),
        (turn, shift),
        _noise_numbers(points, count, noise),
        states,
        residuals,
        variances,
        np.empty(2 * SEARCHED + 1),
    )
    information = np.zeros((MOST_THINGS + 1, 6, 6))
    pulls = np.zeros((MOST_THINGS + 1, 6))
    _weigh(
        (landmarks.places, landmarks.normals, landmarks.things),
        shift,
        (scale, gate),
        residuals,
        variances,
        states,
        information,
        pulls,
    )
    return Comparison(way, states, residuals, variances, information, pulls, scale)


def _noise_numbers(
    points: NDArray[np.float32], compared: int, noise: RangeNoise
) -> NDArray[np.float64]:
    """Squares (4,) as of `RangeNoise.squares`, raised by the errors that some of the readings of a
    frame share: those farther apart than a matching window share none."""
    part = min(compared / max(points.shape[0] * points.shape[1], 1), 1.0)
    shared = 1.0 + (noise.correlated - 1.0) * part
    return np.asarray(shared * noise.squares)


@entry
def _measure(
    points: Any,
    lens: Any,
    landmarks: Any,
    pose: Any,
    noise: Any,
    states: Any,
    residuals: Any,
    variances: Any,
    lengths: Any,
) -> None:
    """Set states (n,), residuals (n,) m, and add the variances of the readings to those (n,) m² of
    the landmarks: places (n, 3), normals (n, 3) and whether they are on an edge (n,); `lengths` as
    in `_find_edge`."""
    places, normals, is_edge = landmarks
    turn, shift = pose
    for i in range(places.shape[0]):
        dx, dy, dz = places[i, 0] - shift[0], places[i, 1] - shift[1], places[i, 2] - shift[2]
        x = turn[0, 0] * dx + turn[1, 0] * dy + turn[2, 0] * dz
        y = turn[0, 1] * dx + turn[1, 1] * dy + turn[2, 1] * dz
        z = turn[0, 2] * dx + turn[1, 2] * dy + turn[2, 2] * dz
        reach = np.sqrt(x * x + y * y + z * z)
        # Beside the half-space before the sensor slopes have no meaning.
        if not z > NEAREST * reach:
            continue
        nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
        if is_edge[i]:
            ex = turn[0, 0] * nx + turn[1, 0] * ny + turn[2, 0] * nz
            ey = turn[0, 1] * nx + turn[1, 1] * ny + turn[2, 1] * nz
            ez = turn[0, 2] * nx + turn[1, 2] * ny + turn[2, 2] * nz
            states[i], residuals[i] = _find_edge(
                points, lens, (x, y, z), (ex, ey, ez), reach, lengths
            )
            continue
        row, column = pixel_of(x, y, z, lens)
        v, u = int(np.floor(row + 0.5)), int(np.floor(column + 0.5))
        if not (0 <= v < points.shape[0] and 0 <= u < points.shape[1]):
            continue
        px, py, pz = float(points[v, u, 0]), float(points[v, u, 1]), float(points[v, u, 2])
        range2 = px * px + py * py + pz * pz
        along = nx * dx + ny * dy + nz * dz
        # NaN compares false with everything; a patch is not seen from behind.
        if not range2 > 0.0 or along >= 0.0:
            continue
        if np.sqrt(range2) < reach - HIDING_DEPTH:
            states[i] = HIDDEN
            continue
        wx = turn[0, 0] * px + turn[0, 1] * py + turn[0, 2] * pz
        wy = turn[1, 0] * px + turn[1, 1] * py + turn[1, 2] * pz
        wz = turn[2, 0] * px + turn[2, 1] * py + turn[2, 2] * pz
        along = nx * wx + ny * wy + nz * wz
        cosine2 = along * along / range2
        residuals[i] = nx * (wx - dx) + ny * (wy - dy) + nz * (wz - dz)
        variance = min(noise[0] + noise[1] * range2 * range2, noise[2])
        variances[i] += variance * cosine2 + noise[3] * range2 * (1.0 - cosine2)
        states[i] = DIFFERS


@kernel
def _find_edge(
    points: Any, lens: Any, place: Any, across: Any, reach: float, lengths: Any
) -> tuple[int, float]:
    """State of an edge, and how far, m, along `across` (3,) it is from its place (3,), m.

    The edge is where the fewest readings are on the wrong side. `lengths` (2 SEARCHED + 1,): memory
    for the ranges there, m.
    """
    x, y, z = place
    row, column = pixel_of(x, y, z, lens)
    step = 1e-3 * reach
    other_row, other_column = pixel_of(
        x + step * across[0], y + step * across[1], z + step * across[2], lens
    )
    dv, du = (other_row - row) / step, (other_column - column) / step
    size = np.sqrt(dv * dv + du * du)
    dv, du = dv / size, du / size
    # Steps from one row, or column, to the next, from the middle of one.
    stretch = 1.0 / max(abs(dv), abs(du))
    if abs(dv) > abs(du):
        start = (np.floor(row + 0.5) - row) / dv
    else:
        start = (np.floor(column + 0.5) - column) / du
    margin = 0.5 * EDGE_JUMP * max(reach, 2.0)
    # What is wrong where the edge lies before the first pixel.
    wrong, near, far = 0.0, 0, 0
    for k in range(2 * SEARCHED + 1):
        at = start + (k - SEARCHED) * stretch
        lengths[k] = length = _range_at(points, row + at * dv, column + at * du)
        if length < reach - margin:
            return HIDDEN, np.nan
        if length < reach + margin:
            near, wrong = near + 1, wrong + 1.0
        elif length >= reach + margin:
            far += 1
    if near < LEAST_NEAR or far < LEAST_NEAR:
        return UNSEEN, np.nan
    least, first, last = wrong, -SEARCHED, -SEARCHED
    for k in range(-SEARCHED, SEARCHED + 1):
        length = lengths[k + SEARCHED]
        if length < reach + margin:
            wrong -= 1.0
        elif length >= reach + margin:
            wrong += 1.0
        else:
            wrong += MISSING
        # With pixel k on the near side the edge is behind it.
        if wrong < least - 1e-9:
            least, first, last = wrong, k + 1, k + 1
        elif wrong < least + 1e-9:
            last = k + 1
    return DIFFERS, (start + (0.5 * (first + last) - 0.5) * stretch) / size


@kernel
def _range_at(points: Any, row: float, column: float) -> float:
    """Range of the reading nearest to a place in the image, m; NaN without one."""
    v, u = int(np.floor(row + 0.5)), int(np.floor(column + 0.5))
    if not (0 <= v < points.shape[0] and 0 <= u < points.shape[1]):
        return np.nan
    x, y, z = float(points[v, u, 0]), float(points[v, u, 1]), float(points[v, u, 2])
    return np.sqrt(x * x + y * y + z * z)


@entry
def _weigh(
    landmarks: Any,
    shift: Any,
    limits: Any,
    residuals: Any,
    variances: Any,
    states: Any,
    information: Any,
    pulls: Any,
) -> None:
    """Weigh residuals by Tukey's biweight and add up information and pulls by thing."""
    places, normals, things = landmarks
    scale, gate = limits
    for i in range(places.shape[0]):
        if states[i] != DIFFERS:
            continue
        limit2 = TUKEY * TUKEY * scale * scale * variances[i] + gate * gate
        part = 1.0 - residuals[i] * residuals[i] / limit2
        if part <= 0.0:
            continue
        states[i] = AGREES
        weight = part * part / variances[i]
        x = (places[i, 0] - shift[0]) / VIEW_DISTANCE
        y = (places[i, 1] - shift[1]) / VIEW_DISTANCE
        z = (places[i, 2] - shift[2]) / VIEW_DISTANCE
        nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
        row = (nx, ny, nz, y * nz - z * ny, z * nx - x * nz, x * ny - y * nx)
        thing = things[i]
        for r in range(6):
            pulls[thing, r] -= weight * residuals[i] * row[r]
            for c in range(6):
                information[thing, r, c] += weight * row[r] * row[c]
