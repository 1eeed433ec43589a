"""Observations of disturbed motions, or that contradict what is known: they are set aside.

Signs of a disturbance are those by which a search assesses its observations (`assessment`): laws of
motion, and undisturbed motions from where a fit stops. An observation is compared with those that
are kept, and later these with one another, by the signs that they showed when they came.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np

from intuitive_physics.simulation import Simulator
from intuitive_physics_learner.assessment.assessment import (
    assessed_by_laws,
    least_log_p,
    reassessed,
    violations_of,
    worst_reason,
)
from intuitive_physics_learner.assessment.reasons import Reason
from intuitive_physics_learner.assessment.undisturbed_motion import undisturbed_misfits
from intuitive_physics_learner.cost.cost_function import Cost
from intuitive_physics_learner.joint_estimation.normal_equations import NOISE_LOSS
from intuitive_physics_learner.online.lone_fit import LoneFit
from intuitive_physics_learner.online.online_state import Member, OnlineState, Signs
from intuitive_physics_learner.search.gaussian import Gaussian
from intuitive_physics_learner.store.observation_entries import DOUBTFUL, USED, Assessment

FREE_SCANS = (2, 5)
"""Numbers of steps after which a lone fit that knows nothing of θ_s scans each parameter; set by
hand."""

CONFLICT = 7.0
"""Logarithm of the ratio of evidences, of what is not bound by what is known to what is, from which
on an observation contradicts what is known: odds of a thousand to one."""

LARGEST_DOUBTFUL_COUNT = 16
"""Largest number of doubtful observations that are kept to be fitted again."""


@dataclass(frozen=True, eq=False)
class Examined:
    """An observation beside what is known.

    Parameters
    ----------
    fit : to what is known
    member : with what the observation says by itself
    doubt : why it is to be set aside; None: it is not
    """

    fit: LoneFit
    member: Member
    doubt: Assessment | None

    @property
    def predictable(self) -> bool:
        """Whether something explains it, be it other parameters."""
        return self.doubt is None or self.doubt.reason.startswith(Reason.CONTRADICTORY.value)


def examine(
    state: OnlineState, cost: Cost, simulator: Simulator, number: int, *, trusted: bool
) -> Examined:
    """Fit the `number`-th observation to what is known; unless trusted, judge it by its signs."""
    (observation,) = cost.observations
    fit = LoneFit(cost, state, state.prior)
    if fit.blocked:
        fit = LoneFit(cost, state, state.prior, careful=True)
    generator = np.random.default_rng(number)
    signs = signs_of(fit, simulator, generator)
    if trusted:
        return Examined(fit, replace(fit.member(number, signs), trusted=True), None)
    others = {member.id: member.signs for member in (*state.kept, *state.doubtful)}
    doubt = assessed({**others, observation.id: signs})[-1]
    good = doubt.status == USED
    if good and not fit.blocked:
        return Examined(fit, fit.member(number, signs), None)
    free = LoneFit(cost, state, Gaussian.within_bounds(state.prior.mean), scans=FREE_SCANS)
    horizon = max(free.observation_fit.horizon, fit.observation_fit.horizon)
    gain = free.log_evidence(horizon) - fit.log_evidence(horizon)
    if gain > CONFLICT:
        freely = signs_of(free, simulator, generator)
        if good or assessed({**others, observation.id: freely})[-1].status == USED:
            odds = f"e^{gain:.0f} times as likely with other parameters"
            reason, weight = f"{Reason.CONTRADICTORY.value}: {odds}", float(np.exp(-gain))
            contradiction = Assessment(observation.id, weight, reason, DOUBTFUL)
            return Examined(fit, free.member(number, freely), contradiction)
    return Examined(fit, (fit if good else free).member(number, signs), None if good else doubt)


def signs_of(fit: LoneFit, simulator: Simulator, generator: np.random.Generator) -> Signs:
    """Test laws of motion and follow undisturbed motions from where a fit stops; finite signs."""
    (violations,) = violations_of([fit.observation])
    misfits, times = undisturbed_misfits(fit.fit, simulator, generator)
    return Signs(
        float(np.nan_to_num(least_log_p(violations))),
        worst_reason(fit.observation, violations),
        float(np.nan_to_num(misfits, nan=NOISE_LOSS)[0]),
        float(np.nan_to_num(times)[0]),
    )


def assessed(members: Mapping[str, Signs], trusted: Collection[str] = ()) -> list[Assessment]:
    """Assess observations by their signs, as after a search; those trusted are never doubtful."""
    signs = list(members.values())
    log_ps, reasons = [each.log_p for each in signs], [each.violated for each in signs]
    by_laws = assessed_by_laws(list(members), log_ps, reasons, trusted)
    misfits, times = np.array([[each.misfit, each.time] for each in signs]).reshape(-1, 2).T
    return reassessed(by_laws, misfits, times, trusted)


def set_aside_disturbed(state: OnlineState) -> list[Assessment]:
    """Set those aside that stand out beside the observations that there are now."""
    kept = state.kept
    trusted = {each.id for each in kept if each.trusted}
    assessments = assessed({each.id: each.signs for each in (*kept, *state.doubtful)}, trusted)
    noted = []
    for member, assessment in zip(kept, assessments[: len(kept)], strict=True):
        if assessment.status == DOUBTFUL:
            state.drop(member)
            set_aside(state, member)
            noted.append(assessment)
    state.add_up()
    return noted


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
