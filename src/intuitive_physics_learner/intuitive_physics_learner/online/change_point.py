"""Whether the parameters of a pair have changed: a generalised likelihood ratio.

Before some observations θ_s is known as a Gaussian about m with the covariance P. Those
observations together have the information L = Σ Λ_i and, at m, the scores G = Σ g_i(m). Had the
parameters of one pair (E selects them) changed right before, the logarithm of the likelihood ratio,
at the most likely change and doubled, is

    T = vᵀ V⁺ v,    v = Eᵀ (1 + L P)⁻¹ G,    V = Eᵀ (1 + L P)⁻¹ L E,

and without a change χ² distributed (`docs/method/learning.md`). One disturbed observation makes T
as large as a change does, so several observations must agree: T must be as improbable without any
one of them, and most of them must be as near to their common estimate as chance puts them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from intuitive_physics.parameter_posterior import UNIFORM_PRECISION
from intuitive_physics_learner.online.memory import RECENT, age_weight, let_go
from intuitive_physics_learner.online.online_state import ChangePoint, Member, OnlineState
from intuitive_physics_learner.online.options import OnlineOptions
from intuitive_physics_learner.search.gaussian import Gaussian, LocalLikelihood

FEWEST_CHANGED = 4
"""Observations that must agree on a change: fewer may be disturbed alike by chance."""

LARGEST_CHANGE_COUNT = 10
"""Largest number of changes that are kept."""

OUTWEIGHED = 0.01
"""Rate of false alarms where what is remembered counts less than what is set aside, so that it no
longer is what most observations agree on."""

AGREEMENT = 0.01
"""Probability under which the median observation does not agree with the others."""


def forget_what_changed(state: OnlineState, options: OnlineOptions) -> list[Member] | None:
    """Forget the parameters of a pair that have changed, and all observations before the change.

    Returns the doubtful observations after it, which agree with it; None where nothing is noticed.
    """
    newest = state.processed - RECENT
    kept = [each for each in (*state.window, *state.doubtful) if each.number > newest]
    kept.sort(key=lambda member: member.number)
    families = state.families
    change = find_change(
        state.posterior,
        state.centre,
        [(member.likelihood, member.weight) for member in kept],
        families,
        {pair: _count_of(state, parameters) for pair, parameters in families.items()},
        OUTWEIGHED if _is_outweighed(state, options) else options.false_alarm_rate,
    )
    if change is None:
        return None
    state.changes.append((change, state.processed - change.length))
    del state.changes[:-LARGEST_CHANGE_COUNT]
    after = kept[-change.length :]
    for member in state.kept:
        if member not in after:
            let_go(state, member)
    state.forget_pair(families[change.pair], ground=True)
    return [member for member in state.doubtful if member in after]


def _is_outweighed(state: OnlineState, options: OnlineOptions) -> bool:
    """Whether what is remembered counts less, by its age, than what is set aside.

    Not before observations are forgotten: until then what is known is what most agree on.
    """
    remembered, doubtful = (
        sum(age_weight(state, member, options.time_constant) for member in members)
        for members in (state.kept, state.doubtful)
    )
    return options.time_constant > 0.0 and doubtful > remembered


def _count_of(state: OnlineState, parameters: NDArray[np.int64]) -> int:
    """Number of observations that inform some parameters; retired ones are enough."""
    retired = state.retired.precision[np.ix_(parameters, parameters)].any()
    dependent = [member.likelihood.parameters for member in state.kept]
    count = sum(bool(np.isin(each, parameters).any()) for each in dependent)
    return count + (RECENT if retired else 0)


def find_change(
    information: Gaussian,
    centre: NDArray[np.float64],
    recent: Sequence[tuple[LocalLikelihood, float]],
    families: Mapping[tuple[str, ...], NDArray[np.int64]],
    counts: Mapping[tuple[str, ...], int],
    false_alarm_rate: float,
) -> ChangePoint | None:
    """Look for a change before any of the last observations.

    `centre` (n,) mean where nothing is known; `families` (k,) indices of the parameters of
    each pair of materials.
    """
    asked = max(len(recent) - FEWEST_CHANGED + 1, 0) * len(families)
    best: ChangePoint | None = None
    for length in range(FEWEST_CHANGED, len(recent) + 1):
        before = information.plus(
            [likelihood for likelihood, _ in recent[-length:]],
            [-weight for _, weight in recent[-length:]],
        )
        prior = before.bounded(centre)
        if np.linalg.eigvalsh(prior.precision)[0] <= 0.0:
            continue
        for family, members in families.items():
            influenced = [k for k in recent[-length:] if np.isin(k[0].parameters, members).any()]
            earlier = counts[family] - sum(weight > 0.0 for _, weight in influenced)
            if min(len(influenced), earlier) < FEWEST_CHANGED:
                continue
            informing = [likelihood for likelihood, _ in influenced]
            probability = _agreed_probability(prior, informing, members)
            if probability < min(
                false_alarm_rate / asked, best.probability if best is not None else 1.0
            ) and _agree(before, centre, informing, members):
                best = ChangePoint(family, length, probability)
    return best


def change_probability(
    prior: Gaussian,
    likelihoods: Sequence[LocalLikelihood],
    members: NDArray[np.int64],
    weights: Sequence[float] | None = None,
) -> float:
    """Probability of so large a ratio T if the parameters `members` (k,) have not changed."""
    together = Gaussian.nothing(prior.mean.size).plus(likelihoods, weights)
    information, scores = together.precision, together.scores(prior.mean)
    # (1 + L P)⁻¹ = P⁻¹ (P⁻¹ + L)⁻¹.
    solved = prior.precision @ np.linalg.solve(
        prior.precision + information, np.column_stack([information, scores])
    )
    projected = solved[np.ix_(members, members)]
    return _chance(solved[members, -1], projected)


def _chance(scores: NDArray[np.float64], covariance: NDArray[np.float64]) -> float:
    """Probability of larger scores (k,), normal about 0 with a covariance (k, k)."""
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    informed = values > UNIFORM_PRECISION
    if not informed.any():
        return 1.0
    along = vectors[:, informed].T @ scores
    return float(chdtrc(informed.sum(), (along**2 / values[informed]).sum()))


def _agreed_probability(
    prior: Gaussian, likelihoods: Sequence[LocalLikelihood], members: NDArray[np.int64]
) -> float:
    """The largest probability (of T) that is left without any one of the observations."""
    return max(
        change_probability(
            prior, [likelihood for likelihood in likelihoods if likelihood is not left_out], members
        )
        for left_out in likelihoods
    )


def _agree(
    before: Gaussian,
    centre: NDArray[np.float64],
    likelihoods: Sequence[LocalLikelihood],
    members: NDArray[np.int64],
) -> bool:
    """Whether most observations are as near to their common estimate as chance puts them."""
    common = before.without(members).plus(likelihoods).bounded(centre).mean
    probabilities = []
    for likelihood in likelihoods:
        scores = likelihood.scores + likelihood.information @ (
            common[likelihood.parameters] - likelihood.estimate
        )
        probabilities.append(_chance(scores, likelihood.information))
    return bool(np.median(probabilities) > AGREEMENT)
