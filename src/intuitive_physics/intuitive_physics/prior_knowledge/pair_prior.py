"""A prior of the coefficients of a pair of materials, learned from other pairs.

A hierarchical model with random effects of materials (Gelman & Hill 2007, chapters 11 to 13). On
the unit cube, for each of the four coefficients by itself, the pair of the materials a and b has

    u_ab = 1/2 + α + β_a + β_b + ε_ab,   α ~ N(0, v_α), β ~ N(0, v_β), ε ~ N(0, v_ε),

with v_α + 2 v_β + v_ε = 1/12: before anything is known a coefficient is as uncertain as a number
between its bounds, however that variance is shared out. Of what the observations say of all pairs,
means with an information matrix, the marginal likelihood of the shares has a closed form. They are
not set to its maximum, which is too sure of itself after few pairs, but averaged over a grid
(Gelman 2006 on priors of such variances).

What the model suggests of a pair uses what was observed of all *other* pairs, and only what it says
beyond the bounds: where nothing was observed or materials explain nothing, that is nothing.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp, softmax

from intuitive_physics.materials import PAIR_COEFFICIENTS, parameter_places
from intuitive_physics.parameter_posterior import UNIFORM_PRECISION, ParameterPosterior
from intuitive_physics.settings import check_settings, number, numbers
from intuitive_physics.truncated_gaussian import compressed

UNIFORM_VARIANCE = 1.0 / UNIFORM_PRECISION
"""Width²: variance of a number known only to lie within its bounds."""

PLACES, PLACE_WEIGHTS = np.polynomial.legendre.leggauss(128) * np.array([[0.5], [0.5]])
"""Points of the quadrature over the unit interval, from its middle, and their weights: exact to
rounding for standard deviations above 0.02 widths."""

SMALLEST_DEVIATION = 0.02
"""Width: a smaller standard deviation of what is suggested counts as this."""

NEGLIGIBLE = 1e-6
"""Share of the width of the bounds by which a suggestion must be sharper to be one at all."""

HALVINGS = 8
"""Most halvings of a Newton step that is too long."""

NEWTON_STEPS = 30
"""Most steps; the moments of a truncated normal distribution need a dozen."""


@dataclass(frozen=True)
class PairPriorSettings:
    """Grid of variances that the model of pairs is averaged over, and their prior."""

    own_shares: tuple[float, ...] = numbers(
        (1.0, 0.7, 0.4, 0.2, 0.1, 0.05, 0.02),
        1e-6,
        1.0,
        "share of the variance of a number between its bounds by which pairs differ from each "
        "other; the rest is common to all pairs. Steps of about a factor of two, which the "
        "likelihood of a dozen pairs hardly resolves, down to a scatter of 0.04 widths",
    )
    material_shares: tuple[float, ...] = numbers(
        (0.25, 0.5, 0.75, 0.9, 0.97),
        1e-6,
        1.0,
        "share of the difference between pairs that their materials explain. Set by hand: no sum "
        "of two material effects is a law of friction or restitution, so some is always left",
    )
    unexplained: float = number(
        0.8,
        0.0,
        1.0,
        "prior probability that materials explain nothing. Measured on worlds of independent "
        "pairs: with 0.5 a handful of pairs that are alike by chance suggest too much",
    )
    wide_preference: float = number(
        2.0,
        0.0,
        10.0,
        "power of an own share that its prior probability is proportional to. Measured likewise: "
        "with 4 materials and 5 pairs seen 95 % intervals of independent pairs hold 92 % with 2, "
        "81 % with 0",
    )

    least_information: float = number(
        96.0,
        0.0,
        1e12,
        "information of what was seen that counts, per width²: eight times that of the bounds. The "
        "means of what is known less well lie near where the search began, which is alike for all "
        "pairs: on a set of independent pairs they made 95 % intervals of friction hold 78 %",
    )

    def __post_init__(self) -> None:
        check_settings(self)

    @property
    def grid(self) -> list[tuple[float, float, float, float]]:
        """Prior probability, and shares of v_α, 2 v_β and v_ε, of each member."""
        powers = np.array(self.own_shares) ** self.wide_preference
        members = []
        for share, prior in zip(self.own_shares, powers / powers.sum(), strict=True):
            members.append((self.unexplained * prior, 1.0 - share, 0.0, share))
            each = (1.0 - self.unexplained) * prior / len(self.material_shares)
            for part in self.material_shares:
                members.append((each, 1.0 - share, share * part, share * (1.0 - part)))
        return members


@dataclass(frozen=True, eq=False)
class PairSuggestions:
    """Mean and spread of each parameter by other pairs, on the unit cube; of densities, none.

    Parameters
    ----------
    mean : (n,)
    standard_deviations : (n,) widths
    """

    mean: NDArray[np.float64]
    standard_deviations: NDArray[np.float64]


def pair_suggestions(
    posterior: ParameterPosterior, settings: PairPriorSettings | None = None
) -> PairSuggestions:
    """Return what the observations of all other pairs suggest of each pair.

    Parameters
    ----------
    posterior : of θ_s by the observations alone, without what this function suggested before
    settings : of the model; None for the defaults
    """
    settings = settings or PairPriorSettings()
    size, m = posterior.mean.size, len(posterior.materials)
    mean, variances = np.full(size, 0.5), np.full(size, UNIFORM_VARIANCE)
    rows, columns = np.triu_indices(m)
    design = np.zeros((rows.size, m))
    np.add.at(design, (np.arange(rows.size), rows), 1.0)
    np.add.at(design, (np.arange(rows.size), columns), 1.0)
    for kind in range(len(PAIR_COEFFICIENTS)):
        places = np.arange(m + kind, size, len(PAIR_COEFFICIENTS))
        if posterior.factor[:, places].any():
            evidence = _Evidence.of(posterior, places, settings.least_information)
            mean[places], variances[places] = _averaged(evidence, design, settings)
    return PairSuggestions(mean, np.sqrt(variances))


def with_pair_prior(
    posterior: ParameterPosterior,
    materials: Sequence[str] | None = None,
    settings: PairPriorSettings | None = None,
) -> ParameterPosterior:
    """Add to a posterior what the materials of pairs suggest of their coefficients.

    Of each coefficient by itself; one with a one-sided interval stays as it is. What was observed
    of a pair well enough hardly changes, one never seen gets what is suggested.

    Parameters
    ----------
    posterior : of θ_s by the observations
    materials : that the result is over; None: those of the posterior
    settings : of the model; None for the defaults
    """
    suggested = pair_suggestions(posterior, settings)
    materials = posterior.materials if materials is None else tuple(materials)
    old, new = parameter_places(posterior.materials, materials)
    extended = posterior.extended(materials)
    useful = suggested.standard_deviations[old] < np.sqrt(UNIFORM_VARIANCE) * (1.0 - NEGLIGIBLE)
    useful &= np.isnan(extended.intervals[new, 0])
    old, new = old[useful], new[useful]
    centres, added = extended.mean.copy(), np.zeros(extended.mean.size)
    centres[new], added[new] = matching_truncated_normals(
        suggested.mean[old], suggested.standard_deviations[old]
    )
    # Where both are zero, any number above zero leaves the mean as it is.
    whole = extended.information + np.diag(np.where(added > 0.0, added, UNIFORM_PRECISION))
    step = np.linalg.solve(whole, added * (centres - extended.mean))
    mean = np.clip(extended.mean + step, 0.0, 1.0)
    return extended.combined(np.diag(np.sqrt(added))[added > 0.0], mean)


@dataclass(frozen=True, eq=False)
class _Evidence:
    """Observations of one coefficient of all ψ pairs: z = G u + n with noise n of variance 1."""

    factor: NDArray[np.float64]
    """(r, ψ) G."""
    values: NDArray[np.float64]
    """(r,) z - G 1/2."""

    @staticmethod
    def of(posterior: ParameterPosterior, places: NDArray[np.int64], least: float) -> _Evidence:
        """Take the coefficients at `places` (ψ,) out of a posterior; integrate over all others.

        A combination of pairs whose information is below `least`, per width², does not count.
        """
        columns = posterior.factor[:, places]
        others = np.delete(posterior.factor, places, axis=1)
        ends = posterior.intervals[places]
        sided = ~np.isnan(ends[:, 0])
        values = np.where(sided, ends.mean(axis=1), posterior.mean[places])
        widths = np.where(sided, ends[:, 1] - ends[:, 0], 0.0)
        touching = columns.any(axis=1)
        columns, others = columns[touching], others[touching]
        # Within an interval, any value is as good: an error of a uniform distribution.
        noise = np.eye(len(columns)) + UNIFORM_VARIANCE * (
            others @ others.T + (columns * widths**2) @ columns.T
        )
        factor = compressed(np.asarray(np.linalg.solve(np.linalg.cholesky(noise), columns), float))
        factor = factor[(factor**2).sum(axis=1) >= least]
        return _Evidence(factor, factor @ (values - 0.5))


def _averaged(
    evidence: _Evidence, design: NDArray[np.float64], settings: PairPriorSettings
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return mean and variance (ψ,) of each pair by all others, averaged over the grid."""
    logarithms, means, variances = [], [], []
    for prior, covariance in _covariances(design, settings):
        member = _Member(evidence, covariance)
        logarithms.append(np.log(prior) + member.log_likelihood)
        mean, variance = member.by_others()
        means.append(mean)
        variances.append(variance)
    weights = softmax(logarithms)
    mean = weights @ np.array(means)
    return mean, weights @ (np.array(variances) + (np.array(means) - mean) ** 2)


def _covariances(
    design: NDArray[np.float64], settings: PairPriorSettings
) -> Iterator[tuple[float, NDArray[np.float64]]]:
    """Yield the prior probability and the covariance (ψ, ψ) of pairs of each member."""
    common, of_materials = np.ones((len(design), len(design))), 0.5 * design @ design.T
    for prior, alpha, beta, epsilon in settings.grid:
        if prior > 0.0:
            covariance = alpha * common + beta * of_materials + epsilon * np.eye(len(design))
            yield prior, UNIFORM_VARIANCE * covariance


class _Member:
    """The model with the covariance (ψ, ψ) of the pairs, after r combinations were seen."""

    def __init__(self, evidence: _Evidence, covariance: NDArray[np.float64]) -> None:
        self._covariance = covariance
        self._mixed = evidence.factor @ covariance
        whole = np.eye(evidence.values.size) + self._mixed @ evidence.factor.T
        self._precision = np.linalg.inv(whole)
        self._weighted = self._precision @ evidence.values
        self._factor = evidence.factor
        _, self._log_determinant = np.linalg.slogdet(whole)
        self._square = float(evidence.values @ self._weighted)

    @property
    def log_likelihood(self) -> float:
        """Logarithm of the marginal likelihood, but for a constant."""
        return -0.5 * (float(self._log_determinant) + self._square)

    def by_others(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return mean and variance (ψ,) of each pair, given what was seen of all others.

        What was seen of the pair itself is left out by an error of infinite variance, along its
        column g of G: P becomes P - P g gᵀ P / gᵀ P g.
        """
        mixed, factor = self._mixed, self._factor
        precise_mixed, precise_factor = self._precision @ mixed, self._precision @ factor
        information = np.einsum("rp,rp->p", factor, precise_factor)
        crossed = np.einsum("rp,rp->p", mixed, precise_factor)
        share = np.divide(
            crossed, information, out=np.zeros_like(information), where=information > 0.0
        )
        mean = mixed.T @ self._weighted - share * (factor.T @ self._weighted)
        explained = np.einsum("rp,rp->p", mixed, precise_mixed) - share * crossed
        variance = np.diag(self._covariance) - explained
        return 0.5 + mean, np.maximum(variance, 0.0)


def matching_truncated_normals(
    means: NDArray[np.float64], deviations: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return normal distributions which, cut off at 0 and 1, have given moments.

    With given mean and variance it is the distribution of the largest entropy. Where its centre
    would lie outside the unit interval, it is the one about the nearer end with the same mean
    square about that end.

    Parameters
    ----------
    means : (n,) wanted
    deviations : (n,) wanted

    Returns
    -------
    centres : (n,) from 0 to 1
    precisions : (n,) ≥ 0, per width²; 0: uniform
    """
    wanted = np.clip(means, 0.0, 1.0) - 0.5
    variances = np.maximum(deviations, SMALLEST_DEVIATION) ** 2
    features = np.stack([PLACES, -0.5 * PLACES**2])
    targets = np.stack([wanted, -0.5 * (wanted**2 + variances)], axis=1)
    natural = _largest_entropy(features, targets, np.stack([wanted / variances, 1 / variances], 1))
    precisions = natural[:, 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        centres = natural[:, 0] / precisions
    ends = 0.5 * np.sign(wanted)
    outside = (precisions <= 0.0) | (np.abs(centres) > 0.5)
    for end in (-0.5, 0.5):
        group = outside & (ends == end)
        squares = -0.5 * (PLACES - end) ** 2
        target = -0.5 * (variances[group] + (wanted[group] - end) ** 2)
        natural_at_end = _largest_entropy(
            squares[None], target[:, None], 1 / variances[group, None]
        )
        precisions[group], centres[group] = natural_at_end[:, 0], end
    flat = (precisions <= 0.0) | (ends == 0.0) & outside
    return np.where(flat, 0.5, 0.5 + centres), np.where(flat, 0.0, precisions)


def _largest_entropy(
    features: NDArray[np.float64], targets: NDArray[np.float64], start: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Natural parameters (n, k) of densities on the unit interval with given expectations.

    Newton's method on the convex dual, log ∫ exp(η φ) - η φ*, with steps that are halved:
    features (k, n_places) φ, targets (n, k) φ*, start (n, k) η.
    """
    natural = start.copy()
    for _ in range(NEWTON_STEPS):
        logarithms = natural @ features + np.log(PLACE_WEIGHTS)
        densities = softmax(logarithms, axis=1)
        expected = densities @ features.T
        spread = np.einsum("np,ip,jp->nij", densities, features, features)
        spread -= expected[:, :, None] * expected[:, None, :]
        spread += 1e-12 * np.eye(len(features))
        slope = expected - targets
        step = -np.linalg.solve(spread, slope[..., None])[..., 0]
        now = logsumexp(logarithms, axis=1) - (natural * targets).sum(axis=1)
        length = np.ones(len(natural))
        for _ in range(HALVINGS):
            tried = natural + length[:, None] * step
            after = logsumexp(tried @ features + np.log(PLACE_WEIGHTS), axis=1)
            worse = after - (tried * targets).sum(axis=1) > now + 1e-12
            if not worse.any():
                break
            length[worse] *= 0.5
        natural += np.where(worse, 0.0, length)[:, None] * step
        if np.abs(slope).max(initial=0.0) < 1e-12:
            break
    return natural
