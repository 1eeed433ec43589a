"""Which observations are kept, and for how much they count by their age."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_learner.online.online_state import Member, OnlineState

MOST_KEPT = 100
"""Largest number of observations that are kept to be fitted again, if the window is not larger: the
newest, for what they say of the world of now."""

RECENT = 8
"""Number of last observations that do not leave the window, and among which a change may begin."""

FORGOTTEN = float(np.exp(-7.0))
"""Weight by its age below which an observation is not fitted any more: a thousandth."""


def grow_older(state: OnlineState, stamp: float, time_constant: float) -> None:
    """Let what is known grow older, to the start time in s of a new observation."""
    last, state.time = state.time, stamp if state.time is None else max(state.time, stamp)
    if last is None or time_constant == 0.0:
        return
    factor, given = float(np.exp(-(state.time - last) / time_constant)), state.given()
    for name in ("ground", "retired", "posterior"):
        known = getattr(state, name).scaled(factor)
        setattr(state, name, known.joined(given, 1.0 - factor))
    state.retired_spins.discount(factor)
    for member in state.kept:
        member.weight *= factor


def age_weight(state: OnlineState, member: Member, time_constant: float) -> float:
    """Weight of an observation by its age, 0 to 1."""
    if time_constant == 0.0 or state.time is None:
        return 1.0
    return float(np.exp(-(state.time - member.stamp) / time_constant))


def let_go_of_old(state: OnlineState, time_constant: float) -> None:
    """Fit observations no more that hardly count by their age."""
    for member in state.kept:
        if age_weight(state, member, time_constant) < FORGOTTEN:
            let_go(state, member)


def retire(state: OnlineState, window: int) -> None:
    """Let leave a window that is too full what says least, and go what left it first."""
    while len(state.window) > window:
        covariance = state.prior.covariance
        newest = state.processed - RECENT
        old = [member for member in state.window if member.number <= newest] or state.window[:1]
        leaving = min(old, key=lambda member: _worth(member, covariance))
        state.window = [each for each in state.window if each is not leaving]
        state.past.append(leaving)
    while len(state.past) > max(MOST_KEPT - window, 0):
        let_go(state, min(state.past, key=lambda member: member.number))


def let_go(state: OnlineState, member: Member) -> None:
    """Keep of an observation only what it says of the parameters."""
    state.retired = state.retired.plus([member.likelihood], [member.weight])
    state.retired_spins.add_all(member.likelihood.spins, member.weight)
    state.drop(member)


def _worth(member: Member, covariance: NDArray[np.float64]) -> float:
    """Information of an observation on what is uncertain: tr(P Λ)."""
    parameters = member.likelihood.parameters
    part = covariance[np.ix_(parameters, parameters)]
    return member.weight * float(np.sum(part * member.likelihood.information))
