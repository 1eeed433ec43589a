"""Compare what the nodes perceived, learned and predicted with what truly happened."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from intuitive_physics_msgs.msg import Environment as EnvironmentMessage
from intuitive_physics_msgs.msg import TrajectoryDistribution
from numpy.typing import NDArray

from intuitive_physics.errors import IntuitivePhysicsError
from intuitive_physics.geometry.rotations import rotation_matrix
from intuitive_physics.materials import StaticParameters
from intuitive_physics.observation import Observation
from intuitive_physics.simulation import make_simulator
from intuitive_physics.trajectory import Trajectory, mean_distance
from intuitive_physics_experiments.demo.demo_result import PredictionOutcome, ThrowErrors
from intuitive_physics_experiments.rendering.ground_truth import GroundTruth
from intuitive_physics_experiments.rendering.throws import Throw
from intuitive_physics_learner.cost.cost_function import TrajectoryCost
from intuitive_physics_ros.conversions import (
    seconds_from_stamp,
    trajectory_distribution_from_message,
)


@dataclass(frozen=True, eq=False)
class PerceivedFrame:
    """The frame perception made for itself, and the truth's place in it.

    Parameters
    ----------
    rotation, translation : (3, 3) and (3,) m, p_environment = rotation p_camera + translation
    truth : of the recording
    """

    rotation: NDArray[np.float64]
    translation: NDArray[np.float64]
    truth: GroundTruth

    @staticmethod
    def of(message: EnvironmentMessage, truth: GroundTruth) -> PerceivedFrame:
        """Read where perception thinks the camera is."""
        at, turned = message.camera_pose.position, message.camera_pose.orientation
        rotation = rotation_matrix((turned.x, turned.y, turned.z, turned.w))
        return PerceivedFrame(rotation, np.array([at.x, at.y, at.z]), truth)

    def true_positions(self, throw: Throw, stamps: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return where a ball truly was, (n, 3) m in this frame, at stamps (n,) s of the bag."""
        in_world = throw.positions_at(stamps - 1e-9 * self.truth.start_time)
        return self.truth.camera.to_optical(in_world) @ self.rotation.T + self.translation

    def throw_at(self, stamp: float) -> Throw:
        """Return the throw under way at a stamp (s) of the bag."""
        since_start = stamp - 1e-9 * self.truth.start_time
        for throw in self.truth.throws:
            if throw.start_time - 0.01 <= since_start <= throw.end_time + 0.01:
                return throw
        raise IntuitivePhysicsError(
            f"something was seen moving {since_start:.2f} s after the start, "
            "when no ball was thrown"
        )


def explain_costs(
    observations: Sequence[Observation], learned: StaticParameters, true: StaticParameters
) -> NDArray[np.float64]:
    """Return D̄ of each observation (n,) under learned, true and default parameters: (3, n) m."""
    cost = TrajectoryCost(observations, make_simulator("auto"))
    default = StaticParameters.uniform(cost.materials)
    known = [parameters.extended(cost.materials) for parameters in (learned, true)]
    return cost.observation_costs([*known, default])


def throw_errors(
    observations: Sequence[Observation],
    costs: NDArray[np.float64],
    frame: PerceivedFrame,
) -> tuple[ThrowErrors, ...]:
    """Say for each observation how well it was seen and explained."""
    rows = []
    for k, seen in enumerate(observations):
        thing = seen.objects[0]
        throw = frame.throw_at(seen.start_time)
        truth = frame.true_positions(throw, thing.trajectory.times)
        errors = np.linalg.norm(thing.trajectory.positions - truth, axis=1)
        rows.append(
            ThrowErrors(
                name=f"throw {k + 1}",
                material=throw.material,
                radius=throw.radius,
                points=len(thing.trajectory),
                perception_rmse=float(np.sqrt(np.mean(errors**2))),
                learned_distance=float(costs[0, k]),
                oracle_distance=float(costs[1, k]),
                default_distance=float(costs[2, k]),
            )
        )
    return tuple(rows)


def perception_rmse(rows: Sequence[ThrowErrors]) -> float:
    """RMS of the distance between seen and true positions over all points of all throws, m."""
    points = np.array([row.points for row in rows])
    squares = np.array([row.perception_rmse**2 for row in rows])
    return float(np.sqrt((points * squares).sum() / points.sum()))


def prediction_outcome(
    message: TrajectoryDistribution, observation: Observation, frame: PerceivedFrame
) -> PredictionOutcome:
    """Put a prediction beside what then happened, for as long as the throw is known."""
    predicted = trajectory_distribution_from_message(message)
    stamp = seconds_from_stamp(predicted.stamp)
    throw = frame.throw_at(stamp)
    end = throw.end_time + 1e-9 * frame.truth.start_time - stamp
    known = predicted.times <= end
    seen = observation.objects[0]
    return PredictionOutcome(
        environment=observation.environment,
        material=seen.object.material,
        radius=seen.object.shape.bounding_radius,
        times=predicted.times[known],
        samples=predicted.positions[:, 0, known],
        mean=predicted.mean[0, known],
        observed_times=seen.trajectory.times - stamp,
        observed=seen.trajectory.positions,
        true=frame.true_positions(throw, stamp + predicted.times[known]),
    )


def prediction_error(outcome: PredictionOutcome) -> float:
    """D̄ (Eq. 6) between the predicted mean and the truth, m."""
    predicted, true = (Trajectory(outcome.times, path) for path in (outcome.mean, outcome.true))
    return mean_distance(predicted, true)
