"""Fits a constant spin to images of a ball, by Gauss-Newton."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_perception.appearance.registration import (
    CELLS,
    GRADIENT,
    MEAT,
    POWER,
    PRODUCT,
    UNEVEN,
    overlay,
)
from intuitive_physics_perception.appearance.sphere_image import (
    GRID_CELLS,
    SphereImage,
    pitch_of,
)

ALIGNMENT_DEVIATION = 0.012
"""Standard deviation of the angle by which an image is off, as its cells and the pattern's edges
are no finer, rad."""

LIGHT_SLOPE = 0.3
"""Slope of the logarithm of brightness that light and shade leave after smooth ones are taken out,
and which stands still, 1/rad."""

LARGEST_TURN = 2.6
"""Largest turn from frame to frame, rad, of an accepted spin. More than half a turn looks like the
rest of a turn the other way: with this limit a ball must turn by 3.7 rad to be mistaken."""

LONGEST_STEP = 0.3
"""Largest correction of a spin in one step, rad between the images farthest apart."""

SMALL_STEP = 0.04
"""Part of `LONGEST_STEP` below which a correction is the last."""

STEPS = 4
"""Corrections for each set of pairs of images."""

HOPELESS = 0.6
"""Correlation of images below which a spin is not looked at further."""

ALIKE = 8.0
"""Cells whose differences are one error, where the images' edges are not alike."""

LIGHT_WIDTH = 1.0
"""Turn, rad, after which light that stands still does not resemble itself."""

SURE = 0.99
"""Largest correlation that is counted: what is missing to 1 comes from the cells' size alone."""


@dataclass(frozen=True, eq=False)
class Spin:
    """An angular velocity that is constant.

    Parameters
    ----------
    mean, covariance : (3,) rad/s and (3, 3) rad²/s²
    correlation : of the images that are laid over one another
    likelihood : logarithm of how much likelier the images are than without anything in common
    """

    mean: NDArray[np.float64]
    covariance: NDArray[np.float64]
    correlation: float
    likelihood: float


class ImageSeries:
    """Images of a ball in free flight.

    `times` (k,) s.
    """

    def __init__(self, times: Sequence[float], images: Sequence[SphereImage]) -> None:
        self.times = np.array(times)
        self._axes = np.stack([image.axes for image in images])
        self._values = np.stack([image.values for image in images])
        power = np.nanmean(np.square(self._values), axis=(1, 2))
        # Of a side without a pattern it is the noise whose cells go together.
        self._area = float(np.average([image.area for image in images], weights=power))
        self._seen = float(np.count_nonzero(~np.isnan(self._values)))
        self._pitch = pitch_of(GRID_CELLS)
        self._place = float(np.mean([image.place_deviation**2 for image in images]))

    def fitted(self, spin: NDArray[np.float64], *, reach: int = 1) -> Spin:
        """Return the spin that lays all images over one another best, near another.

        `spin` (3,) rad/s; `reach`: images that far apart are compared first, then twice as far, up
        to all.
        """
        last = len(self.times) - 1
        reach = min(reach, last)
        while True:
            longest = LONGEST_STEP / float(np.max(self.times[reach:] - self.times[:-reach]))
            for _ in range(STEPS):
                sums = self.overlaid(spin, reach)
                normal = sums[:GRADIENT].reshape(3, 3)
                damped = normal + (1e-5 * np.trace(normal) + 1e-12) * np.eye(3)
                step = np.linalg.solve(damped, sums[GRADIENT:MEAT])
                step *= min(1.0, longest / max(float(np.linalg.norm(step)), 1e-12))
                spin = spin + step
                if np.linalg.norm(step) < SMALL_STEP * longest:
                    break
            if reach == last or sums[PRODUCT] < HOPELESS * sums[POWER]:
                # The sums are those of a step before, which was small.
                return self._spin_of(spin, sums)
            reach = min(2 * reach, last)

    def overlaid(self, spin: NDArray[np.float64], reach: int) -> NDArray[np.float64]:
        """Return the sums (25,) of `overlay` over images up to `reach` apart, under a spin (3,)
        rad/s."""
        order = np.arange(len(self.times))
        apart = order[:, None] - order
        later, earlier = np.nonzero((apart > 0) & (apart <= reach))
        durations = (self.times[earlier] - self.times[later])[:, None]
        rotations, jacobians = _turned(durations * spin)
        ways = self._axes[earlier] @ rotations @ self._axes[later].transpose(0, 2, 1)
        slopes = self._axes[earlier] @ (durations[:, None] * jacobians)
        slopes = np.ascontiguousarray(slopes.transpose(0, 2, 1))
        pairs = np.stack([later, earlier], axis=1)
        return np.asarray(overlay(self._values, pairs, ways, slopes, self._pitch))

    @property
    def view_rate(self) -> NDArray[np.float64]:
        """Angular velocity (3,) rad/s of the line of sight from the first image to the last."""
        first, last = self._axes[0, 2], self._axes[-1, 2]
        return np.asarray(np.cross(first, last) / (self.times[-1] - self.times[0]))

    def _spin_of(self, mean: NDArray[np.float64], sums: NDArray[np.float64]) -> Spin:
        """A spin with its covariance and evidence from the sums over all pairs of images."""
        # Each image is in many pairs, which have its errors in common.
        shared = 0.5 + sums[CELLS] / self._seen
        correlation = float(sums[PRODUCT] / max(sums[POWER], 1e-12))
        together = float(np.clip(correlation, 0.0, SURE))
        count = sums[CELLS] / (self._area * shared)
        likelihood = -0.5 * count * float(np.log1p(-(together**2)))
        return Spin(mean, self._covariance(mean, sums, shared), correlation, likelihood)

    def _covariance(
        self, mean: NDArray[np.float64], sums: NDArray[np.float64], shared: float
    ) -> NDArray[np.float64]:
        """Covariance of a spin; of one that explains little only what the cells' errors make."""
        normal = sums[:GRADIENT].reshape(3, 3)
        inverse = np.linalg.inv(normal + (1e-6 * np.trace(normal) + 1e-12) * np.eye(3))
        covariance = shared * inverse @ sums[MEAT:CELLS].reshape(3, 3) @ inverse
        if sums[PRODUCT] < HOPELESS * sums[POWER]:
            return np.asarray(covariance)
        # Of all cells those count that would have the whole power if it were the same in all pairs.
        shown = float(sums[POWER] ** 2 / max(sums[UNEVEN], 1e-12))
        # What is wrong with the cells at an edge is wrong in all pairs.
        misfit = 2.0 * (sums[POWER] - sums[PRODUCT]) / max(shown, 1.0)
        pairs = sums[CELLS] / self._seen * len(self.times)
        covariance += ALIKE * misfit * pairs * inverse
        # What stands still beside the pattern draws the spin towards zero.
        pull = LIGHT_SLOPE**2 * sums[CELLS] * self._pull_of_light(mean)
        drawn = inverse @ pull
        covariance += np.outer(drawn, drawn)
        return np.asarray(covariance + self._geometry_covariance(mean))

    def _pull_of_light(self, spin: NDArray[np.float64]) -> NDArray[np.float64]:
        """Mean over all pairs of time times turn (3,), s rad, where light still lies on itself."""
        apart = np.abs(self.times[:, None] - self.times)
        rate = max(float(np.linalg.norm(spin)), 1e-9)
        turn = (rate * apart + np.pi) % (2.0 * np.pi) - np.pi
        pull = np.mean(apart * np.abs(turn) * np.exp(-0.5 * np.square(turn / LIGHT_WIDTH)))
        return np.asarray(pull * spin / rate)

    def _geometry_covariance(self, spin: NDArray[np.float64]) -> NDArray[np.float64]:
        """Covariance of a spin by errors of the grid and of the centres."""
        slopes = _slopes(spin, self.times - self.times.mean())
        toward = self._axes[:, 2]
        across = np.eye(3) - toward[:, :, None] * toward[:, None, :]
        errors = ALIGNMENT_DEVIATION**2 * np.eye(3) + self._place * across
        turned_back = slopes.transpose(0, 2, 1)
        inverse = np.linalg.inv((turned_back @ slopes).sum(axis=0))
        meat = (turned_back @ errors @ slopes).sum(axis=0)
        covariance: NDArray[np.float64] = (inverse @ meat @ inverse)[:3, :3]
        # Where all centres are off alike, the axis of the spin is turned with the images.
        tilt = np.cross(spin, across.mean(axis=0))
        return np.asarray(covariance + self._place * tilt.T @ tilt)


def _slopes(spin: NDArray[np.float64], times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Turns (k, 3, 6) of a ball for small changes of its spin and of where it was at time zero."""
    rotations, jacobians = _turned(times[:, None] * spin)
    return np.concatenate([times[:, None, None] * jacobians, rotations], axis=2)


def _turned(vectors: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Rotations (k, 3, 3) by rotation vectors (k, 3), and their left Jacobians (k, 3, 3)."""
    angle = np.maximum(np.linalg.norm(vectors, axis=1), 1e-6)[:, None, None]
    cross = np.zeros((len(vectors), 3, 3))
    cross[:, [2, 0, 1], [1, 2, 0]] = vectors
    cross -= cross.transpose(0, 2, 1)
    square = cross @ cross
    a, b = np.sin(angle) / angle, (1.0 - np.cos(angle)) / angle**2
    jacobians = b * cross + (1.0 - a) / angle**2 * square
    return np.eye(3) + a * cross + b * square, np.eye(3) + jacobians
