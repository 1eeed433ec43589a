"""The demo: render throws, perceive, learn, predict one more, write a report."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from intuitive_physics_msgs.msg import Environment, TrajectoryDistribution

from intuitive_physics.errors import IntuitivePhysicsError
from intuitive_physics.geometry.rotations import rotation_matrix
from intuitive_physics.observation import Observation
from intuitive_physics.processes import guard_run
from intuitive_physics.simulation import make_simulator
from intuitive_physics_cli.evaluation.prequential import Predicted, predict_before_learning
from intuitive_physics_experiments.demo.demo_result import (
    DemoResult,
    LearningOutcome,
    PerceivedFrame,
    PredictionOutcome,
    depth_images,
    example_frame,
    explain_costs,
    perception_rmse,
    prediction_error,
    prediction_outcome,
    throw_errors,
)
from intuitive_physics_experiments.demo.moving_picture import PredictedPaths, write_moving_picture
from intuitive_physics_experiments.demo.nodes.suite import (
    Heard,
    Learned,
    Progress,
    Suite,
    learn,
    learner_client,
    listen,
    replay,
)
from intuitive_physics_experiments.demo.report import write_report
from intuitive_physics_experiments.rendering.ground_truth import GroundTruth
from intuitive_physics_experiments.rendering.rendered_bag import RenderSettings, reuse_or_render_bag
from intuitive_physics_experiments.results import source_commit
from intuitive_physics_learner.learning_session import LearningOptions
from intuitive_physics_learner.methods import DEFAULT_METHOD
from intuitive_physics_learner.search.convergence import ConvergenceCriteria
from intuitive_physics_ros.conversions import observation_from_message, seconds_from_stamp
from intuitive_physics_ros.scripting import Peer

# Seconds for which the new throw is watched before the prediction that is shown is taken.
SEEN_BEFORE_PREDICTING = 0.2

LEAST_SHARE_SEEN = 0.75  # Share of the throws that must become observations

# m, RMS distance of perceived from true positions with which the demo still succeeds.
LARGEST_PERCEPTION_ERROR = 0.02

LOWEST_RATE = 50.0  # 1/s, predictions that must arrive
SLOWER = 0.5  # Speed at which a replay with fewer is repeated, as a part of its own
MOVING_PICTURE = "demo.gif"  # File with the throw that was predicted


class DemoError(IntuitivePhysicsError):
    """A part of the demo did not do what it should."""


@dataclass(frozen=True)
class Options:
    """Options of the command line."""

    output: Path
    throws: int
    seed: int
    rate: float
    method: str
    iterations: int


@dataclass(frozen=True, eq=False)
class Seen:
    """Observations of one recording, and the frame they are in."""

    observations: list[Observation]
    frame: PerceivedFrame


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the demo; the last line printed is JSON. Returns the exit code."""
    guard_run()
    options = _options(arguments)
    progress = Progress()
    try:
        options.output.mkdir(parents=True, exist_ok=True)
        numbers = run(options, progress)
    except (IntuitivePhysicsError, OSError) as error:
        progress.end_bar()
        print(f"demo failed: {error}", file=sys.stderr)
        print(json.dumps({"demo": "failed", "reason": str(error).splitlines()[0]}))
        return 1
    except KeyboardInterrupt:
        progress.end_bar()
        print("demo stopped", file=sys.stderr)
        return 130
    print(json.dumps({"demo": "ok", **numbers}))
    return 0


def run(options: Options, progress: Progress) -> dict[str, float]:
    """Do it all and return the numbers of the last line."""
    start = time.monotonic()
    bags = options.output / "bags"
    settings = RenderSettings(throws=options.throws, seed=options.seed)
    progress.stage(f"{options.throws} throws to learn from, one to predict: rendering or reusing")
    truth = reuse_or_render_bag(bags / "throws", settings, progress.bar)
    unseen_settings = replace(settings, throws=1, seed=options.seed + 1)
    unseen_truth = reuse_or_render_bag(bags / "unseen_throw", unseen_settings, progress.bar)

    database = options.output / "learner.sqlite3"
    for file in options.output.glob(f"{database.name}*"):
        file.unlink()
    with Peer("demo") as peer, Suite(database, settings.throw_duration, options.output) as suite:
        heard = listen(peer)
        suite.wait_until_up(peer)
        learner = learner_client(peer)
        progress.stage("perceiving: the bag is replayed to the nodes")
        published = 0
        for rate in (options.rate, SLOWER * options.rate):
            heard.clear()
            replay(bags / "throws", rate, suite, peer, progress)
            count = len(heard.observations)
            published += count
            progress.detail(f"{count} of {options.throws} throws became observations")
            if count >= LEAST_SHARE_SEEN * options.throws:
                break
            progress.detail(f"so few at {rate:g} times real time: this machine may be too busy")
        else:
            raise DemoError(f"only {count} of {options.throws} throws were observed")
        seen = _understood(heard, truth)
        progress.stage(f"learning by {options.method}")
        learned = learn(peer, learner, options.method, options.iterations, options.seed, progress)
        # A throw that was observed more than once is stored once.
        _require(
            LEAST_SHARE_SEEN * options.throws <= learned.parameters.observation_count <= published,
            f"the learner learned from {learned.parameters.observation_count} observations, "
            f"{published} were published",
        )
        heard.clear()
        progress.stage("predicting a throw that was not learned from")
        replay(bags / "unseen_throw", 1.0, suite, peer, progress)
        unseen = _understood(heard, unseen_truth)
        prediction = _prediction(heard, unseen)

    progress.stage("predicting each throw with what those before it taught")
    predicted = _predicted_before_learning(options, seen, progress)
    progress.stage("comparing with the truth and writing the report")
    result = replace(
        _result(truth, seen, learned, prediction, bags / "throws"), predicted=predicted
    )
    numbers = dict(result.summary) | {"prediction_rate_hz": round(_rate(heard), 1)}
    _check(result, numbers)
    about = {
        "commit": source_commit(),
        "seed": str(options.seed),
        "took": f"{time.monotonic() - start:.0f} s",
    }
    paths = write_report(replace(result, summary=numbers, about=about), options.output)
    moving = options.output / MOVING_PICTURE
    _write_moving_picture(moving, bags / "unseen_throw", unseen, heard, about["commit"])
    progress.detail(f"report: {paths.page}")
    progress.detail(f"pictures: {paths.picture}, {moving}")
    return numbers


def _understood(heard: Heard, truth: GroundTruth) -> Seen:
    """Read what perception published of a recording."""
    _require(bool(heard.environments), "perception published no environment")
    _require(bool(heard.observations), "perception published no observation")
    observations = [observation_from_message(message) for message in heard.observations]
    return Seen(observations, _frame(heard.environments[-1], truth))


def _frame(message: Environment, truth: GroundTruth) -> PerceivedFrame:
    """Read where perception places the camera."""
    at, turned = message.camera_pose.position, message.camera_pose.orientation
    rotation = rotation_matrix((turned.x, turned.y, turned.z, turned.w))
    return PerceivedFrame(rotation, np.array([at.x, at.y, at.z]), truth)


def _prediction(heard: Heard, unseen: Seen) -> PredictionOutcome:
    """Take the first prediction made after the ball was watched for a moment."""
    observation = unseen.observations[0]
    due = observation.start_time + SEEN_BEFORE_PREDICTING
    for _, message in heard.distributions:
        if seconds_from_stamp(message.header.stamp) >= due:
            paths = _predicted_paths(message)
            mean = np.array(message.objects[0].mean, dtype=np.float64).reshape(-1, 3)
            return prediction_outcome(
                paths.made, paths.times, paths.paths, mean, observation, unseen.frame
            )
    raise DemoError("the predictor predicted nothing while the ball was in the air")


def _predicted_paths(message: TrajectoryDistribution) -> PredictedPaths:
    """Read the samples of the one object in a message."""
    times = np.array(message.times, dtype=np.float64)
    paths = np.array(message.objects[0].samples, dtype=np.float64)
    made = seconds_from_stamp(message.header.stamp)
    return PredictedPaths(made, times, paths.reshape(message.sample_count, times.size, 3))


def _write_moving_picture(path: Path, bag: Path, unseen: Seen, heard: Heard, commit: str) -> None:
    """Draw the throw that was predicted, with every prediction of it as it was made."""
    (ball, *_) = unseen.observations[0].objects
    predictions = [_predicted_paths(message) for _, message in heard.distributions]
    radius = ball.object.shape.bounding_radius
    write_moving_picture(
        path, depth_images(bag), unseen.frame, ball.trajectory, radius, predictions, commit
    )


def _rate(heard: Heard) -> float:
    """Return distributions a second (1/s) while there was something to predict."""
    arrivals = np.array([arrival for arrival, _ in heard.distributions])
    return float((arrivals.size - 1) / max(np.ptp(arrivals), 1e-6))


def _predicted_before_learning(options: Options, seen: Seen, progress: Progress) -> Predicted:
    """Return the predictions of the throws."""
    criteria = ConvergenceCriteria(max_iterations=options.iterations)
    return predict_before_learning(
        seen.observations,
        LearningOptions(method=options.method, criteria=criteria, seed=options.seed),
        make_simulator("auto"),
        np.random.default_rng(options.seed),
        on_progress=progress.bar,
    )


def _result(
    truth: GroundTruth,
    seen: Seen,
    learned: Learned,
    prediction: PredictionOutcome,
    bag: Path,
) -> DemoResult:
    costs = explain_costs(seen.observations, learned.parameters.parameters, truth.static_parameters)
    throws = throw_errors(seen.observations, costs, seen.frame)
    learned_cost, oracle_cost, default_cost = costs.mean(axis=1)
    return DemoResult(
        example=example_frame(
            bag,
            seen.observations[1],
            truth.camera,
            seen.frame.rotation,
            seen.frame.translation,
        ),
        learning=LearningOutcome(
            true=truth.static_parameters,
            learned=learned.parameters,
            cost_history=learned.cost_history,
            default_cost=float(default_cost),
            oracle_cost=float(oracle_cost),
        ),
        throws=throws,
        prediction=prediction,
        summary={
            "perception_rmse_mm": round(1e3 * perception_rmse(throws), 2),
            "learned_J_m": round(float(learned_cost), 5),
            "oracle_J_m": round(float(oracle_cost), 5),
            "prediction_error_m": round(prediction_error(prediction), 4),
        },
    )


def _check(result: DemoResult, numbers: dict[str, float]) -> None:
    """Refuse to call it a success when a part did badly."""
    _require(
        numbers["perception_rmse_mm"] <= 1e3 * LARGEST_PERCEPTION_ERROR,
        f"perception is {numbers['perception_rmse_mm']} mm off the truth",
    )
    _require(
        numbers["learned_J_m"] < result.learning.default_cost,
        "the learned parameters explain the throws no better than the defaults",
    )
    _require(
        numbers["prediction_rate_hz"] >= LOWEST_RATE,
        f"only {numbers['prediction_rate_hz']} predictions a second arrived",
    )


def _require(holds: bool, complaint: str) -> None:
    if not holds:
        raise DemoError(complaint)


def _options(arguments: Sequence[str] | None) -> Options:
    parser = argparse.ArgumentParser(prog="demo", description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("demo_output"), help="folder")
    parser.add_argument("--throws", type=int, default=12, help="throws to learn from")
    parser.add_argument("--seed", type=int, default=0, help="of throws, noise and search")
    parser.add_argument("--rate", type=float, default=1.0, help="replay speed while perceiving")
    parser.add_argument("--method", default=DEFAULT_METHOD, help="of the search")
    parser.add_argument("--iterations", type=int, default=1500, help="evaluations of the cost J")
    return Options(**vars(parser.parse_args(arguments)))
