"""Results of the demo, compared with the ground truth."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import IntuitivePhysicsError
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.materials import StaticParameters
from intuitive_physics.messages.geometry import seconds_from_stamp
from intuitive_physics.observation import Observation
from intuitive_physics.scene import Environment
from intuitive_physics.simulation import make_simulator
from intuitive_physics.trajectory import Trajectory, mean_distance
from intuitive_physics_cli.evaluation.prequential import Predicted
from intuitive_physics_experiments.rendering.camera import Camera
from intuitive_physics_experiments.rendering.ground_truth import GroundTruth
from intuitive_physics_experiments.rendering.throws import Throw
from intuitive_physics_learner.cost.cost_function import TrajectoryCost
from intuitive_physics_perception.environment.environment_model import model_environment
from intuitive_physics_perception.input.camera import Intrinsics
from intuitive_physics_perception.input.depth import depth_of_image, points_from_depth
from intuitive_physics_perception.settings import PerceptionSettings
from intuitive_physics_recordings.bag_reader import BagReader
from intuitive_physics_recordings.depth_bag_writer import DEPTH_TOPIC


@dataclass(frozen=True, eq=False)
class ExampleFrame:
    """One depth frame and what perception found in it."""

    depth: NDArray[np.uint16]  # (height, width) uint16 millimetres, 0 where there is no reading
    camera_matrix: NDArray[np.float64]  # (3, 3) pixels
    # rotation, translation: (3, 3) and (3,) m, p_environment = rotation p_sensor + translation
    rotation: NDArray[np.float64]
    translation: NDArray[np.float64]
    environment: Environment  # perceived Ω_e
    # for each plane, (n, 3) m in the environment's frame, what was seen of it
    plane_outlines: tuple[NDArray[np.float64], ...]
    sphere_center: NDArray[np.float64]  # (3,) m in the environment's frame
    sphere_radius: float  # m
    # (n, 3) m in the environment's frame, where the ball was seen in its whole throw
    track: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LearningOutcome:
    """Learned parameters, and the costs to compare them with."""

    true: StaticParameters  # θ_s the balls obeyed, over the materials of `learned` at least
    learned: LearnedParameters  # θ_s with uncertainty
    cost_history: NDArray[np.float64]  # (iterations,) m, lowest J after each iteration
    default_cost: float  # m, J of the default parameters on the same observations
    oracle_cost: float  # m, J of the true parameters on them: noise that no learner can remove


@dataclass(frozen=True)
class ThrowErrors:
    """Errors of perception and of the parameters on one throw."""

    name: str  # shown in the table
    material: str  # name
    radius: float  # m, true
    points: int  # how often the ball was seen
    perception_rmse: float  # m, seen against true positions
    learned_distance: float  # m, D̄ of the learned parameters
    oracle_distance: float  # m, D̄ of the true parameters
    default_distance: float  # m, D̄ of the default parameters


@dataclass(frozen=True, eq=False)
class PredictionOutcome:
    """A throw that was predicted before it happened."""

    environment: Environment  # the one it was predicted in
    material: str  # of the ball
    radius: float  # m
    times: NDArray[np.float64]  # (n_times,) s after the state that was predicted from
    samples: NDArray[np.float64]  # (n_samples, n_times, 3) m
    mean: NDArray[np.float64]  # (n_times, 3) m
    observed_times: NDArray[np.float64]  # (n,) s on the same clock; may begin before 0
    observed: NDArray[np.float64]  # (n, 3) m, where the ball was seen
    true: NDArray[np.float64]  # (n_times, 3) m, where it truly was at `times`


@dataclass(frozen=True, eq=False)
class DemoResult:
    """Everything the report shows."""

    example: ExampleFrame  # one frame
    learning: LearningOutcome  # what was learned
    throws: tuple[ThrowErrors, ...]  # one entry a throw
    prediction: PredictionOutcome  # the throw that was predicted
    # the throws, each predicted before it was learned from
    predicted: Predicted = field(default_factory=Predicted)
    # the numbers the demo ends with, by name
    summary: Mapping[str, float] = field(default_factory=dict)
    # how it was made (seed, versions, times …), shown as text
    about: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class PerceivedFrame:
    """The frame perception made for itself, and the truth's place in it."""

    # rotation, translation: (3, 3) and (3,) m, p_environment = rotation p_camera + translation
    rotation: NDArray[np.float64]
    translation: NDArray[np.float64]
    truth: GroundTruth  # of the recording

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
    """Return how well each observation was perceived, and explained at its costs (3, n) m."""
    rows = []
    for k, observation in enumerate(observations):
        observed_object = observation.objects[0]
        throw = frame.throw_at(observation.start_time)
        truth = frame.true_positions(throw, observed_object.trajectory.times)
        errors = np.linalg.norm(observed_object.trajectory.positions - truth, axis=1)
        rows.append(
            ThrowErrors(
                name=f"throw {k + 1}",
                material=throw.material,
                radius=throw.radius,
                points=len(observed_object.trajectory),
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
    stamp: float,
    times: NDArray[np.float64],
    samples: NDArray[np.float64],
    mean: NDArray[np.float64],
    observation: Observation,
    frame: PerceivedFrame,
) -> PredictionOutcome:
    """Put a prediction beside what then happened, for as long as the throw is known.

    The stamp is s on the bag's clock, of the state that was predicted from; `times` (n_times,) s
    count from there, `samples` (n_samples, n_times, 3) m and `mean` (n_times, 3) m are predicted.
    """
    throw = frame.throw_at(stamp)
    end = throw.end_time + 1e-9 * frame.truth.start_time - stamp
    known = times <= end
    observed = observation.objects[0]
    return PredictionOutcome(
        environment=observation.environment,
        material=observed.object.material,
        radius=observed.object.shape.bounding_radius,
        times=times[known],
        samples=samples[:, known],
        mean=mean[known],
        observed_times=observed.trajectory.times - stamp,
        observed=observed.trajectory.positions,
        true=frame.true_positions(throw, stamp + times[known]),
    )


def prediction_error(outcome: PredictionOutcome) -> float:
    """D̄ (Eq. 6) between the predicted mean and the truth, m."""
    predicted, true = (Trajectory(outcome.times, path) for path in (outcome.mean, outcome.true))
    return mean_distance(predicted, true)


HEIGHT_SHOWN = 0.25  # m; the frame shown is one in which the ball is well above the floor


def example_frame(
    bag: Path,
    observation: Observation,
    camera: Camera,
    rotation: NDArray[np.float64],
    translation: NDArray[np.float64],
) -> ExampleFrame:
    """Take the frame of a throw in which the ball flies, with the planes in view.

    The `rotation` (3, 3) and `translation` (3,) m lead from the sensor to the environment.
    """
    observed = observation.objects[0]
    track = observed.trajectory
    flying = np.flatnonzero(track.positions[:, 2] > HEIGHT_SHOWN)
    shown = int(flying[len(flying) // 2]) if flying.size else 0
    depths = depth_images(bag)
    settings = PerceptionSettings()
    rays = Intrinsics(camera.width, camera.height, camera.matrix()).rays()
    first = [points_from_depth(next(depths)[1], rays) for _ in range(settings.environment_frames)]
    model = model_environment(first, settings, np.random.default_rng(0))
    depth = next(image for time, image in depths if time > track.times[shown] - 1e-3)
    return ExampleFrame(
        depth=depth.copy(),
        camera_matrix=camera.matrix(),
        rotation=rotation,
        translation=translation,
        environment=observation.environment,
        plane_outlines=tuple(plane.hull @ rotation.T + translation for plane in model.detected),
        sphere_center=track.positions[shown],
        sphere_radius=observed.object.shape.bounding_radius,
        track=track.positions,
    )


def depth_images(bag: Path) -> Iterator[tuple[float, NDArray[Any]]]:
    """Yield time (s) and depth image (height, width) of each frame of a bag."""
    with BagReader(bag) as reader:
        for message in reader.messages([DEPTH_TOPIC]):
            image = reader.decode(message)
            yield seconds_from_stamp(image.header.stamp), depth_of_image(image)
