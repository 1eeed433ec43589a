"""Fits a constant spin to images of a ball: rotations to begin with, and Gauss-Newton."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_perception.appearance.registration import (
    CELLS,
    GRADIENT,
    MEAT,
    POWER,
    PRODUCT,
    coarse_scores,
    overlay,
)
from intuitive_physics_perception.appearance.settings import AppearanceSettings
from intuitive_physics_perception.appearance.sphere_image import SphereImage, pitch_of

LARGEST_SEARCHED = 2.9
"""rad from frame to frame: a little less than half a turn, which has two directions."""

LARGEST_TURN = 2.5
"""rad from frame to frame of a spin that is believed. More than half a turn looks like the rest of
a turn the other way: with this limit a ball must turn by 3.8 rad to be mistaken."""

APART = 0.5
"""rad from frame to frame by which rotations differ that are refined from the search."""

LONGEST_STEP = 0.3
"""rad between the images farthest apart, by which a spin is corrected at most in one step."""

SMALL_STEP = 0.04
"""Part of `LONGEST_STEP` below which a correction is the last."""

STEPS = 5
"""Corrections for each set of pairs of images."""

HOPELESS = 0.3
"""Correlation of neighbouring images below which a spin is not looked at further."""

ALIKE = 8.0
"""Cells whose differences are one error, where the images' edges are not alike."""

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

    Parameters
    ----------
    times : (k,) s
    images : of one size
    settings : tuned numbers
    """

    def __init__(
        self,
        times: Sequence[float],
        images: Sequence[SphereImage],
        settings: AppearanceSettings,
    ) -> None:
        self.times = np.array(times)
        self._settings = settings
        self._axes = np.stack([image.axes for image in images])
        self._values = np.stack([image.values for image in images])
        self._areas = np.array([image.area for image in images])
        self._seen = float(np.count_nonzero(~np.isnan(self._values)))
        self._pitch = pitch_of(settings.cells)
        self._place = float(np.mean([image.place_deviation**2 for image in images]))
        self._scale = float(np.mean([image.scale_deviation**2 for image in images]))

    def fitted(self, spin: NDArray[np.float64], *, reach: int = 1) -> Spin:
        """Return the spin that lays all images over one another best, near another.

        Parameters
        ----------
        spin : (3,) rad/s
        reach : images that far apart are compared first, then twice as far, up to all
        """
        last = len(self.times) - 1
        reach = min(reach, last)
        while True:
            longest = LONGEST_STEP / float(np.max(self.times[reach:] - self.times[:-reach]))
            for _ in range(STEPS):
                sums = self._overlay(spin, reach)
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

    @property
    def view_rate(self) -> NDArray[np.float64]:
        """Angular velocity (3,) rad/s of the line of sight from the first image to the last."""
        first, last = self._axes[0, 2], self._axes[-1, 2]
        return np.asarray(np.cross(first, last) / (self.times[-1] - self.times[0]))

    def _overlay(self, spin: NDArray[np.float64], reach: int) -> NDArray[np.float64]:
        found: NDArray[np.float64] = overlay(
            self._values, self._axes, self.times, spin, reach, self._pitch
        )
        return found

    def _spin_of(self, mean: NDArray[np.float64], sums: NDArray[np.float64]) -> Spin:
        """A spin with its covariance and evidence from the sums over all pairs of images."""
        normal = sums[:GRADIENT].reshape(3, 3)
        inverse = np.linalg.inv(normal + (1e-6 * np.trace(normal) + 1e-12) * np.eye(3))
        # Each image is in many pairs, which have its errors in common.
        shared = 0.5 + sums[CELLS] / self._seen
        covariance = shared * inverse @ sums[MEAT:CELLS].reshape(3, 3) @ inverse
        # What is wrong with the cells at an edge is wrong in all pairs.
        misfit = 2.0 * (sums[POWER] - sums[PRODUCT]) / max(sums[CELLS], 1.0)
        pairs = sums[CELLS] / self._seen * len(self.times)
        covariance += ALIKE * misfit * pairs * inverse
        # What stands still beside the pattern draws the spin towards zero.
        apart = np.square(self.times[:, None] - self.times).sum() / len(self.times) ** 2
        drawn = self._settings.light_slope**2 * sums[CELLS] * apart * inverse @ mean
        covariance += np.outer(drawn, drawn)
        correlation = float(sums[PRODUCT] / max(sums[POWER], 1e-12))
        together = float(np.clip(correlation, 0.0, SURE))
        count = sums[CELLS] / (float(np.mean(self._areas)) * shared)
        return Spin(
            mean,
            covariance + self._geometry_covariance(mean),
            correlation,
            -0.5 * count * float(np.log1p(-(together**2))),
        )

    def _geometry_covariance(self, spin: NDArray[np.float64]) -> NDArray[np.float64]:
        """What errors of the grid, of the centres and of the radius make of a spin (3,) rad/s."""
        spread = float(np.sum(np.square(self.times - self.times.mean())))
        toward = self._axes[:, 2].mean(axis=0)
        across = np.eye(3) - np.outer(toward, toward) / (toward @ toward)
        turned = across @ spin
        covariance = self._settings.alignment_deviation**2 / spread * np.eye(3)
        covariance += self._place / spread * across
        return np.asarray(covariance + self._scale * np.outer(turned, turned))


class TurnSearch:
    """How well the images of a flight go together, for each of many rotations from one frame to
    the next.

    Parameters
    ----------
    duration : s, from the first frame to the second
    settings : tuned numbers
    """

    def __init__(self, duration: float, settings: AppearanceSettings) -> None:
        self.duration = duration
        largest = min(LARGEST_SEARCHED, settings.max_spin * duration)
        self._turns = ball_of_turns(settings.search_step, round(largest, 2))
        self._pitch = 2.0 * pitch_of(settings.cells)
        self._products = np.zeros(len(self._turns))
        self._chance = np.zeros(len(self._turns))

    def add(self, first: SphereImage, second: SphereImage, duration: float) -> None:
        """Compare two images that are some time apart, s."""
        counts = np.zeros(len(self._turns))
        (before, area_before), (after, area_after) = first.coarse, second.coarse
        coarse_scores(
            before / np.nanstd(before),
            after / np.nanstd(after),
            np.stack([first.axes, second.axes]),
            self._turns * (duration / self.duration),
            self._pitch,
            self._products,
            counts,
        )
        self._chance += np.sqrt(area_before * area_after) * counts

    def best(self, count: int) -> list[NDArray[np.float64]]:
        """Return some spins (3,) rad/s with most evidence, apart from one another."""
        evidence = self._products / np.sqrt(np.maximum(self._chance, 100.0))
        found: list[NDArray[np.float64]] = []
        for _ in range(count):
            k = int(np.argmax(evidence))
            found.append(self._turns[k] / self.duration)
            away = np.linalg.norm(self._turns - self._turns[k], axis=1)
            evidence[away < APART] = -np.inf
        return found


@lru_cache(maxsize=8)
def ball_of_turns(step: float, largest: float) -> NDArray[np.float64]:
    """Return rotation vectors (n, 3) rad on a grid, up to a largest angle."""
    count = int(largest / step)
    line = step * np.arange(-count, count + 1)
    grid = np.stack(np.meshgrid(line, line, line, indexing="ij"), axis=-1).reshape(-1, 3)
    return np.ascontiguousarray(grid[np.linalg.norm(grid, axis=1) <= largest])
