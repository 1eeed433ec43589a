"""Which observations are of undisturbed motions, well measured: a probability and a reason of each.

Laws of motion that hold for every θ_s are tested before anything is learned (`motion_laws`), so
the assessment does not depend on how far a search came. The least of their p values is uniform at
most among good observations and, among others, of the density Beta(a, 1) = a p^(a - 1), which is
concentrated at 0 (Pounds and Morris 2003, mixture of p values). The share of the others is
estimated by expectation and maximisation, with a Beta prior on it.

Where the tests find fault with more than half of the observations the noise model is wrong rather
than most of them disturbed: all logarithms of p are divided by what makes their median that of a
uniform p, as in genomic control (Devlin and Roeder 1999).

After a search, observations are tested where their fits stop: up to there initial states are known
from the points, and of all motions that go on from them undisturbed one should explain what comes
next (`undisturbed_misfits`). The scale is that of the observations themselves (`reassessed`): where
θ_s is wrong, or the motion is so chaotic that none of the motions explains it, none of the
observations is at fault.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm
from scipy.stats import t as student

from intuitive_physics.observation import Observation, ObservedObject
from intuitive_physics.trajectory import Trajectory
from intuitive_physics_learner.assessment.motion_laws import (
    Violation,
    flight_violation,
    jump_violation,
    rest_violation,
)
from intuitive_physics_learner.assessment.reasons import Reason
from intuitive_physics_learner.assessment.tracks import track_of
from intuitive_physics_learner.cost.point_noise import detected, track_noises
from intuitive_physics_learner.joint_estimation.normal_equations import NOISE_LOSS
from intuitive_physics_learner.store.observation_entries import DOUBTFUL, USED, Assessment

LEAST_POINTS = 3
"""Points of each object that are left in any case."""

SMALLEST_MISFIT_SPREAD = 0.2
"""Standard deviation at least of the logarithm of a misfit: of noise, the largest of the mean
losses of ten to twenty segments of six points has 0.14 to 0.17, and motions are drawn at random."""

SMALLEST_LOG_P = -25.0
"""Logarithm of a p value at least: no noise model holds further out."""

ALTERNATIVE_POWER = 0.2
"""A of the density Beta(a, 1) of p of disturbed ones, set by hand."""

DISTURBED_PRIOR = (1.0, 9.0)
"""Beta prior of the share of disturbed observations, set by hand."""

LARGEST_SHARE = 0.5
"""Share of disturbed observations at most: most are good."""

LEAST_GOOD = 0.5
"""Probability of being good below which an observation is doubtful."""

MIXTURE_STEPS = 100
"""Steps of expectation and maximisation, which contract by some tenths each."""


def assess_observations(
    observations: Sequence[Observation], trusted: Collection[str] = ()
) -> tuple[list[Observation], list[Assessment]]:
    """Test laws of motion on each observation.

    Parameters
    ----------
    observations : with detections where they were smoothed
    trusted : ids of those that a user holds for good: they are assessed, but never doubtful

    Returns
    -------
    clean : the observations, those that are doubtful up to where they were disturbed
    assessments : of each, in the same order
    """
    all_violations = violations_of(observations)
    assessments = assessed_by_laws(
        [observation.id for observation in observations],
        [least_log_p(violations) for violations in all_violations],
        [worst_reason(*each) for each in zip(observations, all_violations, strict=True)],
        trusted,
    )
    clean = [
        clean_part(observation, _clean_until(violations))
        if each.status == DOUBTFUL
        else observation
        for observation, violations, each in zip(
            observations, all_violations, assessments, strict=True
        )
    ]
    return clean, assessments


def violations_of(observations: Sequence[Observation]) -> list[list[Violation]]:
    """Test laws of motion on each observation."""
    tested = [detected(observation) for observation in observations]
    laws = (jump_violation, flight_violation, rest_violation)
    found = []
    for observation, noises in zip(tested, track_noises(tested), strict=True):
        tracks = [track_of(observation, k, noise.whitening) for k, noise in enumerate(noises)]
        tests = [law(track) for track in tracks for law in laws]
        found.append([violation for violation in tests if violation is not None])
    return found


def assessed_by_laws(
    ids: Sequence[str], log_ps: Sequence[float], reasons: Sequence[str], trusted: Collection[str]
) -> list[Assessment]:
    """Assess observations by the p value of each, with the reason if it is doubtful."""
    weights = good_probabilities(np.array(log_ps)).tolist()
    return [
        Assessment(name, weight, "", USED)
        if weight >= LEAST_GOOD or name in trusted
        else Assessment(name, weight, reason, DOUBTFUL)
        for name, weight, reason in zip(ids, weights, reasons, strict=True)
    ]


def worst_reason(observation: Observation, violations: Sequence[Violation]) -> str:
    """Return the reason of the worst violation in an observation; empty where there is none."""
    if not violations:
        return ""
    worst = min(violations, key=lambda violation: violation.log_p)
    began = min(float(each.trajectory.times[0]) for each in observation.objects)
    return worst.what.at(worst.time - began)


def _clean_until(violations: Sequence[Violation]) -> float:
    """Time in s, on the clock of the trajectories, up to which an observation is used."""
    limit = max(0.5 * min(violation.log_p for violation in violations), LEAST_NOTABLE)
    return min(each.clean_until for each in violations if each.log_p <= limit)


def reassessed(
    assessments: Sequence[Assessment],
    misfits: NDArray[np.float64],
    times: NDArray[np.float64],
    trusted: Collection[str] = (),
) -> list[Assessment]:
    """Assess also by what the undisturbed motions that a search found leave unexplained.

    The logarithms of the misfits are normal where observations are good, about their median and
    with the spread from there to their 84 % quantile, which a share of disturbed ones below 16 %
    does not move. Few of them know their spread less well, so their tail is Student's.

    `misfits` (n,) losses per point where each is explained worst; NaN where the fit includes all
    points; `times` (n,) s after the start, where that is.
    """
    rest = np.flatnonzero([assessment.status == USED for assessment in assessments])
    if rest.size == 0:
        return list(assessments)
    sizes = np.log(np.maximum(np.nan_to_num(misfits[rest], nan=NOISE_LOSS), NOISE_LOSS))
    middle, upper = np.quantile(sizes, [0.5, norm.cdf(1.0)])
    spread = max(float(upper - middle), SMALLEST_MISFIT_SPREAD)
    scores = (sizes - middle) / spread
    weights = good_probabilities(student.logsf(scores, max(rest.size - 1, 1)))
    results = list(assessments)
    for member, weight in zip(rest.tolist(), weights.tolist(), strict=True):
        assessment = assessments[member]
        weight *= assessment.weight
        if weight >= LEAST_GOOD or assessment.id in trusted:
            results[member] = replace(assessment, weight=weight)
        else:
            reason = Reason.UNEXPLAINED.at(times[member])
            results[member] = Assessment(assessment.id, weight, reason, DOUBTFUL)
    return results


LEAST_NOTABLE = -10.0
"""Logarithm of a p value, 0.005 %, from which on a violation beside the worst one decides from when
on an observation is not used."""


def clean_part(observation: Observation, until: float) -> Observation:
    """Return an observation up to a time (its clock, s), with a few points in any case."""
    objects = tuple(_cut(each, until, observation.start_time) for each in observation.objects)
    return replace(observation, objects=objects)


def _cut(observed: ObservedObject, until: float, start: float) -> ObservedObject:
    def count(times: NDArray[np.float64]) -> int:
        inside, before = np.searchsorted(times, [until, start], side="right").tolist()
        return max(inside, min(before + LEAST_POINTS, times.size))

    track, detections = observed.trajectory, observed.detections
    kept = count(track.times)
    trajectory = Trajectory(track.times[:kept], track.positions[:kept])
    if detections is not None:
        kept = count(detections.times)
        detections = replace(
            detections,
            times=detections.times[:kept],
            positions=detections.positions[:kept],
            covariances=detections.covariances[:kept],
        )
    return replace(observed, trajectory=trajectory, detections=detections)


def least_log_p(violations: Sequence[Violation]) -> float:
    """Return the logarithm of the p value of the worst of all tests (Bonferroni)."""
    if not violations:
        return 0.0
    worst = min(violation.log_p for violation in violations)
    return min(0.0, worst + float(np.log(len(violations))))


def good_probabilities(log_ps: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the probability (n,) of each observation to be good.

    `log_ps` (n,) logarithms of p values that are uniform, or larger, where good.
    """
    if log_ps.size == 0:
        return np.zeros(0)
    scale = max(1.0, float(np.median(log_ps)) / np.log(0.5))
    bounded = np.maximum(log_ps / scale, SMALLEST_LOG_P)
    a = ALTERNATIVE_POWER
    density = a * np.exp((a - 1.0) * bounded)
    yes, no = DISTURBED_PRIOR
    share = yes / (yes + no)
    for _ in range(MIXTURE_STEPS):
        others = share * density / (1.0 - share + share * density)
        share = min((others.sum() + yes) / (others.size + yes + no), LARGEST_SHARE)
    return np.asarray((1.0 - share) / (1.0 - share + share * density))
