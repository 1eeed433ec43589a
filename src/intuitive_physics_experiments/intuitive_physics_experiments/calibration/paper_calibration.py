"""The calibration on the paper's synthetic set: learn, fit the noise, predict what was held out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.simulation import make_simulator
from intuitive_physics_experiments.calibration.calibrate import OURS, Calibration, calibrate
from intuitive_physics_experiments.calibration.first_points import with_first_points
from intuitive_physics_experiments.calibration.paper_outcomes import HORIZONS, paper_outcomes
from intuitive_physics_experiments.calibration.proper_learning import learn_by_energy_score
from intuitive_physics_experiments.calibration.verification import Scores, score
from intuitive_physics_experiments.paper_dataset import POSITION_NOISE, make_paper_dataset
from intuitive_physics_experiments.paper_room import SHAPE_KINDS
from intuitive_physics_learner.learning_session import LearningOptions, learn
from intuitive_physics_learner.search import ConvergenceCriteria, SearchProgress
from intuitive_physics_predictor.outcomes import noisy_prediction

LEARNED_SHARE, PAST_SHARE = 0.35, 0.2
"""Of the runs: what θ_s is learned from, and what the noise is fitted to. The rest is held out."""

LEARNED_POINTS = 30
"""Points, at most, that first states of what is learned from are fitted to."""

POINT_COUNTS = (3, 5, 10, 15)
"""Points that are seen of an object before it is predicted."""


@dataclass(frozen=True)
class PaperCalibrationOptions:
    """How the calibration is made.

    Parameters
    ----------
    objects, samples, kinds : of the set, as in `make_paper_dataset`
    points : that are seen of each object
    point_counts : the same, for the error against how much was seen
    horizons : s after the last point
    sample_count : simulations of each prediction
    iterations : of the search for θ_s by J (CMA-ES)
    score_iterations : of the search by energy score that goes on from there
    engine : that makes the set, learns and predicts
    seed : of everything
    """

    objects: int = 3
    samples: int = 100
    kinds: Sequence[str] = SHAPE_KINDS
    points: int = 10
    point_counts: Sequence[int] = POINT_COUNTS
    horizons: Sequence[float] = HORIZONS
    sample_count: int = 100
    iterations: int = 4000
    score_iterations: int = 1000
    engine: str = "auto"
    seed: int = 0


@dataclass(frozen=True, eq=False)
class PaperCalibration:
    """What the calibration found.

    Parameters
    ----------
    calibration : of predictions from `points` points
    learned : θ_s
    by_points : scores of ours by how many points were seen
    """

    calibration: Calibration
    learned: LearnedParameters
    by_points: dict[int, Scores]

    def summary(self) -> dict[str, Any]:
        """Return coverage of the 90 % regions by horizon, and our score against the baselines'.

        Returns
        -------
        dict
            `coverage_90` by horizon; `energy_score_vs_best_baseline`, the largest of the ratios at
            all horizons: below 1, ours is better than every baseline at every one.
        """
        found = self.calibration
        covered = found.scores[OURS].coverage(0.9)
        return {
            "coverage_90": {
                f"{horizon:g}": round(float(share), 4)
                for horizon, share in zip(found.horizons, covered, strict=True)
            },
            "energy_score_vs_best_baseline": round(
                float(found.energy_score_vs_best_baseline.max()), 4
            ),
        }


def calibrate_on_paper_set(
    options: PaperCalibrationOptions,
    on_progress: Callable[[SearchProgress], None] | None = None,
) -> PaperCalibration:
    """Make the set, learn θ_s from a part, fit the noise to another, score on the rest.

    Parameters
    ----------
    on_progress : is told of the search

    Raises
    ------
    InvalidInputError
        When there are too few runs for three parts.
    """
    simulator = make_simulator(options.engine)
    dataset = make_paper_dataset(
        options.objects,
        options.samples,
        np.random.default_rng(options.seed),
        engine=options.engine,
        first_states="flight",
        kinds=options.kinds,
    )
    runs = (*dataset.training, *dataset.test)
    if len(runs) < 10:
        raise InvalidInputError(f"set has {len(runs)} runs; expected at least 10, ask for more")
    first, second = (round(s * len(runs)) for s in (LEARNED_SHARE, LEARNED_SHARE + PAST_SHARE))
    criteria = ConvergenceCriteria(max_iterations=options.iterations)
    observations = [
        with_first_points(run.observation, LEARNED_POINTS, POSITION_NOISE) for run in runs[:first]
    ]
    learned = learn(
        observations,
        simulator,
        LearningOptions(method="cma_es", criteria=criteria, seed=options.seed),
        on_progress=on_progress,
    ).learned
    learned = learn_by_energy_score(
        observations,
        learned,
        POSITION_NOISE,
        simulator,
        iterations=options.score_iterations,
        seed=options.seed,
        on_progress=on_progress,
    )
    seen = (dataset.parameters, simulator)
    noise = np.random.default_rng([options.seed, 1])
    found = calibrate(
        paper_outcomes(runs[first:second], *seen, options.points, options.horizons, noise),
        paper_outcomes(runs[second:], *seen, options.points, options.horizons),
        learned,
        options.horizons,
        sample_count=options.sample_count,
        seed=options.seed,
        simulator=simulator,
    )
    ours = noisy_prediction(learned, found.fit.scales, options.sample_count, simulator)
    by_points = {
        points: score(
            paper_outcomes(runs[second:], *seen, points, options.horizons), ours, options.seed + 1
        )
        for points in options.point_counts
    }
    return PaperCalibration(found, learned, by_points)
