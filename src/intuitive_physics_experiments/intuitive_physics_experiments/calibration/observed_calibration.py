"""The calibration on observations: perceived ones in a folder, or a recorded set."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.materials import parameter_names
from intuitive_physics.observation import Observation
from intuitive_physics.simulation import make_simulator
from intuitive_physics_cli.commands.observation_source import read_observations
from intuitive_physics_cli.evaluation.evaluation import split
from intuitive_physics_experiments.calibration.calibrate import Calibration, calibrate
from intuitive_physics_experiments.calibration.launch_spread import launch_spread
from intuitive_physics_experiments.calibration.observed_outcomes import observed_outcomes
from intuitive_physics_experiments.recorded_sets.recorded_data import load_table_tennis
from intuitive_physics_experiments.recorded_sets.table_tennis import (
    BALL_MATERIAL,
    TABLE_MATERIAL,
    AirCoefficients,
    ball_parameters,
)
from intuitive_physics_learner.learning_session import LearningOptions, learn
from intuitive_physics_learner.search.parameter_search import ConvergenceCriteria, SearchProgress
from intuitive_physics_predictor.scores.noise_fit import FITTED_SCALES

MASS_TOLERANCE = 0.02
"""Relative, of a ball by the rules of the sport (2.67 to 2.77 g)."""

PAST_SHARE = 0.5
"""Of the observations: θ_s is learned from these and the noise is fitted to them."""


@dataclass(frozen=True, eq=False)
class ObservedCalibration:
    """What the calibration found.

    Parameters
    ----------
    calibration, learned : of all observations
    notes : paragraphs on what this set alone can tell
    """

    calibration: Calibration
    learned: LearnedParameters
    notes: tuple[str, ...]


def read_air_observations(
    path: Path, drag: float
) -> tuple[str, list[Observation], LearnedParameters | None]:
    """Return title and observations of a folder or a recorded set, and where learning starts.

    Parameters
    ----------
    drag : coefficient of table-tennis balls; 0: no air
    """
    if drag == 0.0:
        return *read_observations(path), None
    title, observations = load_table_tennis(path, AirCoefficients(drag))
    return f"{title}, drag {drag:g}", observations, _known_ball()


def _known_ball() -> LearnedParameters:
    """Defaults, but for the ball's density, which counts in air and which the rules tell."""
    start = LearnedParameters.defaults((BALL_MATERIAL, TABLE_MATERIAL))
    names = np.array(parameter_names(start.materials))
    told = names == f"density[{BALL_MATERIAL}]"
    parameters = ball_parameters()
    density = parameters.density[parameters.index(BALL_MATERIAL)]
    return LearnedParameters(
        parameters,
        np.where(told, MASS_TOLERANCE * density, np.nan),
        told,
        start.version,
        start.cost,
        start.observation_count,
        start.method,
    )


def calibrate_on_observations(
    observations: Sequence[Observation],
    points: int,
    horizons: Sequence[float],
    *,
    same_settings: bool = False,
    start: LearnedParameters | None = None,
    sample_count: int = 100,
    iterations: int = 2000,
    engine: str = "auto",
    seed: int = 0,
    on_progress: Callable[[SearchProgress], None] | None = None,
) -> ObservedCalibration:
    """Learn and fit the noise with one half, predict the other half from its first points.

    Parameters
    ----------
    points : of each object that are seen
    horizons : s after the last of them
    same_settings : whether all are shots of a launcher that was set once, so that their spread is
        compared too
    start : θ_s that learning starts from; None: the defaults
    sample_count : simulations of each prediction
    iterations : evaluations of J at most
    """
    simulator = make_simulator(engine)
    past, held_out = split(observations, PAST_SHARE, seed)
    criteria = ConvergenceCriteria(max_iterations=iterations)
    learned = learn(
        past,
        simulator,
        LearningOptions(method="cma_es", criteria=criteria, seed=seed),
        previous=start,
        on_progress=on_progress,
    ).learned
    densities = dict(zip(learned.materials, learned.parameters.density.tolist(), strict=True))
    found = calibrate(
        observed_outcomes(past, points, horizons, densities),
        observed_outcomes(held_out, points, horizons, densities),
        learned,
        horizons,
        scales_to_fit=("spin", *FITTED_SCALES),
        sample_count=sample_count,
        seed=seed,
        simulator=simulator,
    )
    notes: tuple[str, ...] = ()
    if same_settings:
        parameters = found.fit.scales.parameters(learned)
        spread = launch_spread(past, held_out, parameters, seed=seed, simulator=simulator)
        notes = (spread.to_markdown(),)
    return ObservedCalibration(found, learned, notes)
