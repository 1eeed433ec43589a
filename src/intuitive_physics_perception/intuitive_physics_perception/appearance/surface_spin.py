"""The spin of a ball in free flight, from what is painted on it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_perception.appearance.sphere_image import SphereImage
from intuitive_physics_perception.appearance.spin_fit import (
    LARGEST_TURN,
    ImageSeries,
    Spin,
)
from intuitive_physics_perception.appearance.turn_search import MIN_CONTRAST, TurnSearch

COMPARED_FRAMES = 12
"""Images of a flight that are compared at most: the first, the newest, and of the others those that
leave the smallest gaps."""

SEARCH_FRAMES = 8
"""Newest images of a flight in which a spin is searched that is not known."""

CANDIDATES = 12
"""Rotations that are refined, the best of those tried, before a spin is believed: images a whole
turn apart look alike for every axis."""

FIRST_CANDIDATES = 4
"""Those that are refined first: where none explains the images, the others take no time."""

MIN_LIKELIHOOD = 40.0
"""Logarithm of how much likelier the images must be than without a common pattern: the best of
10,000 rotations reaches 9 by chance."""

LEAD = 0.75
"""Part of that logarithm that any other rotation may have: with more there are two explanations,
and the spin is unknown."""

AGREEMENT = 0.84
"""Correlation of the images of a flight that is at least needed."""

LIGHT_TURN = 0.3
"""Standard deviation of the angular velocity with which light and highlights seem to turn with a
plain ball, rad/s."""

HIGHLIGHT_TURN = 0.3
"""`LIGHT_TURN` of a highlight, as a part of the angular velocity of the line of sight."""

STANDING_GATE = 25.0
"""Squared angular velocity, in variances, that a pattern must have: what stands still in the room,
or goes with the line of sight, may be light."""

REACH = 4
"""Images that far apart are compared first in a search: what turns fast has little in common with
the image before."""

SHORTER = 0.75
"""Part of the time between two frames below which a new one shows that frames were left out."""

PATIENCE = 4
"""Searches in vain after which one frame more is waited for the next."""

NEAR_TURN = 0.35
"""Turn from frame to frame, rad, beside the best rotation, from which another one is searched."""


class SurfaceSpin:
    """Finds the spin of one ball in a flight, image after image."""

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Begin again: a contact has changed the spin."""
        self.spin: Spin | None = None
        self._times: list[float] = []
        self._images: list[SphereImage] = []
        self._search: TurnSearch | None = None
        self._interval = np.inf
        self._misses, self._waits = 0, 0

    @property
    def since(self) -> float:
        """Time of the first image that the spin is from, s."""
        return self._times[0]

    def take(self, time: float, image: SphereImage) -> None:
        """Take the image of a frame in free flight.

        `time` in s, later than that of the image before.
        """
        self._times.append(time)
        self._images.append(image)
        if self.spin is None:
            self._look()
        else:
            self._follow(self.spin)

    def _follow(self, spin: Spin) -> None:
        """Correct a spin that is known; forget it where the newest image contradicts it."""
        self._thin()
        series = ImageSeries(self._times, self._images)
        self.spin = self._accepted(series, [series.fitted(spin.mean, reach=len(self._times))])
        if self.spin is None:
            # Something that was not seen has changed it.
            time, image = self._times[-1], self._images[-1]
            self.forget()
            self._times, self._images = [time], [image]

    def _look(self) -> None:
        """Search for the spin among all rotations from frame to frame."""
        del self._times[:-SEARCH_FRAMES], self._images[:-SEARCH_FRAMES]
        if len(self._times) < 2:
            return
        duration = self._times[-1] - self._times[-2]
        if self._search is None or duration < SHORTER * self._search.duration:
            self._search, self._interval = TurnSearch(duration), duration
        self._search.add(self._times, self._images)
        # A side without a pattern says where the pattern is not, but nothing is found on it.
        self._waits -= 1
        if len(self._times) < 3 or self._images[-1].contrast < MIN_CONTRAST or self._waits > 0:
            return
        series = ImageSeries(self._times, self._images)
        self.spin = self._found(series, self._search)
        # What has not been understood so far deserves less time.
        self._misses += 1
        self._waits = 1 + self._misses // PATIENCE

    def _found(self, series: ImageSeries, search: TurnSearch) -> Spin | None:
        """The spin that explains the images, found from the best of those tried."""
        begins = search.best(CANDIDATES)
        fits = [series.fitted(begin, reach=REACH) for begin in begins[:FIRST_CANDIDATES]]
        best = self._accepted(series, fits)
        if best is None:
            return None
        # Before it is believed, others are looked for where they may have been missed.
        near = NEAR_TURN / search.duration * np.concatenate([np.eye(3), -np.eye(3)])
        begins += [*(best.mean + near)]
        fits += [series.fitted(begin, reach=REACH) for begin in begins[FIRST_CANDIDATES:]]
        return self._accepted(series, fits)

    def _thin(self) -> None:
        """Keep as many images as are compared: without the one whose neighbours are closest."""
        if len(self._times) > COMPARED_FRAMES:
            times = np.array(self._times)
            left_out = 1 + int(np.argmin(times[2:] - times[:-2]))
            del self._times[left_out], self._images[left_out]

    def _accepted(self, series: ImageSeries, fits: Sequence[Spin]) -> Spin | None:
        """The spin that explains the images, if it is the only one that does."""
        if not fits:
            return None
        best = max(fits, key=lambda fit: fit.likelihood)
        if (
            best.likelihood < MIN_LIKELIHOOD
            or best.correlation < AGREEMENT
            or np.linalg.norm(best.mean) * self._interval > LARGEST_TURN
            or _may_be_light(best, series.view_rate)
        ):
            return None
        rivals = [fit for fit in fits if fit.likelihood > LEAD * best.likelihood]
        return None if any(_differ(fit, best) for fit in rivals) else best


def _may_be_light(spin: Spin, view_rate: NDArray[np.float64]) -> bool:
    """Whether what turns so may be light, which stands still, or a highlight, which goes a part of
    the way with the line of sight (3,) rad/s."""
    unsure = LIGHT_TURN**2 + HIGHLIGHT_TURN**2 * float(view_rate @ view_rate)
    spread = spin.covariance + unsure * np.eye(3)
    return bool(spin.mean @ np.linalg.solve(spread, spin.mean) < STANDING_GATE)


def _differ(spin: Spin, other: Spin) -> bool:
    """Whether two spins are two, beyond their errors."""
    away = spin.mean - other.mean
    spread: NDArray[np.float64] = spin.covariance + other.covariance
    return bool(away @ np.linalg.solve(spread, away) > 25.0)
