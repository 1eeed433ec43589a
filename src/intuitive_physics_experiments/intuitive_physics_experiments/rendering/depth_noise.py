"""A stereo depth camera's real faults, put on ideal depth images.

Noise and quantisation act on the disparity f b / z, as they do in the camera. Readings are
missing where the second imager sees something else (the shadow at one side of an object), at
depth edges, where the surface is seen at a grazing angle, out of range, and at random.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics_experiments.rendering.depth_renderer import DepthImage, ImageRegion

_JITTER_REACH = 2  # Pixels by which an edge is moved at most
_RANDOM_LEVELS = 1 << 16  # Values of a random 16-bit number


@dataclass(frozen=True)
class DepthNoise:
    """Sizes of the faults."""

    axial_constant: float = 0.001  # a of σ(z) = a + b z², m
    axial_quadratic: float = 0.0012  # b, 1/m
    # pixels; one disparity comes from a square of this edge, so the noise of readings nearer to
    # each other than that goes together
    matching_window: int = 3
    lateral_sigma: float = 0.5  # pixels; each reading is taken from so far beside its own ray
    baseline: float = 0.05  # m between the two imagers
    subpixels: int = 32  # disparity levels in one pixel
    # nearest, farthest: m, range of readings
    nearest: float = 0.3
    farthest: float = 8.0
    # grazing_start, grazing_end: degrees of incidence where readings begin to be missing, and where
    # all are
    grazing_start: float = 72.0
    grazing_end: float = 85.0
    edge_loss: float = 0.5  # share of readings lost at depth edges
    edge_jump: float = 0.03  # step of depth between neighbours, as a share of it, that is an edge
    random_loss: float = 0.003  # share of readings lost anywhere
    # pixels by which the nearer side of a depth edge grows over the farther one, as where a
    # matching window sees both
    fattening: int = 0
    flying: float = 0.0  # share of the readings at depth edges that lie anywhere between both sides

    def __post_init__(self) -> None:
        if not 0.0 < self.nearest < self.farthest:
            raise InvalidInputError(
                f"range is {self.nearest:g} to {self.farthest:g} m; expected 0 < nearest < farthest"
            )
        if not 0.0 <= self.grazing_start < self.grazing_end <= 90.0:
            raise InvalidInputError(
                f"grazing angles are {self.grazing_start:g} and {self.grazing_end:g} degrees; "
                "expected 0 ≤ start < end ≤ 90"
            )
        if self.baseline <= 0.0 or self.subpixels < 1 or self.matching_window < 1:
            raise InvalidInputError(
                f"baseline is {self.baseline:g} m with {self.subpixels} subpixels and a window of "
                f"{self.matching_window} pixels; expected all above zero"
            )
        if self.fattening < 0 or not 0.0 <= self.flying <= 1.0:
            raise InvalidInputError(
                f"edges grow by {self.fattening} pixels and a share of {self.flying:g} of their "
                "readings flies; expected at least 0 pixels and a share from 0 to 1"
            )

    def sigma(self, depth: NDArray) -> NDArray:
        """Axial standard deviation (...) m of each depth (...) m."""
        return self.axial_constant + self.axial_quadratic * depth**2


class NoisyDepthCamera:
    """Turns ideal images of one static background, with or without a ball, into noisy ones."""

    def __init__(
        self,
        background: DepthImage,
        focal_length: float,
        noise: DepthNoise,
        rng: np.random.Generator,
    ) -> None:
        self._noise = noise
        self._rng = rng
        self._levels_per_inverse_metre = focal_length * noise.baseline * noise.subpixels
        self._background = background
        self._millimetres = self._millimetre_table()
        height, width = background.depth.shape
        self._padded_width = width + 2 * _JITTER_REACH
        rows = np.arange(height, dtype=np.int32) + _JITTER_REACH
        columns = np.arange(width, dtype=np.int32) + _JITTER_REACH
        self._own_index = rows[:, None] * np.int32(self._padded_width) + columns
        self._jitter = self._jitter_table()
        self._shadow_reach = int(np.ceil(focal_length * noise.baseline / noise.nearest))
        level, sigma, loss = self._faults(background)
        self._level = np.pad(level, _JITTER_REACH, mode="edge")
        self._sigma = np.pad(sigma, _JITTER_REACH, mode="edge")
        self._loss = loss

    def read(
        self, part: DepthImage | None = None, region: ImageRegion | None = None
    ) -> NDArray[np.uint16]:
        """Return one noisy image (height, width) in millimetres, 0 where there is no reading.

        Part and region are what `DepthRenderer.render_balls` returned; None: the empty background.
        """
        level, sigma, loss = self._level, self._sigma, self._loss
        if part is not None and region is not None and not region.empty:
            level, sigma, loss = self._with_region(part, region)
        shape = self._own_index.shape
        from_where = self._own_index + self._jitter[self._random_bits(shape)]
        noisy = self._matching_noise(shape)
        noisy *= sigma.ravel()[from_where]
        noisy += level.ravel()[from_where]
        np.rint(noisy, out=noisy)
        np.clip(noisy, 0, len(self._millimetres) - 1, out=noisy)
        image = self._millimetres[noisy.astype(np.int32)]
        image[self._random_bits(shape) < loss] = 0
        return image

    def _matching_noise(self, shape: tuple[int, ...]) -> NDArray[np.float32]:
        """Deviates of variance one, correlated over the matching window."""
        from scipy.ndimage import uniform_filter

        window = self._noise.matching_window
        white = self._rng.standard_normal(shape, dtype=np.float32)
        # A mean of n² deviates has the variance 1 / n².
        return white if window == 1 else window * uniform_filter(white, window, mode="wrap")

    def _random_bits(self, shape: tuple[int, ...]) -> NDArray[np.uint16]:
        return self._rng.integers(0, _RANDOM_LEVELS, size=shape, dtype=np.uint16)

    def _with_region(self, part: DepthImage, region: ImageRegion) -> tuple[NDArray, ...]:
        """Faults of the whole image, computed again around a region that differs."""
        background = self._background
        height, width = background.depth.shape
        # The shadow falls to the left of what casts it; an edge reaches one pixel further.
        margin = 1 + self._noise.fattening
        rows = slice(max(region.rows.start - margin, 0), min(region.rows.stop + margin, height))
        columns = slice(
            max(region.columns.start - self._shadow_reach - margin, 0),
            min(region.columns.stop + self._shadow_reach + margin, width),
        )
        depth = background.depth[rows, columns].copy()
        cosine = background.incidence_cosine[rows, columns].copy()
        inside = (
            slice(region.rows.start - rows.start, region.rows.stop - rows.start),
            slice(region.columns.start - columns.start, region.columns.stop - columns.start),
        )
        depth[inside], cosine[inside] = part.depth, part.incidence_cosine
        local = self._faults(DepthImage(depth, cosine))
        level, sigma, loss = self._level.copy(), self._sigma.copy(), self._loss.copy()
        padded = (
            slice(rows.start + _JITTER_REACH, rows.stop + _JITTER_REACH),
            slice(columns.start + _JITTER_REACH, columns.stop + _JITTER_REACH),
        )
        level[padded], sigma[padded], loss[rows, columns] = local
        return level, sigma, loss

    def _faults(self, image: DepthImage) -> tuple[NDArray, NDArray, NDArray]:
        """Disparity level and its σ, both in levels, and the chance of loss in 1/65536."""
        noise = self._noise
        depth = _fattened(image.depth, noise)
        is_measured = depth > 0.0
        safe = np.where(is_measured, depth, 1.0)
        level = np.where(is_measured, self._levels_per_inverse_metre / safe, 0.0)
        # dD/dz = -D / z
        sigma = np.where(is_measured, noise.sigma(safe) * level / safe, 0.0)
        angle = np.degrees(np.arccos(np.clip(image.incidence_cosine, 0.0, 1.0)))
        grazing = (angle - noise.grazing_start) / (noise.grazing_end - noise.grazing_start)
        kept = (1.0 - np.clip(grazing, 0.0, 1.0)) * (1.0 - noise.random_loss)
        edges = _edges(depth, noise.edge_jump)
        kept[edges] *= 1.0 - noise.edge_loss
        kept[~is_measured | self._shadow(level)] = 0.0
        if noise.flying > 0.0:
            level = self._with_flying(level, edges & is_measured)
        loss = np.minimum(np.rint((1.0 - kept) * _RANDOM_LEVELS), _RANDOM_LEVELS)
        return level.astype(np.float32), sigma.astype(np.float32), loss.astype(np.int32)

    def _with_flying(self, level: NDArray, edges: NDArray[np.bool_]) -> NDArray:
        """Levels of which some at edges lie between those of the two sides."""
        from scipy.ndimage import maximum_filter, minimum_filter

        flies = edges & (self._rng.random(level.shape) < self._noise.flying)
        near = maximum_filter(level, 3)
        far = minimum_filter(np.where(level > 0.0, level, np.inf), 3)
        part = self._rng.random(level.shape)
        return np.where(flies, near + part * (np.minimum(far, near) - near), level)

    def _shadow(self, level: NDArray) -> NDArray[np.bool_]:
        """Pixels whose ray from the second imager is blocked by something further right."""
        disparity = level / self._noise.subpixels
        column_in_second = np.arange(level.shape[1]) - disparity
        column_in_second[level <= 0.0] = np.inf
        leftmost_beyond = np.minimum.accumulate(column_in_second[:, ::-1], axis=1)[:, ::-1]
        blocked = np.zeros(level.shape, dtype=bool)
        blocked[:, :-1] = column_in_second[:, :-1] > leftmost_beyond[:, 1:]
        return blocked

    def _millimetre_table(self) -> NDArray[np.uint16]:
        """Millimetres by disparity level."""
        noise, scale = self._noise, self._levels_per_inverse_metre
        levels = np.arange(int(np.ceil(scale / noise.nearest)) + 2)
        depth = scale / np.maximum(levels, 1e-9)
        valid = (depth >= noise.nearest) & (depth <= noise.farthest)
        return np.where(valid, np.rint(np.where(valid, depth, 0.0) * 1000.0), 0.0).astype(np.uint16)

    def _jitter_table(self) -> NDArray[np.int32]:
        """Offsets of flat indices, as often as a rounded normal deviate of both axes has them."""
        sigma = self._noise.lateral_sigma
        steps = np.arange(-_JITTER_REACH, _JITTER_REACH + 1)
        weight = np.exp(-0.5 * (steps / sigma) ** 2) if sigma > 0.0 else (steps == 0).astype(float)
        weight /= weight.sum()
        both = np.outer(weight, weight).ravel()
        ends = np.rint(np.cumsum(both) * _RANDOM_LEVELS).astype(np.int64)
        offsets = (steps[:, None] * self._padded_width + steps).ravel()
        counts = np.diff(ends, prepend=0)
        return np.repeat(offsets, counts).astype(np.int32)


def _fattened(depth: NDArray, noise: DepthNoise) -> NDArray:
    """Depth whose nearer sides have grown over the farther ones at edges."""
    if noise.fattening == 0:
        return depth
    from scipy.ndimage import minimum_filter

    nearest = minimum_filter(np.where(depth > 0.0, depth, np.inf), 2 * noise.fattening + 1)
    jumps = depth - nearest > noise.edge_jump * depth
    return np.where(jumps & (depth > 0.0), nearest, depth)


def _edges(depth: NDArray, jump: float) -> NDArray[np.bool_]:
    """Pixels at whose side depth steps by more than a share `jump` of itself."""
    edge = np.zeros(depth.shape, dtype=bool)
    for axis in (0, 1):
        near = np.swapaxes(depth, 0, axis)
        mark = np.swapaxes(edge, 0, axis)
        step = np.abs(np.diff(near, axis=0)) > jump * np.maximum(near[1:], near[:-1])
        mark[1:] |= step
        mark[:-1] |= step
    return edge
