"""Kernels that lay images of one turning sphere over one another.

An image of the sphere is a square grid over the disc that it shows: cell (row, column) holds the
point at (x, y) = ((column, row) - middle) · pitch in the view's axes, with z = √(1 - x² - y²)
towards the sensor. A point that is at the direction n at the time t_k is at Exp(ω (t_j - t_k)) n at
the time t_j, where Exp is the rotation by a rotation vector.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from intuitive_physics.kernels import allocating_entry, fast_inlined, kernel

BLOCK = 4
"""Cells along each edge of a block, whose errors may all be one."""

RIM = 0.4
"""Cosine of the largest angle between a direction and that to the sensor that is compared."""

GRADIENT, MEAT, CELLS, PRODUCT, POWER, UNEVEN = 9, 12, 21, 22, 23, 24
"""Places of the sums of `overlay`, after the normal matrix."""

TAPER = 0.3
"""Cosine above `RIM` from which on a cell has its full weight: near the rim a pixel sees a part of
the surface that is twice as wide."""

SMOOTH = 9
"""Functions on the sphere that light and shade may be a combination of."""

COLUMNS = 5
"""Columns of a cell: the slopes over ω, and the values of both images."""

DISAGREEMENT = 0.5
"""Part of the mean power of two images that is taken from their product: images whose correlation
is smaller speak against a rotation."""

VALUE, OWN_POWER = 3, 4
"""Rows in which the value of a cell and its part of the power stand, after those of its place."""


@allocating_entry
def add_scores(first: Any, second: Any, ways: Any, pitch: float, scores: Any) -> None:
    """Add to each way's score of two images: Σ e f - ρ (e² + f²) / 2 of their common cells.

    `first` and `second` (g, g) values, NaN where there is none; `ways` (m, 3, 3), from the axes of
    the second view to those of the first; `scores` (m,) sums, written.
    """
    size = first.shape[0]
    cells, seen = (
        np.empty((OWN_POWER + 1, size * size), np.float32),
        np.zeros((2, size * size), np.float32),
    )
    middle, count = 0.5 * (size - 1), 0
    for row in range(size):
        for column in range(size):
            value = first[row, column]
            if not np.isnan(value):
                seen[0, row * size + column], seen[1, row * size + column] = value, 1.0
            value = second[row, column]
            # Every other cell, as on a chessboard.
            if (row + column) % 2 == 0 and not np.isnan(value):
                x, y = (column - middle) * pitch, (row - middle) * pitch
                cells[0, count], cells[1, count] = x, y
                cells[2, count] = np.sqrt(max(1.0 - x * x - y * y, 0.0))
                cells[VALUE, count] = value
                cells[OWN_POWER, count] = 0.5 * DISAGREEMENT * value * value
                count += 1
    way = np.empty((3, 3), np.float32)
    for m in range(ways.shape[0]):
        for j in range(3):
            way[0, j], way[1, j] = ways[m, 0, j] / pitch, ways[m, 1, j] / pitch
            way[2, j] = ways[m, 2, j]
        scores[m] += _score(seen[0], seen[1], cells, count, way, size)


@fast_inlined
def _score(values: Any, seen: Any, cells: Any, count: int, way: Any, size: int) -> float:
    """Score of a way (3, 3) from the cells of one image to those of another, in its pitches."""
    width, start = np.int32(size), np.float32(0.5 * size)
    rim, half = np.float32(RIM), np.float32(0.5 * DISAGREEMENT)
    a, b, c = way[0, 0], way[0, 1], way[0, 2]
    d, e, f = way[1, 0], way[1, 1], way[1, 2]
    p, q, s = way[2, 0], way[2, 1], way[2, 2]
    total = np.float32(0.0)
    for i in range(count):
        x, y, z = cells[0, i], cells[1, i], cells[2, i]
        column, row = (
            np.int32(a * x + b * y + c * z + start),
            np.int32(d * x + e * y + f * z + start),
        )
        # The first cell is a corner, which no sphere fills.
        k = np.uint32(row * width + column) if p * x + q * y + s * z >= rim else np.uint32(0)
        value = values[k]
        total += value * (cells[VALUE, i] - half * value) - seen[k] * cells[OWN_POWER, i]
    return float(total)


@allocating_entry
def joint_scores(scores: Any, places: Any) -> Any:
    """Return the sums (n,) of scores (lags, m), of each at the rotation of a spin (n, lags)."""
    sums = np.zeros(places.shape[0])
    for k in range(places.shape[0]):
        for lag in range(places.shape[1]):
            sums[k] += scores[lag, places[k, lag]]
    return sums


@allocating_entry
def best_apart(scores: Any, turns: Any, apart: float, count: int) -> Any:
    """Return the indices (count,) of the largest scores (n,) above zero, best first, of turns
    (n, 3) rad that are `apart` from one another; -1 where there are no more."""
    chosen = np.full(count, -1)
    for place in range(count):
        best = 0.0
        for k in range(scores.shape[0]):
            if scores[k] > best and _is_apart(turns, k, chosen[:place], apart):
                best, chosen[place] = scores[k], k
        if chosen[place] < 0:
            break
    return chosen


@kernel
def _is_apart(turns: Any, one: int, others: Any, apart: float) -> bool:
    """Whether a turn is at least some rad away from others."""
    for other in others:
        away = 0.0
        for i in range(3):
            away += (turns[one, i] - turns[other, i]) ** 2
        if away < apart * apart:
            return False
    return True


@allocating_entry
def overlay(values: Any, pairs: Any, ways: Any, slopes: Any, pitch: float) -> Any:
    """Compare images of a sphere that turns with a constant angular velocity ω, two at a time.

    What differs between two images by a smooth field (`SMOOTH` harmonics) is light, and left out.

    `values` (k, g, g), NaN where there is none; `pairs` (n, 2), numbers of a later image and an
    earlier one; `ways` (n, 3, 3) from the axes of the later view to those of the earlier one;
    `slopes` (n, 3, 3), what makes of a torque in the axes of the earlier view the slope over ω.
    Returns (25,), of residuals r = e_k - e_j and slopes J = ∂e_j/∂ω: the normal matrix Σ J Jᵀ (9),
    the gradient Σ J r (3), Σ over blocks of the products of their gradients (9); the weight of all
    cells, Σ e_k e_j, and Σ (e_k² + e_j²) / 2; and the sum over all pairs of the square of this
    power over the weight of the pair's cells.
    """
    sums = np.zeros(UNEVEN + 1)
    size = values.shape[1]
    blocks = (size + BLOCK - 1) // BLOCK
    gradients = np.empty((blocks * blocks, 3))
    columns, basis = np.empty((COLUMNS, size * size)), np.empty((SMOOTH, size * size))
    own_blocks = np.empty(size * size, dtype=np.int64)
    normal, cross = np.empty((SMOOTH, SMOOTH)), np.empty((SMOOTH, COLUMNS))
    for n in range(pairs.shape[0]):
        k, j = pairs[n]
        count = _lay_over(
            values[j], values[k], ways[n], slopes[n], pitch, j + k, columns, basis, own_blocks
        )
        if count < 2 * SMOOTH:
            continue
        _take_out_smooth(columns, basis, count, normal, cross)
        cells = 2.0 * _dot(basis[0], basis[0], count)
        power = _add_pair(columns, own_blocks, count, gradients, sums)
        sums[CELLS] += cells
        sums[UNEVEN] += power * power / cells
    return sums


@kernel
def _lay_over(
    first: Any,
    second: Any,
    way: Any,
    slope: Any,
    pitch: float,
    color: int,
    columns: Any,
    basis: Any,
    blocks: Any,
) -> int:
    """Write J, e_k and e_j, smooth harmonics and block of each common cell; return how many.

    Cells are those of one color of a chessboard, each of which stands for two. `way` (3, 3) leads
    from the axes of the second view to those of the first.
    """
    size, count = first.shape[0], 0
    middle, across = 0.5 * (size - 1), (size + BLOCK - 1) // BLOCK
    for row in range(size):
        for column in range((row + color) % 2, size, 2):
            here = second[row, column]
            if np.isnan(here):
                continue
            x, y = (column - middle) * pitch, (row - middle) * pitch
            z = np.sqrt(max(1.0 - x * x - y * y, 0.0))
            to_x = way[0, 0] * x + way[0, 1] * y + way[0, 2] * z
            to_y = way[1, 0] * x + way[1, 1] * y + way[1, 2] * z
            to_z = way[2, 0] * x + way[2, 1] * y + way[2, 2] * z
            u, v = to_x / pitch + middle, to_y / pitch + middle
            left, top = int(u), int(v)
            if to_z < RIM or u < 0.0 or v < 0.0 or left >= size - 1 or top >= size - 1:
                continue
            a, b = first[top, left], first[top, left + 1]
            c, d = first[top + 1, left], first[top + 1, left + 1]
            p, q = u - left, v - top
            upper, lower = a + p * (b - a), c + p * (d - c)
            there = upper + q * (lower - upper)
            if np.isnan(there):
                continue
            g_x, g_y = ((b - a) * (1.0 - q) + (d - c) * q) / pitch, (lower - upper) / pitch
            # d × g in the axes of the first view, with g = (g_x, g_y, 0).
            t_x, t_y, t_z = -to_z * g_y, to_z * g_x, to_x * g_y - to_y * g_x
            weight = min(min(z, to_z) - RIM, TAPER) / TAPER
            for i in range(3):
                turned = slope[i, 0] * t_x + slope[i, 1] * t_y + slope[i, 2] * t_z
                columns[i, count] = weight * turned
            columns[3, count], columns[4, count] = weight * here, weight * there
            _harmonics(x, y, z, weight, basis[:, count])
            blocks[count] = (row // BLOCK) * across + column // BLOCK
            count += 1
    return count


@kernel
def _harmonics(x: float, y: float, z: float, weight: float, out: Any) -> None:
    """Write the polynomials up to the second degree on the sphere (`SMOOTH`,) times a weight."""
    out[0], out[1], out[2], out[3] = weight, weight * x, weight * y, weight * z
    out[4], out[5], out[6] = out[1] * y, out[1] * z, out[2] * z
    out[7], out[8] = out[1] * x - out[2] * y, out[3] * z


@kernel
def _take_out_smooth(columns: Any, basis: Any, count: int, normal: Any, cross: Any) -> None:
    """Leave of the cells of each column what is no combination of the smooth functions."""
    for m in range(basis.shape[0]):
        for n in range(m + 1):
            normal[m, n] = _dot(basis[m], basis[n], count)
        for n in range(columns.shape[0]):
            cross[m, n] = _dot(basis[m], columns[n], count)
    _solve(normal, cross)
    for m in range(basis.shape[0]):
        for n in range(columns.shape[0]):
            _subtract(columns[n], cross[m, n], basis[m], count)


@fast_inlined
def _dot(one: Any, other: Any, count: int) -> float:
    """Return the sum of the products of the first numbers of two arrays."""
    total = 0.0
    for i in range(count):
        total += one[i] * other[i]
    return total


@fast_inlined
def _subtract(one: Any, factor: float, other: Any, count: int) -> None:
    """Take from the first numbers of an array those of another times a factor."""
    for i in range(count):
        one[i] -= factor * other[i]


@kernel
def _solve(normal: Any, cross: Any) -> None:
    """Write normal⁻¹ cross to cross, of the lower half of a matrix, which Cholesky's replaces."""
    width, own = cross.shape
    for m in range(width):
        normal[m, m] += 1e-6 * normal[0, 0]
    for m in range(width):
        for n in range(m + 1):
            total = normal[m, n]
            for p in range(n):
                total -= normal[m, p] * normal[n, p]
            normal[m, n] = np.sqrt(max(total, 1e-12)) if m == n else total / normal[n, n]
    for c in range(own):
        for m in range(width):
            for p in range(m):
                cross[m, c] -= normal[m, p] * cross[p, c]
            cross[m, c] /= normal[m, m]
        for m in range(width - 1, -1, -1):
            for p in range(m + 1, width):
                cross[m, c] -= normal[p, m] * cross[p, c]
            cross[m, c] /= normal[m, m]


@kernel
def _add_pair(columns: Any, blocks: Any, count: int, gradients: Any, sums: Any) -> float:
    """Add the sums of a pair of images, return its power; `gradients` is working memory."""
    here, there = columns[3], columns[4]
    power = _dot(here, here, count) + _dot(there, there, count)
    sums[PRODUCT] += 2.0 * _dot(here, there, count)
    sums[POWER] += power
    for m in range(3):
        for n in range(3):
            sums[3 * m + n] += 2.0 * _dot(columns[m], columns[n], count)
    gradients[:] = 0.0
    for i in range(count):
        residual = 2.0 * (here[i] - there[i])
        for m in range(3):
            gradients[blocks[i], m] += columns[m, i] * residual
    for block in range(gradients.shape[0]):
        for m in range(3):
            sums[GRADIENT + m] += gradients[block, m]
            for n in range(3):
                sums[MEAT + 3 * m + n] += gradients[block, m] * gradients[block, n]
    return float(power)
