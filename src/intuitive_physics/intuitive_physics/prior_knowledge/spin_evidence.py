"""How balls are thrown here, from the initial spins that a joint fit finds.

A fit gives the posterior of each initial spin ω that was a guess: mean m and covariance P, with θ_s
and the rest of the initial state integrated out, under the prior N(0, σ₀² I) of the guess. Without
that prior, what the trajectory says of ω is the Gaussian of precision Λ = P⁻¹ - I / σ₀² and of pull
h = P⁻¹ m. Thrown with spins N(0, σ² I), it has the marginal likelihood, with λ_k and h_k along the
axes of Λ,

    ln p(σ) - ln p(0) = ½ Σ_k [h_k² σ² / (1 + σ² λ_k) - ln(1 + σ² λ_k)],

which is that of N(Λ⁻¹ h; 0, σ² I + Λ⁻¹), where Λ has an inverse. An axis of which the trajectory
says nothing adds exactly nothing. Its expected information on ln σ is 2 w_k² for each axis, with
w_k = σ² λ_k / (1 + σ² λ_k): so Σ w_k² / 3 throws of exactly measured spin say as much.

The sums of both over throws, on a grid of ln σ, are all that is kept: they are the same in every
order and grow by addition. Where the first one and the prior of ln σ (`PRIOR_THROWS` of
`initial_spins`) have their maximum is the estimate, as in empirical Bayes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.observation import Observation
from intuitive_physics.prior_knowledge.initial_spins import (
    PRIOR_THROWS,
    SPIN_AXES,
    InitialSpins,
    SpinSpread,
    unknown_spin,
)
from intuitive_physics.state import ANGULAR_VELOCITY, ERROR_SIZE

GRID = np.linspace(np.log(0.01), np.log(1e4), 141)
"""ln σ, σ in rad/s: from far below what moves a ball to far above any launcher; with a parabola
through the highest three the maximum is within 0.3 % of σ, a standard error of 20,000 throws."""

INFORMATION = 2.0 * SPIN_AXES
"""Information on ln σ of one throw whose spin is measured exactly: two for each component."""

ROUNDING = 1e-6
"""Part of the prior's precision below which what the data add to it is rounding."""

FEWEST_THROWS = 1e-9
"""Throws below which all have been forgotten."""


@dataclass(frozen=True, eq=False)
class UnknownSpin:
    """An initial spin that was a guess.

    Parameters
    ----------
    material : of its object
    stated : σ₀, rad/s on each axis
    places : (3,) indices of its components among the free ones of the initial states
    """

    material: str
    stated: float
    places: NDArray[np.int64]


def unknown_spins(observation: Observation, components: NDArray[np.int64]) -> list[UnknownSpin]:
    """Find the initial spins of an observation that were guesses.

    `components` (k,) index of each free component of the initial states on the axes (O, 12).
    """
    likelihoods = []
    for j, track in enumerate(observation.objects):
        stated = unknown_spin(track.object.shape, track.initial_state)
        first = j * ERROR_SIZE + ANGULAR_VELOCITY.start
        places = np.flatnonzero((components >= first) & (components < (j + 1) * ERROR_SIZE))
        if stated is not None and places.size:
            likelihoods.append(UnknownSpin(track.object.material, stated, places))
    return likelihoods


@dataclass(frozen=True, eq=False)
class SpinLikelihood:
    """Likelihood of the initial spin of an object, from one trajectory.

    Parameters
    ----------
    material : of the object
    stated : σ₀, rad/s on each axis, the guess in the observed initial state
    precision : (3, 3) Λ, s²/rad²
    pull : (3,) h, s/rad
    """

    material: str
    stated: float
    precision: NDArray[np.float64]
    pull: NDArray[np.float64]

    @staticmethod
    def of(
        spin: UnknownSpin, mean: NDArray[np.float64], covariance: NDArray[np.float64], prior: float
    ) -> SpinLikelihood:
        """Take the prior out of a posterior.

        `mean` (3,) rad/s, of the posterior; `covariance` (3, 3) rad²/s², of the posterior; `prior`
        in rad/s on each axis, standard deviation of the prior, whose mean is zero.
        """
        whole = np.linalg.inv(covariance)
        values, axes = np.linalg.eigh(0.5 * (whole + whole.T))
        left = values - prior**-2
        # Where the data say nothing, rounding must not say anything.
        left = np.where(left > ROUNDING * prior**-2, left, 0.0)
        pulls = np.where(left > 0.0, values * (axes.T @ mean), 0.0)
        precision = (axes * left) @ axes.T
        return SpinLikelihood(spin.material, spin.stated, precision, axes @ pulls)

    def on_grid(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return ln p(σ) - ln p(0), and the throws that say as much, both (G,) on the grid."""
        values, axes = np.linalg.eigh(self.precision)
        values, pulls = np.maximum(values, 0.0), axes.T @ self.pull
        variances = np.exp(2.0 * GRID)[:, None]
        narrowed = 1.0 + variances * values
        terms = pulls**2 * variances / narrowed - np.log(narrowed)
        informed = (1.0 - 1.0 / narrowed) ** 2
        return 0.5 * terms.sum(axis=1), informed.mean(axis=1)

    def to_dict(self) -> dict[str, Any]:
        """Return plain data that `from_dict` reads."""
        return {
            "material": self.material,
            "stated": self.stated,
            "precision": self.precision.tolist(),
            "pull": self.pull.tolist(),
        }

    @staticmethod
    def from_dict(data: Mapping[str, Any]) -> SpinLikelihood:
        """Read what `to_dict` wrote."""
        precision, pull = np.array(data["precision"]), np.array(data["pull"])
        return SpinLikelihood(data["material"], float(data["stated"]), precision, pull)


@dataclass(frozen=True, eq=False)
class _ThrowSum:
    """Sums over the throws of one material, which add up and can be scaled.

    Parameters
    ----------
    throws : number of throws
    log_stated : sum of ln σ₀
    log_likelihoods : (G,) on the grid
    counts : (G,) throws of exactly measured spin that say as much, on the grid
    """

    throws: float
    log_stated: float
    log_likelihoods: NDArray[np.float64]
    counts: NDArray[np.float64]

    @staticmethod
    def nothing() -> _ThrowSum:
        return _ThrowSum(0.0, 0.0, np.zeros_like(GRID), np.zeros_like(GRID))

    def plus(self, other: _ThrowSum, weight: float) -> _ThrowSum:
        return _ThrowSum(
            self.throws + weight * other.throws,
            self.log_stated + weight * other.log_stated,
            self.log_likelihoods + weight * other.log_likelihoods,
            self.counts + weight * other.counts,
        )

    def spread(self) -> SpinSpread:
        """Return the estimate, and how well it is known."""
        stated = float(np.exp(self.log_stated / self.throws))
        logarithms = self.log_likelihoods + log_normal(stated, PRIOR_THROWS)
        top = int(np.clip(np.argmax(logarithms), 1, GRID.size - 2))
        before, here, after = logarithms[top - 1 : top + 2]
        lean, bend = float(after - before), float(2.0 * here - before - after)
        away = 0.5 * (lean / bend if abs(lean) < bend else np.sign(lean))
        place = GRID[top] + away * (GRID[1] - GRID[0])
        count = float(np.interp(place, GRID, self.counts))
        return SpinSpread(float(np.exp(place)), count, stated)


def log_normal(centre: float, throws: float) -> NDArray[np.float64]:
    """Logarithm (G,), without a constant, of the normal density of ln σ on the grid.

    `centre` in rad/s, exp of its mean.
    """
    return np.asarray(-0.5 * INFORMATION * throws * (GRID - np.log(centre)) ** 2)


class SpinEvidence:
    """Evidence from throws on the spread of initial spins of each material."""

    def __init__(self, sums: Mapping[str, _ThrowSum] | None = None) -> None:
        self._sums = dict(sums or {})

    @staticmethod
    def about(spins: InitialSpins) -> SpinEvidence:
        """Return the evidence after which the spreads would be those given."""
        sums = {}
        for name, spread in spins.by_material.items():
            posterior = log_normal(spread.deviation, spread.count + PRIOR_THROWS)
            sums[name] = _ThrowSum(
                spread.count,
                spread.count * float(np.log(spread.stated)),
                posterior - log_normal(spread.stated, PRIOR_THROWS),
                np.full_like(GRID, spread.count),
            )
        return SpinEvidence(sums)

    def add_all(self, likelihoods: Iterable[SpinLikelihood], weight: float = 1.0) -> None:
        """Add the throws of one observation, times its weight."""
        for likelihood in likelihoods:
            throw = _ThrowSum(1.0, float(np.log(likelihood.stated)), *likelihood.on_grid())
            sums = self._sums.get(likelihood.material) or _ThrowSum.nothing()
            self._sums[likelihood.material] = sums.plus(throw, weight)

    def discount(self, factor: float) -> None:
        """Keep that part of what is known."""
        nothing = _ThrowSum.nothing()
        self._sums = {name: nothing.plus(sums, factor) for name, sums in self._sums.items()}

    def copy(self) -> SpinEvidence:
        """Return an independent copy."""
        return SpinEvidence(self._sums)

    def initial_spins(self) -> InitialSpins:
        """Return the spread of each material of which there are throws."""
        return InitialSpins(
            {
                name: sums.spread()
                for name, sums in self._sums.items()
                if sums.throws > FEWEST_THROWS
            }
        )

    def to_dict(self) -> dict[str, Any]:
        """Return plain data that `from_dict` reads."""
        return {
            name: {
                "throws": sums.throws,
                "log_stated": sums.log_stated,
                "log_likelihoods": sums.log_likelihoods.tolist(),
                "counts": sums.counts.tolist(),
            }
            for name, sums in self._sums.items()
        }

    @staticmethod
    def from_dict(data: Mapping[str, Mapping[str, Any]]) -> SpinEvidence:
        """Read what `to_dict` wrote."""
        return SpinEvidence(
            {
                name: _ThrowSum(
                    sums["throws"],
                    sums["log_stated"],
                    np.array(sums["log_likelihoods"]),
                    np.array(sums["counts"]),
                )
                for name, sums in data.items()
            }
        )
