"""Gaussian distributions that are cut off at the bounds of a box.

Of parameters u with a mean and a factor F of their information the density is

    p(u) ∝ exp(-½ |F d(u)|²) within the box, 0 outside,

where d is u minus the mean; for a parameter with an interval, its distance from that interval.
Nothing is known of what has no information: it is uniform between its ends.

Draws are exact where they can be: a parameter that is correlated with no other is drawn by its
quantiles. Correlated ones are drawn by hit-and-run (Smith 1984; Chen & Schmeiser 1993), many chains
side by side: from the mean, each moves along the right singular vectors of F, then along the axes,
each time to a draw of the density along that line, which is a normal distribution cut off at both
ends. Far from the bounds the first round along the singular vectors is an exact draw already.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse.csgraph import connected_components
from scipy.special import log_ndtr, ndtr, ndtri, ndtri_exp

SMALLEST_SINGULAR_VALUE = 1e-3
"""Per width of the box: singular values of F below this are left out. Over 1000 parameters
that changes the logarithm of the density by less than 0.0005."""

LARGEST_SINGULAR_VALUE = 1e6
"""Per width of the box: what is known better than to a millionth of its bounds is known exactly."""

SMALLEST_CORRELATION = 1e-8
"""Magnitude of a correlation in the information matrix below which it is rounding."""

ROUNDS = 10
"""Rounds of hit-and-run from the mean to a draw. For thin ridges through corners, sums of six
numbers that are known, half of 14 combinations known and a learned θ_s, the largest distance of a
marginal from its law (Kolmogorov-Smirnov) was that of chance, 0.01 of 20,000 draws, after 8."""

TAKEN = 8
"""Draws that are taken of each chain, one after the other."""

SPACING = 3
"""Rounds from one draw of a chain to its next."""

NEGLIGIBLE = 0.3
"""Per width of the box: singular values of F below this are left out of draws. That changes a
standard deviation by 0.4 % at most, as a uniform number has an information of 12, and leaves
parameters of which little is known uncorrelated, which are drawn at once."""

EXACT = 1e-150
"""Smallest standard deviation of a normal distribution; smaller ones count as this, which is
nothing beside any mean."""

MARGINAL_DRAWS = 4096
"""Draws that marginals of correlated parameters near their bounds are computed from, at most:
deviations are right within about 1 %."""

MARGINAL_NUMBERS = 2**17
"""Numbers in these draws from which on there are fewer: with more than 32 correlated parameters."""

INSIDE = 6.0
"""Standard deviations from all bounds at which cutting off changes nothing."""


FAR = -30.0
"""Standard deviations from the mean: probabilities of tails that begin farther out are computed as
logarithms. (A double underflows at -38.)"""

FLAT = 1e-6
"""Width times the root of the precision from which on a density counts as flat: over such a width
it changes by less than rounding of the quantiles."""


class TruncatedGaussian:
    """A Gaussian distribution of n parameters that is cut off at the sides of a box.

    Parameters
    ----------
    mean : (n,) within the box, in any unit, as all below; where the density is highest
    factor : (r, n) F; Fᵀ F is the information, that of the box apart
    intervals : (n, 2) within which the density does not depend on a parameter; NaN: none
    lower, upper : (n,) ends of the box
    """

    def __init__(
        self,
        mean: NDArray[np.float64],
        factor: NDArray[np.float64],
        intervals: NDArray[np.float64],
        lower: NDArray[np.float64],
        upper: NDArray[np.float64],
    ) -> None:
        self.mean, self.intervals = mean, intervals
        self.factor = compressed(factor, smallest=NEGLIGIBLE)
        self.factor[:, np.linalg.norm(self.factor, axis=0) < NEGLIGIBLE] = 0.0
        self.lower, self.upper = lower, upper

    def draw(self, count: int, rng: np.random.Generator) -> NDArray[np.float64]:
        """Draw points (count, n)."""
        alone, groups = self._parts()
        drawn = np.empty((count, self.mean.size))
        drawn[:, alone] = self._alone(alone, rng.random((count, alone.size)))
        for members in groups:
            drawn[:, members] = self._chains(members, count, rng).T
        return drawn

    def covariance(self) -> NDArray[np.float64]:
        """Return the covariance (n, n) of the distribution as it is cut off."""
        alone, groups = self._parts()
        covariance = np.zeros((self.mean.size, self.mean.size))
        shares = (np.arange(MARGINAL_DRAWS) + 0.5) / MARGINAL_DRAWS
        covariance[alone, alone] = self._alone(alone, shares[:, None]).var(axis=0)
        rng = np.random.default_rng(0)
        for members in groups:
            covariance[np.ix_(members, members)] = self._covariance_of(members, rng)
        return covariance

    def _chains(
        self, members: NDArray[np.int64], count: int, rng: np.random.Generator
    ) -> NDArray[np.float64]:
        """Return draws (k, count) of correlated parameters."""
        chains = _Chains(self, members, -(-count // TAKEN))
        taken = []
        for k in range(TAKEN):
            for _ in range(SPACING if k else ROUNDS):
                chains.move(rng)
            taken.append(chains.points.copy())
        return np.concatenate(taken, axis=1)[:, :count]

    def _parts(self) -> tuple[NDArray[np.int64], list[NDArray[np.int64]]]:
        """Return the parameters that are correlated with no other, and groups of those that are."""
        information = self.factor.T @ self.factor
        roots = np.sqrt(np.diag(information))
        linked = np.abs(information) > SMALLEST_CORRELATION * np.outer(roots, roots)
        _, labels = connected_components(linked, directed=False)
        sizes = np.bincount(labels)
        groups = [np.flatnonzero(labels == k) for k in np.flatnonzero(sizes > 1)]
        return np.flatnonzero(sizes[labels] == 1), groups

    def _alone(self, chosen: NDArray[np.int64], shares: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return quantiles (count, n_chosen) of parameters that are correlated with no other."""
        mean, lower, upper = self.mean[chosen], self.lower[chosen], self.upper[chosen]
        lengths = np.linalg.norm(self.factor[:, chosen], axis=0)
        with np.errstate(divide="ignore"):
            drawn = truncated_normal_quantiles(shares, mean, 1.0 / lengths, lower, upper)
        sided = np.flatnonzero(~np.isnan(self.intervals[chosen, 0]))
        drawn[:, sided] = flat_interval_quantiles(
            np.broadcast_to(shares, drawn.shape)[:, sided],
            0.0,
            lengths[sided] ** 2,
            tuple(self.intervals[chosen[sided]].T),
            (lower[sided], upper[sided]),
        )
        exact = (lengths >= LARGEST_SINGULAR_VALUE * (1.0 - 1e-9)) & np.isnan(
            self.intervals[chosen, 0]
        )
        return np.where(exact, mean, drawn)

    def _covariance_of(
        self, members: NDArray[np.int64], rng: np.random.Generator
    ) -> NDArray[np.float64]:
        """Return the covariance of correlated parameters: in closed form far from all bounds."""
        columns = self.factor[:, members]
        values, vectors = np.linalg.eigh(columns.T @ columns)
        if values[0] > 0.0 and np.isnan(self.intervals[members]).all():
            whole = (vectors / values) @ vectors.T
            mean = self.mean[members]
            margins = np.minimum(mean - self.lower[members], self.upper[members] - mean)
            if (margins > INSIDE * np.sqrt(np.diag(whole))).all():
                return np.asarray(whole)
        count = min(MARGINAL_NUMBERS // members.size + 1, MARGINAL_DRAWS)
        return np.atleast_2d(np.cov(self._chains(members, max(count, 512), rng)))


class _Chains:
    """Chains of hit-and-run, side by side, over `members` (k,), parameters that are correlated.

    They are at `points` (k, count).
    """

    def __init__(self, whole: TruncatedGaussian, members: NDArray[np.int64], count: int) -> None:
        self._factor = compressed(whole.factor[:, members])
        self._mean = whole.mean[members, None]
        self._intervals = whole.intervals[members]
        self._sided = ~np.isnan(self._intervals[:, 0])
        self._lower, self._upper = whole.lower[members, None], whole.upper[members, None]
        # Where intervals bend the density, lines run along their axes only.
        free = np.flatnonzero(~self._sided)
        self._directions = np.zeros((free.size, members.size))
        if free.size:
            self._directions[:, free] = np.linalg.svd(self._factor[:, free])[2]
        self.points = np.repeat(np.clip(self._mean, self._lower, self._upper), count, axis=1)

    def move(self, rng: np.random.Generator) -> None:
        """Move all chains along each line once."""
        projected = self._factor @ self._distances()
        for direction in self._directions:
            projected += self._along(direction, projected, rng)
        for axis in range(len(self.points)):
            if self._sided[axis]:
                projected += self._along_sided(axis, projected, rng)
            else:
                unit = np.zeros(len(self.points))
                unit[axis] = 1.0
                projected += self._along(unit, projected, rng)

    def _distances(self) -> NDArray[np.float64]:
        distances = self.points - self._mean
        for axis in np.flatnonzero(self._sided):
            distances[axis] = _distance(self.points[axis], self._intervals[axis])
        return distances

    def _along(
        self,
        direction: NDArray[np.float64],
        projected: NDArray[np.float64],
        rng: np.random.Generator,
    ) -> NDArray[np.float64]:
        """Move along a direction (k,); return by how much F d, (r, count), changes."""
        axes = np.flatnonzero(np.abs(direction) > SMALLEST_CORRELATION)
        parts = direction[axes, None]
        points, lower, upper = self.points[axes], self._lower[axes], self._upper[axes]
        # As far as each axis may move until it meets the end behind it, and the one ahead.
        behind, ahead = np.where(parts > 0.0, lower, upper), np.where(parts > 0.0, upper, lower)
        inverse = 1.0 / parts
        scaled = points * inverse
        least = np.minimum((behind * inverse - scaled).max(axis=0), 0.0)
        most = np.maximum((ahead * inverse - scaled).min(axis=0), 0.0)
        slopes = self._factor @ direction
        precision = float(slopes @ slopes)
        informed = precision > SMALLEST_SINGULAR_VALUE**4
        moves = truncated_normal_quantiles(
            rng.random(least.size),
            -(slopes @ projected) / precision if informed else 0.0,
            precision**-0.5 if informed else np.inf,
            least,
            most,
        )
        points += parts * moves
        self.points[axes] = np.minimum(np.maximum(points, lower, out=points), upper, out=points)
        return np.outer(slopes, moves)

    def _along_sided(
        self, axis: int, projected: NDArray[np.float64], rng: np.random.Generator
    ) -> NDArray[np.float64]:
        """Move along the axis of a one-sided interval; return by how much F d changes."""
        slopes, interval = self._factor[:, axis], self._intervals[axis]
        precision = float(slopes @ slopes)
        before = _distance(self.points[axis], interval)
        self.points[axis] = flat_interval_quantiles(
            rng.random(before.size),
            slopes @ projected - precision * before,
            precision,
            (interval[0], interval[1]),
            (self._lower[axis], self._upper[axis]),
        )
        return np.outer(slopes, _distance(self.points[axis], interval) - before)


def _distance(points: NDArray[np.float64], interval: NDArray[np.float64]) -> NDArray[np.float64]:
    """Distance from an interval, negative below it."""
    return np.asarray(points - np.clip(points, interval[0], interval[1]))


def compressed(
    factor: NDArray[np.float64], scale: float = 1.0, smallest: float = SMALLEST_SINGULAR_VALUE
) -> NDArray[np.float64]:
    """Return a factor of the same information over scale², in its numerical rank.

    Parameters
    ----------
    factor : (r, n), per width
    smallest : per width, singular values below it are left out
    scale : 0: all that there is information on is known exactly

    Returns
    -------
    (rank, n), per width
    """
    if not factor.size:
        return factor.copy()
    _, values, vectors = np.linalg.svd(factor, full_matrices=False)
    kept = values >= smallest
    if scale > 0.0:
        kept &= values >= smallest * scale
    with np.errstate(divide="ignore"):
        values = np.minimum(values[kept] / scale, LARGEST_SINGULAR_VALUE)
    return np.asarray(values[:, None] * vectors[kept])


def truncated_normal_quantiles(
    shares: ArrayLike,
    mean: ArrayLike,
    deviation: ArrayLike,
    lower: ArrayLike,
    upper: ArrayLike,
) -> NDArray[np.float64]:
    """Return quantiles of normal distributions cut off at two ends; all arrays are broadcast.

    Parameters
    ----------
    shares : (…) probabilities below the quantiles
    mean : (…) of any unit, as all below, before and not after the ends are cut off
    deviation : (…) above zero; where it is infinite, the distribution is uniform between the ends
    lower, upper : (…) ends, lower ≤ upper; the mean may lie outside

    Returns
    -------
    (…), in the unit of the mean, never outside the ends
    """
    shares, mean, deviation, lower, upper = np.broadcast_arrays(
        *(np.asarray(each, dtype=np.float64) for each in (shares, mean, deviation, lower, upper))
    )
    flat = (upper - lower) <= FLAT * deviation
    flat &= np.abs(0.5 * (upper + lower) - mean) * (upper - lower) <= FLAT * deviation**2
    scale = np.where(flat, 1.0, np.maximum(deviation, EXACT))
    low, high = (lower - mean) / scale, (upper - mean) / scale
    # Mirrored, the greater part lies below the mean, where probabilities are exact.
    mirrored = low + high > 0.0
    below, above = np.where(mirrored, -high, low), np.where(mirrored, -low, high)
    part = np.where(mirrored, 1.0 - shares, shares)
    mass = ndtr(above) - ndtr(below)
    lower_tail, upper_tail = ndtr(below) + part * mass, ndtr(-above) + (1.0 - part) * mass
    # Of the two tails the smaller is exact.
    places = np.where(lower_tail < upper_tail, ndtri(lower_tail), -ndtri(upper_tail))
    far = (above < FAR) & ~flat
    if far.any():
        with np.errstate(divide="ignore"):
            logarithms = np.logaddexp(
                log_ndtr(below[far]) + np.log1p(-part[far]),
                log_ndtr(above[far]) + np.log(part[far]),
            )
        places[far] = ndtri_exp(logarithms)
    quantiles = mean + scale * np.where(mirrored, -places, places)
    quantiles = np.where(flat, lower + shares * (upper - lower), quantiles)
    return np.asarray(np.minimum(np.maximum(quantiles, lower), upper))


def log_normal_mass(low: NDArray[np.float64], high: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the logarithm of what a standard normal distribution has between two ends.

    Parameters
    ----------
    low, high : (…) ends in standard deviations from the mean

    Returns
    -------
    (…), minus infinity where low is not below high
    """
    mirrored = low + high > 0.0
    below = log_ndtr(np.where(mirrored, -high, low))
    above = log_ndtr(np.where(mirrored, -low, high))
    with np.errstate(divide="ignore", invalid="ignore"):
        mass = above + np.log(-np.expm1(below - above))
    return np.where(high > low, mass, -np.inf)


def flat_interval_quantiles(
    shares: ArrayLike,
    slope: ArrayLike,
    precision: ArrayLike,
    interval: tuple[ArrayLike, ArrayLike],
    ends: tuple[ArrayLike, ArrayLike],
) -> NDArray[np.float64]:
    """Return quantiles of distributions that are flat within an interval and fall outside.

    With the distance d from the interval (below it negative, within it zero) the logarithm of the
    density is - precision d² / 2 - slope d: in three pieces, one flat and two of normal
    distributions. All arrays are broadcast.

    Parameters
    ----------
    shares : (…) probabilities below the quantiles
    slope : (…) per unit
    precision : (…) per unit²; zero: the density is flat everywhere
    interval : its two ends, (…) each
    ends : two ends (…) at which the distribution is cut off

    Returns
    -------
    (…), never outside `ends`
    """
    shares, slope, precision, first, last, lower, upper = np.broadcast_arrays(
        *(np.asarray(v, dtype=np.float64) for v in (shares, slope, precision, *interval, *ends))
    )
    flat = precision * (upper - lower) ** 2 <= FLAT**2
    deviation = 1.0 / np.sqrt(np.where(flat, 1.0, precision))
    offset = np.where(flat, 0.0, slope) * deviation**2
    cuts = [lower, np.clip(first, lower, upper), np.clip(last, lower, upper), upper]
    means = (first - offset, last - offset)
    peak = 0.5 * (offset / deviation) ** 2 + np.log(deviation * np.sqrt(2.0 * np.pi))
    below, above = (
        peak + log_normal_mass((cuts[k] - mean) / deviation, (cuts[k + 1] - mean) / deviation)
        for k, mean in zip((0, 2), means, strict=True)
    )
    with np.errstate(divide="ignore"):
        masses = np.array([below, np.log(cuts[2] - cuts[1]), above])
    masses = np.where(np.isfinite(masses).any(axis=0), masses, 0.0)
    weights = np.exp(masses - masses.max(axis=0))
    weights /= weights.sum(axis=0)
    before = np.array([np.zeros_like(shares), weights[0], weights[0] + weights[1]])
    piece = (shares >= before[1]).astype(int) + (shares >= before[2])
    piece = np.where(np.take_along_axis(weights, piece[None], axis=0)[0] > 0.0, piece, 1)
    begin, weight = (np.take_along_axis(v, piece[None], axis=0)[0] for v in (before, weights))
    within = np.clip((shares - begin) / np.maximum(weight, np.finfo(float).tiny), 0.0, 1.0)
    quantiles = truncated_normal_quantiles(
        within,
        np.where(piece == 0, *means),
        np.where(piece == 1, np.inf, deviation),
        np.choose(piece, cuts[:3]),
        np.choose(piece, cuts[1:]),
    )
    return np.where(flat, lower + shares * (upper - lower), quantiles)
