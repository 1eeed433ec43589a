"""Outcomes of the paper's synthetic set: predicted from the first few noisy points of a run."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.materials import StaticParameters
from intuitive_physics.scene import Scene
from intuitive_physics.simulation import Simulator
from intuitive_physics_experiments.calibration.first_points import initial_states
from intuitive_physics_experiments.paper.paper_dataset import POSITION_NOISE, PaperRun
from intuitive_physics_predictor.scores.outcomes import Outcome

HORIZONS = (0.5, 1.0, 2.0, 5.0)
"""s after the last point that was seen."""


def paper_outcomes(
    runs: Sequence[PaperRun],
    parameters: StaticParameters,
    simulator: Simulator,
    points: int,
    horizons: Sequence[float] = HORIZONS,
    rng: np.random.Generator | None = None,
    ahead_of: int | None = None,
) -> list[Outcome]:
    """Return each run as seen for its first points, and what then truly happened.

    Parameters
    ----------
    parameters : the true θ_s, and `simulator` the engine that moved the objects
    points : of each object that are seen, at least 3; those before the first touch tell the state
    horizons : s after the last of these points
    rng : of the noise that is added to what happened, as a learner sees it; None: the truth
    ahead_of : the point that horizons count from, by how many were seen then, at least `points`;
        None: the last of `points`. Predictions from more and from fewer points are of the same
        instants where this is the same.

    Raises
    ------
    InvalidInputError
        When horizons would count from before the last point that is seen.
    """
    last = points if ahead_of is None else ahead_of
    if last < points:
        raise InvalidInputError(
            f"horizons count from point {last} and {points} points are seen; expected them to "
            "count from the last one that is seen, or a later one"
        )
    outcomes = [
        _outcome(run, parameters, simulator, points, last, np.array(horizons)) for run in runs
    ]
    return outcomes if rng is None else [_seen(outcome, rng) for outcome in outcomes]


def _outcome(
    run: PaperRun,
    parameters: StaticParameters,
    simulator: Simulator,
    points: int,
    last: int,
    horizons: NDArray[np.float64],
) -> Outcome:
    states = initial_states(run.observation, points, POSITION_NOISE)
    after = run.observation.objects[0].trajectory.times[last - 1] + horizons
    truth = simulator.rollout([run.scene], parameters, after, orientations=False).positions[0]
    return Outcome(Scene(run.scene.environment, run.scene.objects, tuple(states)), after, truth)


def _seen(outcome: Outcome, rng: np.random.Generator) -> Outcome:
    noise = rng.normal(0.0, POSITION_NOISE, outcome.positions.shape)
    return Outcome(outcome.scene, outcome.times, outcome.positions + noise, POSITION_NOISE)
