"""Observations that what is known does not explain: they are set aside, and may come back."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from intuitive_physics_learner.assessment.reasons import Reason
from intuitive_physics_learner.cost.cost_function import Cost
from intuitive_physics_learner.online.lone_fit import LoneFit
from intuitive_physics_learner.online.online_state import Member, OnlineState
from intuitive_physics_learner.search.gaussian import Gaussian
from intuitive_physics_learner.store.observation_entries import DOUBTFUL, USED, Assessment

FREE_SCANS = (2, 5)
"""Numbers of steps after which a lone fit that knows nothing of θ_s scans each parameter; set by
hand."""

CONFLICT = 7.0
"""Logarithm of the ratio of evidences, of what is not bound by what is known to what is, from which
on an observation contradicts what is known: odds of a thousand to one."""

SMALLEST_EXPLAINED = 0.6
"""Share of the last observations that can be explained from which on one that cannot be is
doubtful; where motion is too chaotic for that, most such observations are good ones; of clean
throws of tumbling bodies 0.6 to 0.7 can be, of balls 0.9."""

MEMORY = 20.0
"""Observations after which one counts 1/e of what it did in the share that can be explained; set by
hand."""

FEW = 2.0
"""Observations that could not be explained, imagined before the first: one success is no rule."""

LARGEST_DOUBTFUL_COUNT = 16
"""Largest number of doubtful observations that are kept to be fitted again."""

LARGEST_EXPONENT = 700.0
"""Largest argument of exp in double precision."""


@dataclass(frozen=True, eq=False)
class Doubt:
    """Why an observation is set aside.

    Parameters
    ----------
    fit : that knows nothing of θ_s
    assessment : to be noted
    disturbed : whether nothing explains it, so that it says nothing of any knowledge
    """

    fit: LoneFit
    assessment: Assessment
    disturbed: bool


def reason_for_doubt(state: OnlineState, cost: Cost, fit: LoneFit) -> Doubt | None:
    """Compare a fit with one that knows nothing; None where its observation is not doubtful."""
    share = state.explained / (state.met + FEW)
    kept = np.exp(-1.0 / MEMORY)
    state.met = kept * state.met + 1.0
    state.explained = kept * state.explained + (0.0 if fit.blocked else 1.0)
    if not fit.blocked:
        return None
    (observation,) = cost.observations
    free = LoneFit(cost, state, Gaussian.within_bounds(state.prior.mean), scans=FREE_SCANS)
    horizon = max(free.observation_fit.horizon, fit.observation_fit.horizon)
    gain = free.log_evidence(horizon) - fit.log_evidence(horizon)
    if gain > CONFLICT:
        weight = float(np.exp(-min(gain, LARGEST_EXPONENT)))
        odds = f"e^{gain:.0f} times as likely with other parameters"
        reason = f"{Reason.CONTRADICTORY.value}: {odds}"
        return Doubt(free, Assessment(observation.id, weight, reason, DOUBTFUL), False)
    if free.blocked and share > SMALLEST_EXPLAINED:
        reason = Reason.UNEXPLAINED.at(horizon)
        return Doubt(free, Assessment(observation.id, 1.0 - share, reason, DOUBTFUL), True)
    return None


def set_aside(state: OnlineState, member: Member) -> None:
    """Keep an observation apart from those that are learned from."""
    state.doubtful.append(replace(member, weight=0.0))
    del state.doubtful[:-LARGEST_DOUBTFUL_COUNT]
    state.set_aside += 1


def take_back(state: OnlineState, member: Member) -> Assessment:
    """Learn from an observation that was set aside."""
    state.window.append(replace(member, weight=1.0))
    state.set_aside -= 1
    return Assessment(member.id, 1.0, "agrees with later observations", USED)
