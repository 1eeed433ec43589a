"""Evaluation of table tennis only: drag learned from flight, and predictions ahead."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.materials import StaticParameters
from intuitive_physics.observation import Observation, ObservedObject
from intuitive_physics.simulation import make_simulator
from intuitive_physics.trajectory import Trajectory
from intuitive_physics_cli.evaluation.evaluation import free_flight, split
from intuitive_physics_experiments.recorded_sets.table_tennis import (
    AirCoefficients,
    ball_parameters,
    fit_ball_state,
    rows_before_contact,
)
from intuitive_physics_learner.cost.cost_function import TrajectoryCost

LARGEST_DRAG = 1.0  # Upper bound of the drag coefficient that is searched; a sphere's is about 0.5
DRAG_TOLERANCE = 0.005  # To which the drag coefficient is searched
FEWEST_POINTS = 6  # Within the time that is watched, that a prediction starts from

# s for which a ball is watched, and s after that at which it is expected, at most.
WATCHED, MOST_AHEAD = 0.2, 1.0

AHEAD_STEP = 0.1  # s, of which the time predicted ahead is a multiple
UNFIT = 1e3  # m; misfit of air in which a flight cannot be fitted


@dataclass(frozen=True, eq=False)
class LookAhead:
    """Predicted and true places of balls some time after they were watched."""

    ahead: float  # s, at most `MOST_AHEAD`: as long as all balls were seen
    errors: dict[str, NDArray[np.float64]]  # by the way to predict, (n_balls,) m
    # m, root of the mean squared distance of the balls from their mean place at that time
    spread: float


def learn_drag(
    load: Callable[[AirCoefficients], Sequence[Observation]],
    magnus: float,
    train_fraction: float,
    seed: int,
) -> float:
    """Find the drag coefficient with which flights to the first bounce fit best.

    `load` makes the observations of a set in some air; only the training part of the split is
    learned from.
    """
    simulator = make_simulator("stepped")

    def misfit(drag: float) -> float:
        try:
            observations = load(AirCoefficients(float(drag), magnus))
        except InvalidInputError:
            return UNFIT
        training, _ = split(observations, train_fraction, seed)
        cost = TrajectoryCost([_before_bounce(observation) for observation in training], simulator)
        return float(cost.costs([ball_parameters().extended(cost.materials)])[0])

    fit = minimize_scalar(
        misfit, bounds=(0.0, LARGEST_DRAG), method="bounded", options={"xatol": DRAG_TOLERANCE}
    )
    return float(fit.x)


def look_ahead(
    observations: Sequence[Observation], learned: StaticParameters, default: StaticParameters
) -> LookAhead | None:
    """Predict where each ball is up to a second after its first 0.2 s, from those alone.

    Balls that bounce while they are watched are left out; None where all do, or none is seen for
    longer.
    """
    pairs = [(observation, _watched(observation)) for observation in observations]
    due = [(observation, early) for observation, early in pairs if early is not None]
    lasts = [
        observation.objects[0].trajectory.times[-1] - observation.start_time
        for observation, _ in due
    ]
    ahead = min(MOST_AHEAD, AHEAD_STEP * ((min(lasts, default=0.0) - WATCHED) // AHEAD_STEP))
    if ahead <= 0.0:
        return None
    at = WATCHED + ahead
    arrived = np.array([_place_at(observation, at) for observation, _ in due])
    early = [start for _, start in due]
    expected = {
        "learned parameters": _simulated(early, learned, at),
        "default parameters": _simulated(early, default, at),
        "free flight": np.array([_flown(start, at) for start in early]),
    }
    offsets = arrived - arrived.mean(axis=0)
    return LookAhead(
        ahead,
        {name: np.linalg.norm(places - arrived, axis=1) for name, places in expected.items()},
        float(np.sqrt((offsets**2).sum(axis=1).mean())),
    )


def _before_bounce(observation: Observation) -> Observation:
    (ball,) = observation.objects
    return _first_rows(observation, rows_before_contact(_heights(observation)), ball)


def _watched(observation: Observation) -> Observation | None:
    """The observation as it is known after `WATCHED`, with an initial state of that alone."""
    (ball,) = observation.objects
    since = ball.trajectory.times - observation.start_time
    count = int(np.searchsorted(since, WATCHED, side="right"))
    free = rows_before_contact(_heights(observation))
    if count < FEWEST_POINTS or free < count:
        return None
    times, positions = ball.trajectory.times[:count], ball.trajectory.positions[:count]
    state = fit_ball_state(times, positions, observation.environment, ball.object)
    return _first_rows(observation, count, replace(ball, initial_state=state))


def _first_rows(observation: Observation, count: int, ball: ObservedObject) -> Observation:
    trajectory = Trajectory(ball.trajectory.times[:count], ball.trajectory.positions[:count])
    return replace(observation, objects=(replace(ball, trajectory=trajectory),))


def _heights(observation: Observation) -> NDArray[np.float64]:
    (ball,) = observation.objects
    above = observation.environment.planes[0].signed_distances(ball.trajectory.positions)
    return above - ball.object.shape.bounding_radius


def _place_at(observation: Observation, since: float) -> NDArray[np.float64]:
    trajectory = observation.objects[0].trajectory
    at = observation.start_time + since
    return np.array([np.interp(at, trajectory.times, x) for x in trajectory.positions.T])


def _simulated(
    observations: Sequence[Observation], parameters: StaticParameters, at: float
) -> NDArray[np.float64]:
    scenes = [observation.scene() for observation in observations]
    rollout = make_simulator("auto").rollout(scenes, parameters, [at], orientations=False)
    return rollout.positions[:, 0, 0]


def _flown(observation: Observation, at: float) -> NDArray[np.float64]:
    (ball,) = observation.objects
    radius = ball.object.shape.bounding_radius
    return free_flight(observation.environment, radius, ball.initial_state, [at])[0]
