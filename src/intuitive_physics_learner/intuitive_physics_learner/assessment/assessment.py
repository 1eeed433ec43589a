"""Which observations are of undisturbed motions, well measured: a probability and a reason of each.

Laws of motion that hold for every θ_s are tested before anything is learned (`motion_laws`), so
the assessment does not depend on how far a search came. The least of their p values is uniform at
most among good observations and, among others, of the density Beta(a, 1) = a p^(a - 1), which is
concentrated at 0 (Pounds and Morris 2003, mixture of p values). The share of the others is
estimated by expectation and maximisation, with a Beta prior on it.

Where the tests find fault with more than half of the observations the noise model is wrong rather
than most of them disturbed: all logarithms of p are divided by what makes their median that of a
uniform p, as in genomic control (Devlin and Roeder 1999).

After a search, where the fit of an observation stops is compared with where those of the others do
(`reassessed`). The scale is that of the observations themselves: chaos, or a search that was cut
short, lets all fits stop early and with large misfits, and none of them is at fault.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm, t

from intuitive_physics.observation import Observation, ObservedObject
from intuitive_physics.trajectory import Trajectory
from intuitive_physics_learner.assessment.motion_laws import (
    flight_violation,
    impulse_violations,
    jump_violation,
    rest_violation,
)
from intuitive_physics_learner.assessment.settings import AssessmentSettings
from intuitive_physics_learner.assessment.tracks import Track, tracks_of
from intuitive_physics_learner.assessment.violation import Violation
from intuitive_physics_learner.joint_estimation.point_noise import (
    MEDIAN_LENGTH_3,
    detected,
    track_noises,
)
from intuitive_physics_learner.joint_estimation.settings import JointEstimationSettings
from intuitive_physics_learner.store.observation_entries import DOUBTFUL, USED, Assessment

MIXTURE_STEPS = 100
"""Steps of expectation and maximisation, which contract by some tenths each."""


@dataclass(frozen=True, eq=False)
class AssessedObservations:
    """Observations with what is thought of them.

    Parameters
    ----------
    clean : the observations, those that are doubtful up to where they were disturbed
    assessments : of each, in the same order
    """

    clean: tuple[Observation, ...]
    assessments: tuple[Assessment, ...]


def assess_observations(
    observations: Sequence[Observation],
    trusted: Collection[str] = (),
    settings: AssessmentSettings | None = None,
) -> AssessedObservations:
    """Test laws of motion on each observation.

    Parameters
    ----------
    observations : with detections where they were smoothed
    trusted : ids of those that a user holds for good: they are assessed, but never doubtful
    settings : of the tests and of the mixture
    """
    settings = settings or AssessmentSettings()
    tested = [detected(seen) for seen in observations]
    noises = track_noises(tested, JointEstimationSettings())
    found = [
        _violations(tracks_of(seen, [one.whitening for one in noise]), settings)
        for seen, noise in zip(tested, noises, strict=True)
    ]
    log_ps = np.array([_least(violations) for violations in found])
    weights = good_probabilities(log_ps, settings)
    clean, assessments = [], []
    for seen, violations, weight in zip(observations, found, weights.tolist(), strict=True):
        if weight >= settings.least_good or seen.id in trusted:
            clean.append(seen)
            assessments.append(Assessment(seen.id, weight, "", USED))
            continue
        worst = min(violations, key=lambda one: one.log_p)
        notable = [one for one in violations if one.log_p <= max(0.5 * worst.log_p, LEAST_NOTABLE)]
        first = min(notable, key=lambda one: one.clean_until)
        began = min(float(each.trajectory.times[0]) for each in seen.objects)
        reason = f"{worst.what} at t = {worst.time - began:.2f} s"
        clean.append(clean_part(seen, first.clean_until, settings))
        assessments.append(Assessment(seen.id, weight, reason, DOUBTFUL))
    return AssessedObservations(tuple(clean), tuple(assessments))


def reassessed(
    assessments: Sequence[Assessment],
    lengths: NDArray[np.float64],
    times: NDArray[np.float64],
    trusted: Collection[str] = (),
    settings: AssessmentSettings | None = None,
) -> tuple[Assessment, ...]:
    """Assess also by what the fits of a search left unexplained.

    The logarithms of the lengths follow Student's distribution where observations are good, about
    their median and with the spread from there to their 84 % quantile, which a share of disturbed
    ones below 16 % does not move.

    `lengths` (n,) σ, of residuals just beyond where each fit stops; NaN where it does not stop;
    `times` (n,) s after the start, where these are.
    """
    settings = settings or AssessmentSettings()
    rest = np.flatnonzero([one.status == USED for one in assessments])
    if rest.size == 0:
        return tuple(assessments)
    sizes = np.log(np.maximum(np.nan_to_num(lengths[rest], nan=MEDIAN_LENGTH_3), MEDIAN_LENGTH_3))
    middle, upper = np.quantile(sizes, [0.5, norm.cdf(1.0)])
    spread = max(float(upper - middle), settings.smallest_stop_spread)
    scores = (sizes - middle) / spread
    weights = good_probabilities(t.logsf(scores, settings.stop_freedom), settings)
    found = list(assessments)
    for member, weight in zip(rest.tolist(), weights.tolist(), strict=True):
        one = assessments[member]
        weight *= one.weight
        if weight >= settings.least_good or one.id in trusted:
            found[member] = replace(one, weight=weight)
        else:
            reason = f"its fit fails at t = {times[member]:.2f} s as no other does"
            found[member] = Assessment(one.id, weight, reason, DOUBTFUL)
    return tuple(found)


LEAST_NOTABLE = -10.0
"""Logarithm of a p value, 0.005 %, from which on a violation beside the worst one decides from when
on an observation is not used."""


def clean_part(seen: Observation, until: float, settings: AssessmentSettings) -> Observation:
    """Return an observation up to a time, and with a few points after its start in any case.

    `until` in s, on the clock of its trajectories.
    """
    objects = tuple(
        _cut(each, until, seen.start_time, settings.least_points) for each in seen.objects
    )
    return replace(seen, objects=objects)


def _cut(seen: ObservedObject, until: float, start: float, least: int) -> ObservedObject:
    def count(times: NDArray[np.float64]) -> int:
        inside, before = np.searchsorted(times, [until, start], side="right").tolist()
        return max(inside, min(before + least, times.size))

    track, found = seen.trajectory, seen.detections
    kept = count(track.times)
    trajectory = Trajectory(track.times[:kept], track.positions[:kept])
    if found is not None:
        kept = count(found.times)
        found = replace(
            found,
            times=found.times[:kept],
            positions=found.positions[:kept],
            covariances=found.covariances[:kept],
        )
    return replace(seen, trajectory=trajectory, detections=found)


def _violations(tracks: Sequence[Track], settings: AssessmentSettings) -> list[Violation]:
    found = []
    for track in tracks:
        each = [
            jump_violation(track, settings),
            flight_violation(track, settings),
            rest_violation(track, settings),
            *impulse_violations(track, settings),
        ]
        found += [one for one in each if one is not None]
    return found


def _least(violations: Sequence[Violation]) -> float:
    """Return the logarithm of the p value of the worst of all tests (Bonferroni)."""
    if not violations:
        return 0.0
    return min(0.0, min(one.log_p for one in violations) + float(np.log(len(violations))))


def good_probabilities(
    log_ps: NDArray[np.float64], settings: AssessmentSettings
) -> NDArray[np.float64]:
    """Return the probability (n,) of each observation to be good.

    `log_ps` (n,) logarithms of p values that are uniform, or larger, where good.
    """
    if log_ps.size == 0:
        return np.zeros(0)
    scale = max(1.0, float(np.median(log_ps)) / np.log(0.5))
    bounded = np.maximum(log_ps / scale, settings.smallest_log_p)
    a = settings.alternative_power
    density = a * np.exp((a - 1.0) * bounded)
    yes, no = settings.disturbed_prior
    share = yes / (yes + no)
    for _ in range(MIXTURE_STEPS):
        others = share * density / (1.0 - share + share * density)
        share = min((others.sum() + yes) / (others.size + yes + no), settings.largest_share)
    return np.asarray((1.0 - share) / (1.0 - share + share * density))
