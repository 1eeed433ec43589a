"""Patterns on a ball: nothing, dots, the seam of a tennis ball, or a logo."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError

PLAIN, DOTS, SEAMS, LOGO = PATTERNS = ("plain", "dots", "seams", "logo")  # Patterns a ball can have

# Dots, spread at random over the ball but apart from one another, and their radius in rad.
DOT_COUNT, DOT_RADIUS = 16, 0.22

DOT_SEED = 4  # Seed of the places of the dots, which are the same on all balls
SEAM_HALF_WIDTH = 0.09  # rad; 3 mm on a tennis ball
LOGO_RADIUS = 0.75  # rad from the middle of a logo to its rim
Color = tuple[float, float, float]  # Red, green and blue, 0 to 1


@dataclass(frozen=True)
class BallSurface:
    """Colours of a ball by direction from its centre, in its own axes."""

    pattern: str = PLAIN  # one of `PATTERNS`
    # ground, mark: reflectance of the ball and of what is painted on it
    ground: Color = (0.75, 0.75, 0.2)
    mark: Color = (0.15, 0.15, 0.15)

    def __post_init__(self) -> None:
        if self.pattern not in PATTERNS:
            raise InvalidInputError(
                f"pattern is {self.pattern!r}; expected one of {', '.join(PATTERNS)}"
            )

    def reflectance(self, directions: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return red, green and blue (..., 3), 0 to 1, in `directions` (..., 3) of its axes."""
        marked = _marked(self.pattern, directions)[..., None]
        return np.where(marked, np.array(self.mark), np.array(self.ground))


def _marked(pattern: str, directions: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether something is painted at each direction (..., 3)."""
    if pattern == DOTS:
        return (directions @ dot_centers().T).max(axis=-1) > np.cos(DOT_RADIUS)
    if pattern == SEAMS:
        return (directions @ _seam().T).max(axis=-1) > np.cos(SEAM_HALF_WIDTH)
    if pattern == LOGO:
        return _in_logo(directions)
    return np.zeros(directions.shape[:-1], dtype=bool)


@lru_cache(maxsize=1)
def dot_centers() -> NDArray[np.float64]:
    """Return the unit vectors (n, 3) of the dots' middles, without any symmetry."""
    rng = np.random.default_rng(DOT_SEED)
    centers: list[NDArray[np.float64]] = []
    while len(centers) < DOT_COUNT:
        place = rng.normal(size=3)
        place /= np.linalg.norm(place)
        if all(place @ other < np.cos(2.6 * DOT_RADIUS) for other in centers):
            centers.append(place)
    return np.array(centers)


@lru_cache(maxsize=1)
def _seam() -> NDArray[np.float64]:
    """Points (n, 3) along the seam of a tennis ball, closer together than its width."""
    t = np.linspace(0.0, 2.0 * np.pi, 240, endpoint=False)
    a, b = 0.75, 0.25
    return np.column_stack(
        [
            a * np.cos(t) + b * np.cos(3.0 * t),
            a * np.sin(t) - b * np.sin(3.0 * t),
            2.0 * np.sqrt(a * b) * np.sin(2.0 * t),
        ]
    )


def _in_logo(directions: NDArray[np.float64]) -> NDArray[np.bool_]:
    """A disc about the ball's x axis, out of which a smaller disc and a bar are cut."""
    x, y, z = np.moveaxis(directions, -1, 0)
    rim = np.sin(LOGO_RADIUS)
    inside = (x > 0.0) & (y**2 + z**2 < rim**2)
    hole = (y - 0.35 * rim) ** 2 + (z - 0.3 * rim) ** 2 < (0.35 * rim) ** 2
    bar = (np.abs(z + 0.35 * rim) < 0.14 * rim) & (y > -0.6 * rim)
    return inside & ~hole & ~bar
